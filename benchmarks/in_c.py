"""Contenders in C: the same wrenches without the cost of Python interfaces.

`contenders.c` is compiled for a vehicle when the benchmark runs, with the kernel of `exact` and
the code that OSQP generates; of DAQP the library inside its Python package is called.
"""

import ctypes
import subprocess
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from benchmarks.c_code import header, osqp_code
from ca_ros import kernel
from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem

SOURCE = Path(__file__).with_name('contenders.c')
KERNEL = Path(kernel.__file__).parent
COMPILERS = ('cc', 'gcc', 'clang')

OPTIONS = [
    '-std=c99', '-O3', '-fno-tree-loop-vectorize', '-ffp-contract=off', '-fPIC', '-shared',
    '-Wl,-Bsymbolic']
"""Those of setup.py; with -Bsymbolic the code calls its own OSQP, not the Python package's."""

NAMES = 'clipped_pinv', 'exact', 'daqp_reused', 'daqp_hierarchical', 'osqp'  # in `contenders.c`
DAQP = '0.11.0'  # the version of DAQP whose structures `contenders.c` knows


class Missing(Exception):
    """What a contender needs is not there; the message says what."""


class Compiled:
    """A contender in C; a turn of calls is timed in C."""

    rows: ClassVar = np.ctypeslib.ndpointer(np.float64, ndim=2, flags='C')

    def __init__(self, library: ctypes.CDLL, name: str, n: int) -> None:
        self._call = ctypes.cast(getattr(library, name), ctypes.c_void_p)
        self._library, self._n = library, n
        types: list[Any] = [ctypes.c_void_p, ctypes.c_size_t, self.rows]
        library.together.argtypes, library.together.restype = types, ctypes.c_int64
        flags, times = (np.ctypeslib.ndpointer(kind) for kind in (np.int8, np.int64))
        library.one_by_one.argtypes = [*types, self.rows, flags, times]
        library.one_by_one.restype = None

    def __call__(self, u: Array) -> Array | None:
        """Return the thrusts (n,) for u (m,), or None."""
        return self.one_by_one([u])[1][0]

    def together(self, wrenches: Sequence[Array]) -> int:
        """Return the time of all calls [ns]."""
        elapsed: int = self._library.together(self._call, len(wrenches), np.array(wrenches))
        return elapsed

    def one_by_one(self, wrenches: Sequence[Array]) -> tuple[list[int], list[Array | None]]:
        """Return the time of each call [ns], and the thrusts."""
        size = len(wrenches)
        thrusts, answered = np.empty((size, self._n)), np.empty(size, np.int8)
        times = np.empty(size, np.int64)
        arguments = np.array(wrenches, float), thrusts, answered, times
        self._library.one_by_one(self._call, size, *arguments)
        pairs = zip(thrusts, answered, strict=True)
        return times.tolist(), [own if good else None for own, good in pairs]


def compiled(problem: AllocationProblem) -> tuple[dict[str, Compiled], dict[str, str], str]:
    """Return the contenders for a vehicle by name, why others are missing, and facts.

    These are the compiler and its options, and the time of a call that does nothing, timed alone.
    """
    absent: dict[str, str] = {}
    with TemporaryDirectory() as folder:
        try:
            generated = ['-DWITH_OSQP', *osqp_code(problem, Path(folder) / 'osqp')]
        except ImportError as error:
            absent['osqp'], generated = str(error), []
        try:
            library, about = _build(problem, generated, Path(folder))
        except Missing as error:
            return {}, dict.fromkeys(NAMES, str(error)), ''
    if fault := library.set_up():
        raise RuntimeError(f'ca_set_up: fault {fault}')
    try:
        _set_up_daqp(library, problem)
    except (Missing, ImportError) as error:
        absent |= dict.fromkeys(('daqp_reused', 'daqp_hierarchical'), str(error))
    calls = {name: Compiled(library, name, problem.n) for name in NAMES if name not in absent}
    times, _ = Compiled(library, 'nothing', problem.n).one_by_one([problem.center] * 1000)
    return calls, absent, f'{about}; {np.median(times):g} ns for reading the clock'


def _build(
    problem: AllocationProblem, generated: list[str], folder: Path
) -> tuple[ctypes.CDLL, str]:
    """Compile; return the library, and the compiler and its options in words."""
    compiler = next(filter(None, map(which, COMPILERS)), None)
    if compiler is None:
        raise Missing('no C compiler')
    (folder / 'data.h').write_text(header(problem, 'double'), encoding='utf-8')
    library = folder / 'contenders.so'
    sources = [str(path) for path in KERNEL.glob('*.c') if not path.stem.endswith('module')]
    sizes = [f'-DCA_N={problem.n}', f'-DCA_M={len(problem.axes)}', '-DCA_FIXED']
    parts = [*sizes, f'-I{folder}', f'-I{KERNEL}', str(SOURCE), *sources, *generated]
    done = subprocess.run(
        [compiler, *OPTIONS, *parts, '-lm', '-o', str(library)], capture_output=True, text=True,
        check=False,
    )
    if done.returncode:
        raise Missing(f'{compiler}: {(done.stderr.strip().splitlines() or ["failed"])[0]}')
    named = subprocess.run([compiler, '--version'], capture_output=True, text=True, check=True)
    return ctypes.CDLL(str(library)), f'{named.stdout.splitlines()[0]}; {" ".join(OPTIONS[:4])}'


def _set_up_daqp(library: ctypes.CDLL, problem: AllocationProblem) -> None:
    daqp: Any = import_module('daqp')
    if version('daqp') != DAQP:
        raise Missing(f'known is the library of daqp {DAQP}, found {version("daqp")}')
    try:
        inside = ctypes.CDLL(daqp.__file__)
        names = ('setup_daqp', 'daqp_update_ldp', 'daqp_solve')
        functions = [ctypes.cast(getattr(inside, name), ctypes.c_void_p) for name in names]
    except (AttributeError, OSError) as error:
        raise Missing(f'daqp: {error}') from None
    if library.set_up_daqp(*functions, problem.center.ctypes.data_as(ctypes.c_void_p)) <= 0:
        raise Missing('setup_daqp failed')
