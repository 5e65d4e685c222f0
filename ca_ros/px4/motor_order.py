"""Rotor speeds as PX4 takes them: checked, and in the order of its motors."""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError
from ca_ros.vehicle.vehicle import Vehicle


def order_of(numbers: Numbers, n: int) -> list[int]:
    """Return the setting `px4.order` as numbers from 1; empty: the order of the vehicle.

    Raises a ParameterError if it does not have each rotor once.
    """
    order = np.ravel(np.asarray(numbers, dtype=float)).tolist()
    if order == [0.0]:
        return []
    if sorted(order) != list(range(1, n + 1)):
        raise ParameterError(f'px4.order: expected each of the rotors 1 to {n} once: {order}')
    return [int(number) for number in order]


def ordered(values: Array, order: Sequence[int]) -> Array:
    """Return values (n,) of the rotors in the order of the motors.

    `values` (n,).  `order`: for each motor the rotor that it is, from 1; empty: the same order.
    """
    return values[np.array(order) - 1] if order else values


def sound_speeds(speeds: Sequence[float] | Array, vehicle: Vehicle) -> Array:
    """Return rotor speeds as an array (n,) [rad/s].

    Raises a ValueError if there is not one speed for each rotor, at rest or within its bounds at
    the highest voltage.
    """
    found = np.asarray(speeds, dtype=float)
    if found.shape != (vehicle.n,):
        raise ValueError(f'{len(found)} rotor speeds for {vehicle.n} rotors')
    low, high = vehicle.rated_speeds
    if not ((found >= np.minimum(low, 0.0)) & (found <= high)).all():
        raise ValueError(f'rotor speeds out of bounds: {found} rad/s')
    return found
