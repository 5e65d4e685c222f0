"""Numbers and tables as C99 initialisers that keep every bit."""

import re
from collections.abc import Iterable, Mapping
from numbers import Integral
from textwrap import fill
from typing import Any

import numpy as np

from ca_ros.firmware.firmware import Fields, Firmware
from ca_ros.kernel import AXES_MAX, ROTORS_MAX

WIDTH = 98


def literal(value: Any, precision: str) -> str:
    """Return an initialiser: an integer, a number of the kernel's type ca_real, or a row of them.

    The numbers are of a precision, 'single' or 'double'.
    """
    if isinstance(value, tuple | list | np.ndarray):
        return f'{{{", ".join(literal(each, precision) for each in value)}}}'
    if isinstance(value, Integral):
        return str(int(value))
    # The macros of C are of single precision.
    cast = '(double)' if precision == 'double' else ''
    if value != value:
        return f'{cast}NAN'
    if abs(value) == float('inf'):
        return f'{"-" if value < 0 else ""}{cast}INFINITY'
    text = re.sub(r'\.?0*p', 'p', float(value).hex())
    return f'{text}f' if precision == 'single' else text


def indented(text: str, depth: int = 1) -> str:
    """Return an initialiser as lines of code."""
    first = ' ' * 4 * depth
    return fill(
        text, WIDTH, initial_indent=first, subsequent_indent=f'{first}    ',
        break_long_words=False, break_on_hyphens=False,
    )


def rows(values: Iterable[Any], precision: str, depth: int = 1) -> str:
    """Return the initialisers of the elements of an array, each on lines of its own."""
    return '\n'.join(indented(f'{literal(value, precision)},', depth) for value in values)


def problems(firmware: Firmware) -> str:
    """Return the initialisers of the problems, one for each fault."""
    return '\n'.join(
        f'    {{ /* {fault.meaning} */\n{_problem(firmware, given)}\n    }},'
        for fault, given in zip(firmware.faults, firmware.constants, strict=True)
    )


def _problem(firmware: Firmware, given: Fields) -> str:
    sizes = {'M': (AXES_MAX, len(firmware.problem.axes)), 'N': (ROTORS_MAX, firmware.problem.n)}
    arrays = {}
    for name, (kind, dimensions, numbers) in given.items():
        letters = re.findall(r'\[CA_([MN])\]', dimensions)
        array = np.reshape(numbers, [sizes[letter][0] for letter in letters])
        array = array[tuple(slice(sizes[letter][1]) for letter in letters)]
        arrays[name] = array.astype(int if kind == 'int' else float)
    return fields(arrays, firmware.precision, 2)


def fields(arrays: Mapping[str, np.ndarray], precision: str, depth: int = 1) -> str:
    """Return the initialisers of the fields of a structure: numbers, arrays and matrices.

    They are in the order of the structure, without designators, which C++17 does not have.
    """
    space, lines = ' ' * 4 * depth, []
    for name, array in arrays.items():
        if array.ndim < 2:
            lines.append(indented(f'/* {name} */ {literal(array[()], precision)},', depth))
        else:
            table = rows(array, precision, depth + 1)
            lines.append(f'{space}/* {name} */ {{\n{table}\n{space}}},')
    return '\n'.join(lines)
