"""The arrays of a vehicle from its settings.

Each function raises a `ParameterError` that names the setting whose value has a wrong shape or
contradicts another one.
"""

from __future__ import annotations

from fractions import Fraction
from math import cos, sin, tau

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError, repeated
from ca_ros.vehicle.settings import (
    AXES,
    AxesSettings,
    BodySettings,
    MovingBodySettings,
    RingSettings,
    RotorSettings,
)


def arms(body: BodySettings, rotors: RotorSettings) -> Array:
    """Return the positions (n, 3) of the rotors relative to the centre of mass [m]."""
    positions = (
        ring(rotors.ring) if rotors.ring.count else _rows('rotors.positions', rotors.positions)
    )
    return positions - np.array(body.center_of_mass, float)


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
        raise ParameterError(
            f'rotors.axes: expected 3 or {3 * n} numbers for {n} rotors, got {axes.size}'
        )
    lengths = np.linalg.norm(axes, axis=1)
    if not np.all(lengths > 0.0):
        raise ParameterError('rotors.axes: an axis has length zero')
    return np.broadcast_to(axes / lengths[:, None], (n, 3))


def spins(rotors: RotorSettings, n: int) -> Array:
    """Return the signs (n,) of the rotors' reaction torques, Eq. (2)."""
    words = rotors.spins
    if isinstance(words, str) or len(words) != n:
        raise ParameterError(f'rotors.spins: expected {n} words, one per rotor, got {words!r}')
    return np.array([1.0 if word == 'cw' else -1.0 for word in words])


def speed_bounds(rotors: RotorSettings, n: int) -> tuple[Array, Array]:
    """Return the lower and upper bounds (n,) of the rotor speeds [rad/s]."""
    low = repeated('rotors.speed_min', rotors.speed_min, n)
    high = repeated('rotors.speed_max', rotors.speed_max, n)
    if np.any(low > high):
        i = int(np.argmax(low > high))
        raise ParameterError(
            f'rotors.speed_min: {low[i]:g} rad/s of rotor {i + 1} is above its '
            f'rotors.speed_max, {high[i]:g} rad/s'
        )
    return low, high


def reverse_coefficients(rotors: RotorSettings, n: int) -> Array:
    """Return k_f (n,) of rotors that turn backwards [kg m]."""
    name = 'rotors.thrust_coefficient'
    given = repeated(f'{name}_reverse', rotors.thrust_coefficient_reverse, n)
    return np.where(given > 0.0, given, repeated(name, rotors.thrust_coefficient, n))


def inertia(body: MovingBodySettings) -> Array:
    """Return the inertia matrix (3, 3), one that a body can have [kg m^2]."""
    numbers = np.asarray(body.inertia, dtype=float)
    matrix = np.diag(numbers) if numbers.size == 3 else numbers.reshape(3, 3)
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ParameterError('vehicle.inertia: the matrix is not symmetric')
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0:
        raise ParameterError(
            f'vehicle.inertia: must be positive definite, got a principal moment of '
            f'{moments[0]:g} kg m^2'
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ParameterError(
            f'vehicle.inertia: no body has the principal moments {moments}: '
            f'the greatest exceeds the sum of the others'
        )
    return matrix


def commanded_axes(settings: AxesSettings) -> tuple[str, ...]:
    """Return the components of the wrench that are commanded, in the order of `AXES`."""
    return tuple(axis for axis in AXES if axis in settings.axes)


def _rows(name: str, value: Numbers) -> Array:
    array = np.asarray(value, dtype=float)
    if array.ndim != 1 or array.size == 0 or array.size % 3:
        raise ParameterError(f'{name}: expected x, y, z per rotor, got {array.size} numbers')
    return array.reshape(-1, 3)
