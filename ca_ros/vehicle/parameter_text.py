"""The text of a parameter file from values."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

UNITS = {
    'mass': 'kg', 'inertia': 'kg m^2', 'positions': 'm', 'thrust_coefficient': 'kg m',
    'torque_coefficient': 'kg m^2', 'speed_min': 'rad/s', 'speed_max': 'rad/s',
    'tilt_min': 'rad', 'tilt_max': 'rad',
}


def parameter_text(groups: Mapping[str, Any], title: str = '', digits: int = 9) -> str:
    """Return the text of a parameter file.

    `groups`: by name the values of each group, numbers in SI units, words, several of them, or
    mappings of these; None is left out.  `title`: a comment.  `digits`: of the numbers.
    """
    words = [f'# {line}' for line in title.splitlines()]
    return '\n'.join([*words, '/**:', '  ros__parameters:', *_lines(groups, digits, ' ' * 4), ''])


def _lines(values: Mapping[str, Any], digits: int, indent: str) -> Iterator[str]:
    """Yield the lines of values, and of mappings below them."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield f'{indent}{name}:'
            yield from _lines(value, digits, f'{indent}  ')
        elif value is not None:
            unit = f'  # [{UNITS[name]}]' if name in UNITS else ''
            yield f'{indent}{name}: {_written(value, digits)}{unit}'


def _written(value: Any, digits: int) -> str:
    """Return a value in YAML: rows of a matrix one a line, numbers with so many digits."""
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in 'iuf':
        return f'[{", ".join(value)}]'
    rows = [
        ', '.join(repr(float(f'{number:.{digits}g}') + 0.0) for number in row)
        for row in np.atleast_2d(array).tolist()
    ]
    text = f',{chr(10)}                  '.join(rows)
    return f'[{text}]' if array.ndim else text
