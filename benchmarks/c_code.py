"""C code of one vehicle for the contenders in C: its numbers, and OSQP's generated code."""

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.allocation.osqp import osqp_program
from ca_ros.allocation.result import Status
from ca_ros.firmware.literals import literal
from ca_ros.problem.prioritization import AXIS_REVERSAL, default_order, sensed
from ca_ros.problem.problem import AllocationProblem


def header(problem: AllocationProblem, precision: str, storage: str = '') -> str:
    """Return a header with a vehicle's matrices and bounds, and OPTIONS of the kernel.

    The precision is double or single.  `storage` is what the declarations begin with; without
    ``const`` the compiler cannot use the numbers.
    """
    axes, n, m = problem.axes, problem.n, len(problem.axes)
    groups = default_order(axes)
    keeps = sensed(groups, AXIS_REVERSAL)
    options = (
        f'{int(Status.PRIORITIZED)}',
        *(literal(numbers, precision) for numbers in (
            [axes.index(axis) for group in groups for axis in group],
            [i for i, group in enumerate(groups) for _ in group],
            [int(axis in keeps) for axis in axes], problem.reference,
        )),
        '0', '1e-9',
    )
    arrays = {
        f'matrix[{m}][{n}]': problem.gamma, f'inverse[{n}][{m}]': np.linalg.pinv(problem.gamma),
        f'lower[{n}]': problem.lower, f'upper[{n}]': problem.upper,
    }
    kind = {'double': 'double', 'single': 'float'}[precision]
    lines = [
        f'{storage} number {name} = {literal(np.ravel(values), precision)};'
        for name, values in arrays.items()
    ]
    lines += [f'#define OPTIONS {{{", ".join(options)}}}', '']
    return '\n'.join([f'typedef {kind} number;', *lines])


def osqp_code(problem: AllocationProblem, folder: Path, **options: Any) -> list[str]:
    """Write OSQP's embedded code for Eqs. (20)-(22); return its sources and include options.

    Raises an ImportError if the package osqp is not installed.
    """
    solver, _ = osqp_program(problem)
    with redirect_stdout(StringIO()):
        solver.codegen(str(folder), parameters='vectors', force_rewrite=True, **options)
    includes = (folder, folder / 'inc' / 'public', folder / 'inc' / 'private')
    sources = (folder / 'workspace.c', *folder.glob('src/*.c'))
    return [*map(str, sources), *(f'-I{path}' for path in includes)]
