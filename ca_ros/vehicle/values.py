"""The arrays of a vehicle from its parameters.

Each function takes the complete parameters by name, and raises a `ParameterError` that names the
parameter whose value has a wrong shape or contradicts another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.schema import ParameterError
from ca_ros.vehicle.parameters import AXES

Parameters = Mapping[str, Any]


def per_rotor(parameters: Parameters, name: str, n: int) -> Array:
    """Return a parameter (n,) that is given once or for each rotor."""
    value = np.asarray(parameters[name], dtype=float)
    if value.size not in (1, n) or value.ndim > 1:
        raise ParameterError(f'{name}: expected 1 or {n} numbers, one per rotor, got {value.size}')
    return np.broadcast_to(value, (n,)).copy()


def arms(parameters: Parameters) -> Array:
    """Return the positions (n, 3) of the rotors relative to the centre of mass [m]."""
    center = np.asarray(parameters['vehicle.center_of_mass'], dtype=float)
    if center.shape != (3,):
        raise ParameterError(f'vehicle.center_of_mass: expected 3 numbers, got {center.size}')
    return _rows(parameters, 'rotors.positions') - center


def rotor_axes(parameters: Parameters, n: int) -> Array:
    """Return the directions (n, 3) of the rotors' thrusts, unit vectors."""
    axes = _rows(parameters, 'rotors.axes')
    if len(axes) not in (1, n):
        raise ParameterError(
            f'rotors.axes: expected 3 or {3 * n} numbers for {n} rotors, got {axes.size}'
        )
    lengths = np.linalg.norm(axes, axis=1)
    if not np.all(lengths > 0.0):
        raise ParameterError('rotors.axes: an axis has length zero')
    return np.broadcast_to(axes / lengths[:, None], (n, 3))


def spins(parameters: Parameters, n: int) -> Array:
    """Return the signs (n,) of the rotors' reaction torques, Eq. (2)."""
    words = parameters['rotors.spins']
    if not isinstance(words, list) or len(words) != n:
        raise ParameterError(f'rotors.spins: expected {n} words, one per rotor, got {words!r}')
    return np.array([1.0 if word == 'cw' else -1.0 for word in words])


def speed_bounds(parameters: Parameters, n: int) -> tuple[Array, Array]:
    """Return the lower and upper bounds (n,) of the rotor speeds [rad/s]."""
    low, high = (per_rotor(parameters, f'rotors.speed_{bound}', n) for bound in ('min', 'max'))
    if np.any(low > high):
        i = int(np.argmax(low > high))
        raise ParameterError(
            f'rotors.speed_min: {low[i]:g} rad/s of rotor {i + 1} is above its '
            f'rotors.speed_max, {high[i]:g} rad/s'
        )
    return low, high


def reverse_coefficients(parameters: Parameters, n: int) -> Array:
    """Return k_f (n,) of rotors that turn backwards [kg m]."""
    given = per_rotor(parameters, 'rotors.thrust_coefficient_reverse', n)
    return np.where(given > 0.0, given, per_rotor(parameters, 'rotors.thrust_coefficient', n))


def inertia(parameters: Parameters) -> Array:
    """Return the inertia matrix (3, 3), one that a body can have [kg m^2]."""
    numbers = np.asarray(parameters['vehicle.inertia'], dtype=float)
    if numbers.shape not in ((3,), (9,)):
        raise ParameterError(f'vehicle.inertia: expected 3 or 9 numbers, got {numbers.size}')
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


def commanded_axes(parameters: Parameters) -> tuple[str, ...]:
    """Return the components of the wrench that are commanded, in the order of `AXES`."""
    names = parameters['allocation.axes']
    if not isinstance(names, list) or len(set(names)) != len(names) or not names:
        raise ParameterError(f'allocation.axes: expected a list of different axes, got {names!r}')
    return tuple(axis for axis in AXES if axis in names)


def _rows(parameters: Parameters, name: str) -> Array:
    array = np.asarray(parameters[name], dtype=float)
    if array.ndim != 1 or array.size == 0 or array.size % 3:
        raise ParameterError(f'{name}: expected x, y, z per rotor, got {array.size} numbers')
    return array.reshape(-1, 3)
