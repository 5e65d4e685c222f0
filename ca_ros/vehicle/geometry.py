"""Positions and axes of rotors from the settings of a vehicle.

A `ParameterError` names the setting whose value has a wrong shape.
"""

from __future__ import annotations

from fractions import Fraction
from math import cos, sin, tau

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
    first = Fraction(settings.first_angle) / 360
    turns = [first + Fraction(i, settings.count) for i in range(settings.count)]
    circle = settings.radius * np.array([direction(turn) for turn in turns])
    # No -0.0.
    return np.column_stack([circle, np.full(len(turns), settings.height)]) + 0.0


def direction(turn: Fraction) -> tuple[float, float]:
    """Return cosine and sine of an angle in turns; mirrored angles give the same digits."""
    quarters = round(4 * turn)
    rest = turn - Fraction(quarters, 4)
    c, s = cos(tau * abs(rest)), sin(tau * abs(rest))
    if abs(rest) == Fraction(1, 12):
        s = 0.5
    elif abs(rest) == Fraction(1, 8):
        s = c
    if rest < 0:
        s = -s
    return ((c, s), (-s, c), (-c, -s), (s, -c))[quarters % 4]


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
