"""Positions and axes of rotors from the settings of a vehicle.

A `ParameterError` names the setting whose value has a wrong shape.
"""

from math import cos, floor, sin, tau

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError
from ca_ros.vehicle.settings import RingSettings, RotorSettings


def rotor_positions(rotors: RotorSettings) -> Array:
    """Return the positions (n, 3) of the rotors in the body frame [m]."""
    if rotors.ring.count:
        return ring(rotors.ring)
    return _rows('rotors.positions', rotors.positions)


def ring(settings: RingSettings) -> Array:
    """Return the positions (n, 3) of rotors on a ring [m]."""
    n = settings.count
    circle = [direction(settings.first_angle, i, n) for i in range(n)]
    # No -0.0.
    return np.column_stack([settings.radius * np.array(circle), np.full(n, settings.height)]) + 0.0


def direction(first: float, i: int, n: int) -> tuple[float, float]:
    """Return cosine and sine of ``first + 360 i / n`` degrees; mirrored angles have equal digits.

    The distance from the nearest quarter turn is counted in n-ths of a degree, which are exact.
    """
    before = floor(first / 90.0 + 0.5)
    whole, part = divmod(360 * i, 90 * n)
    rest = part + (first - 90.0 * before) * n
    more = floor(rest / (90 * n) + 0.5)
    rest -= more * 90 * n
    size = abs(rest) / (360 * n)
    c, s = cos(tau * size), sin(tau * size)
    if 12.0 * abs(rest) == 360 * n:
        s = 0.5
    elif 8.0 * abs(rest) == 360 * n:
        s = c
    if rest < 0.0:
        s = -s
    return ((c, s), (-s, c), (-c, -s), (s, -c))[(before + whole + more) % 4]


def rotor_axes(rotors: RotorSettings, n: int) -> Array:
    """Return the directions (n, 3) of the rotors' thrusts, unit vectors."""
    axes = _rows('rotors.axes', rotors.axes)
    if len(axes) not in (1, n):
        raise ParameterError(f'rotors.axes: expected 3 or {3 * n} numbers, got {axes.size}')
    lengths = np.linalg.norm(axes, axis=1)
    if not np.all(lengths > 0.0):
        raise ParameterError('rotors.axes: an axis has length zero')
    return np.broadcast_to(axes / lengths[:, None], (n, 3))


def _rows(name: str, value: Numbers) -> Array:
    array = np.asarray(value, dtype=float)
    if array.ndim != 1 or array.size == 0 or array.size % 3:
        raise ParameterError(f'{name}: expected x, y, z per rotor, got {array.size} numbers')
    return array.reshape(-1, 3)
