"""Numbers and tables as C99 initialisers that keep every bit."""

from __future__ import annotations

import re
from collections.abc import Iterable
from textwrap import fill

import numpy as np

from ca_ros.firmware.firmware import Fields, Firmware
from ca_ros.kernel import AXES_MAX, ROTORS_MAX

WIDTH = 98


def real(value: float, precision: str) -> str:
    """Return a number of the kernel's type ca_real."""
    if value != value:
        return 'NAN'
    if abs(value) == float('inf'):
        return 'INFINITY' if value > 0 else '-INFINITY'
    text = re.sub(r'\.?0*p', 'p', float(value).hex())
    return f'{text}f' if precision == 'single' else text


def braced(values: Iterable[float], precision: str | None = None) -> str:
    """Return the initialiser of an array: of integers, or of numbers of a precision."""
    if precision is None:
        items = [str(int(value)) for value in values]
    else:
        items = [real(value, precision) for value in values]
    return f'{{{", ".join(items)}}}'


def indented(text: str, depth: int) -> str:
    """Return an initialiser as lines of code."""
    first = ' ' * 4 * depth
    return fill(
        text, WIDTH, initial_indent=first, subsequent_indent=f'{first}    ',
        break_long_words=False, break_on_hyphens=False,
    )


def problems(firmware: Firmware) -> str:
    """Return the initialisers of the problems, one for each fault."""
    return '\n'.join(
        f'    {{ /* {fault.meaning} */\n{_problem(firmware, fields)}\n    }},'
        for fault, fields in zip(firmware.faults, firmware.constants, strict=True)
    )


def _problem(firmware: Firmware, fields: Fields) -> str:
    sizes = {'M': (AXES_MAX, len(firmware.problem.axes)), 'N': (ROTORS_MAX, firmware.problem.n)}
    lines = []
    for name, (kind, dimensions, numbers) in fields.items():
        precision = None if kind == 'int' else firmware.precision
        letters = re.findall(r'\[CA_([MN])\]', dimensions)
        array = np.reshape(numbers, [sizes[letter][0] for letter in letters])
        array = array[tuple(slice(sizes[letter][1]) for letter in letters)]
        lines.append(field(name, array, precision, 2))
    return '\n'.join(lines)


def field(name: str, array: np.ndarray, precision: str | None, depth: int) -> str:
    """Return the initialiser of a field of a structure: a number, an array or a matrix."""
    if array.ndim < 2:
        value = braced(np.atleast_1d(array), precision)
        return indented(f'.{name} = {value if array.ndim else value[1:-1]},', depth)
    rows = (indented(f'{braced(row, precision)},', depth + 1) for row in array)
    space = ' ' * 4 * depth
    return '\n'.join([f'{space}.{name} = {{', *rows, f'{space}}},'])
