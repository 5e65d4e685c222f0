"""An allocator within the rates of its vehicle."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator, AtRest
from ca_ros.allocation.exact import Exact
from ca_ros.allocation.reduced import Reduced
from ca_ros.allocation.result import Allocation
from ca_ros.allocation.slew import SlewLimited
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.arrays import Array
from ca_ros.problem.vehicle_problem import vehicle_of
from ca_ros.settings import ParameterError

PERIOD_MAX = 0.1  # greatest time since the last command in which rotors count as moving [s]

UNLIMITED = 1e9  # a rate that does not limit [rad/s^2, rad/s]


class WithinRates:
    """Allocates wrenches one after the other, within what the rotors reach, if there are rates.

    Raises a ParameterError if rotors tilt and the method is not `exact`: no other one keeps their
    rates.

    - `allocator`: the method
    """

    def __init__(self, allocator: Allocator) -> None:
        self.allocator, self._limited = allocator, limited(allocator)

    def allocate(self, u: ArrayLike, last: Array, time: int, before: int) -> Allocation:
        """Allocate a wrench within what the rotors reach from the last command on.

        - `u` (m,)
        - `last` (n + k,): the last command [rad/s], and the angles of servos behind it [rad]
        - `time` and `before`: stamps of this command and the last one [ns].  The time between them
          counts up to `PERIOD_MAX`, and not at all if it is negative
        """
        if self._limited is None:
            return self.allocator.allocate(u)
        period = min(max(time - before, 0) / 1e9, PERIOD_MAX)
        return self._limited.allocate_after(u, last, period)


def limited(
    allocator: Allocator, rates: ArrayLike | None = None, braking: ArrayLike | None = None
) -> SlewLimited | TiltLimited | Reduced | None:
    """Return what allocates within the rates of a vehicle; None if it has none.

    `rates`, `braking`: of the rotors, instead of those of the vehicle.
    """
    if isinstance(allocator, Reduced):
        inner = limited(allocator.method, rates, braking)
        return inner and allocator.within(inner)
    pair: Any = allocator.problem.rates
    if rates is not None:
        pair = rates, rates if braking is None else braking
    turning = allocator.problem.turning_rates
    if isinstance(allocator, AtRest) or (pair is None and not turning.any()):
        return None
    if not len(turning):
        return SlewLimited(allocator, *(pair or ()))
    if not isinstance(allocator, Exact):
        raise ParameterError(
            f'rotors.acceleration_max, rotors.tilt_rate_max: {type(allocator).__name__} does not '
            'keep the rates of rotors that tilt; exact does'
        )
    up, down = (UNLIMITED, UNLIMITED) if pair is None else pair
    turning = np.where(turning > 0.0, turning, UNLIMITED)
    return TiltLimited(vehicle_of(allocator.problem), up, turning, allocator.settings, down)
