"""An allocator within the rates of its vehicle."""

from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array

PERIOD_MAX = 0.1  # greatest time since the last command in which rotors count as moving [s]


class WithinRates:
    """Allocates wrenches one after the other, within what the rotors reach, if there are rates.

    Raises a ParameterError if rotors tilt and the method is not `exact`: no other one keeps their
    rates.

    - `allocator`: the method
    """

    def __init__(self, allocator: Allocator) -> None:
        self.allocator, self._limited = allocator, allocator.limited()

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
