"""The text of a parameter file from values."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.vehicle.files import flatten, read_yaml
from ca_ros.vehicle.vehicle import Vehicle

UNITS = {
    'mass': 'kg', 'inertia': 'kg m^2', 'positions': 'm', 'thrust_coefficient': 'kg m',
    'torque_coefficient': 'kg m^2', 'speed_min': 'rad/s', 'speed_max': 'rad/s',
    'tilt_min': 'rad', 'tilt_max': 'rad',
}


def parameter_text(title: str, vehicle: Mapping[str, Any], rotors: Mapping[str, Any]) -> str:
    """Return the text of a parameter file that describes a sound vehicle.

    Raises a ParameterError if a value is wrong.

    `title`: a comment.  `vehicle` and `rotors`: values by name, in SI units; None is left out.
    """
    lines = [f'# {title}', '/**:', '  ros__parameters:']
    for group, values in (('vehicle', vehicle), ('rotors', rotors)):
        lines.append(f'    {group}:')
        for name, value in values.items():
            if value is not None:
                unit = f'  # [{UNITS[name]}]' if name in UNITS else ''
                lines.append(f'      {name}: {_written(value)}{unit}')
    text = '\n'.join(lines) + '\n'
    Vehicle.from_parameters(flatten(read_yaml(text)['/**']['ros__parameters']))
    return text


def _written(value: Any) -> str:
    """Return a value in YAML: rows of a matrix one a line, numbers with nine digits."""
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in 'iuf':
        return f'[{", ".join(value)}]'
    rows = [
        ', '.join(repr(float(f'{number:.9g}') + 0.0) for number in row)
        for row in np.atleast_2d(array).tolist()
    ]
    text = f',{chr(10)}                  '.join(rows)
    return f'[{text}]' if array.ndim else text
