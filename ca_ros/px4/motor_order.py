"""The order of the motors of PX4."""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError


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
