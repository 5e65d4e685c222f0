"""Checks of what a detector of failures is given."""

from math import hypot
from operator import index

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.vehicle.state import STATE_MAX

TIME_MAX = 2**62
"""Times are less [ns], before and after zero, so that their differences have 64 bits."""


def moment_of(time: int) -> int:
    """Return a time [ns]; raise a ValueError if it is out of bounds, a TypeError if not whole."""
    try:
        moment = index(time)
    except TypeError:
        raise TypeError(
            f'time {time}: expected whole nanoseconds, such as int(1e9 * seconds)') from None
    if not -TIME_MAX < moment < TIME_MAX:
        raise ValueError(f'time {time}: expected a number of nanoseconds below 2**62')
    return moment


def numbers_of(name: str, given: ArrayLike, count: int) -> Array:
    """Return numbers (count,); raise a ValueError if there is another number of them."""
    try:
        found = np.asarray(given, float)
    except (TypeError, ValueError):
        found = np.zeros(())
    if found.shape != (count,):
        raise ValueError(f'{name} {given!s}: expected {count} numbers')
    return found


def state_of(
    attitude: ArrayLike, velocity: ArrayLike, angular_velocity: ArrayLike
) -> tuple[Array, Array]:
    """Return an attitude (4,) and a motion (6,); raise a ValueError if they are none."""
    attitude = numbers_of('attitude', attitude, 4)
    motion = np.concatenate([
        numbers_of('velocity', velocity, 3),
        numbers_of('angular velocity', angular_velocity, 3)])
    numbers = attitude.tolist(), motion.tolist()
    sound = hypot(*numbers[0]) >= 1.0 / STATE_MAX
    if not (sound and all(abs(x) <= STATE_MAX for part in numbers for x in part)):
        raise ValueError(
            f'attitude {attitude}, velocities {velocity!s} and {angular_velocity!s}: expected '
            'a quaternion that is not zero, and numbers up to 1e9'
        )
    return attitude, motion


def force_of(specific_force: ArrayLike | None) -> Array | None:
    """Return a specific force (3,), or None; raise a ValueError if it is none."""
    if specific_force is None:
        return None
    force = numbers_of('specific force', specific_force, 3)
    if not (abs(force) <= STATE_MAX).all():
        raise ValueError(f'specific force {force}: expected three numbers up to 1e9')
    return force
