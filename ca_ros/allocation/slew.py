"""Slew limits: allocation within bounds that move with the last command."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array, constant
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.validation import ABSURD, numbers


class SlewLimited(Allocator):
    """An allocator whose effectors change no faster than given rates.

    The bounds of each call are the bounds of the problem, narrowed to what the effectors can reach
    from the last command (`Allocator.allocate_within`).  Within them the method is as exact as it
    is without rates.  The result depends on the last command too.

    Parameters
    ----------
    allocator : Allocator
        The method, with its problem and settings.
    rates : float or (n,) array, optional
        Greatest rates at which effectors grow in size, positive: of the rotor speeds of a vehicle
        [rad/s^2], or of the effectors of a problem, in their units per second.  By default
        ``rotors.acceleration_max`` of the vehicle.
    braking : float or (n,) array, optional
        Greatest rates at which they shrink; by default as `rates`, or if those are not given
        ``rotors.deceleration_max`` of the vehicle.

    Raises
    ------
    ValueError
        If the rates are not positive, or there are none.

    Examples
    --------
    >>> slow = SlewLimited(Exact(Vehicle.load('hexarotor')), rates=2000.0)
    >>> hover = np.full(6, 255.7)
    >>> slow.allocate([12.0, 0.2, 0.0, 0.0], hover, period=0.01).speeds.round(1)
    array([275.7, 275.7, 275.7, 275.7, 253.9, 253.9])
    """

    def __init__(
        self, allocator: Allocator, rates: ArrayLike | None = None,
        braking: ArrayLike | None = None,
    ) -> None:
        if not isinstance(allocator, Allocator):
            raise TypeError(f'expected an Allocator, such as Exact(vehicle), got {allocator!r}')
        self.allocator, self.problem = allocator, allocator.problem
        self.settings, self.engine = allocator.settings, allocator.engine
        self.problem.program.refuse_vectors('SlewLimited', 'TiltLimited takes these')
        if rates is None:
            if (found := self.problem.rates) is None:
                raise ValueError('rates: the vehicle has no rotors.acceleration_max; give rates')
            rates, braking = found
        self.rates, self.braking = (
            constant(numbers(name, given, self.problem.n)) for name, given in (
                ('rates', rates), ('braking', rates if braking is None else braking)
            )
        )
        for name, each in (('rates', self.rates), ('braking', self.braking)):
            if not np.all(each > 0.0):
                raise ValueError(f'{name}: expected positive numbers, got {each.tolist()!r}')

    def __repr__(self) -> str:
        """Return what the allocator is, behind the name of the class."""
        return f'{type(self).__name__}: {self.allocator!r}'

    def allocate(
        self, u: ArrayLike, last: ArrayLike | None = None, period: float = 0.0
    ) -> Allocation:
        """Allocate one wrench.

        Parameters
        ----------
        u : (m,) array
            As in `Allocator.allocate`.
        last : (n,) array, optional
            The last command: rotor speeds of a vehicle [rad/s], or effectors.  Beyond a bound it
            counts as the bound.  Without it, the rates do not limit the answer.
        period : float
            Time since the last command, not negative [s].  If it is too short for any change, the
            last command is held.

        Returns
        -------
        Allocation
            With the `bounds` of this call.

        Raises
        ------
        ValueError
            If an argument is not finite, or has a wrong shape, or `period` is negative.
        """
        if last is None:
            return self.allocator.allocate(u)
        command = numbers('last', last, self.problem.n)
        # The check of a number takes longer than a comparison.
        sound = type(period) is float and 0.0 <= period <= ABSURD
        seconds = period if sound else float(numbers('period', period))
        if seconds < 0.0:
            raise ValueError(f'period: expected a time from 0 on [s], got {period!r}')
        return self.allocator.allocate_within(u, *self.reachable(command, seconds))

    def _for(self, problem: AllocationProblem) -> Allocator:
        return type(self)(self.allocator._for(problem), self.rates, self.braking)

    def _allocate(self, u: Array) -> Allocation:
        return self.allocate(u)

    def allocate_after(self, u: ArrayLike, command: Array, period: float) -> Allocation:
        """Allocate one wrench a period [s] after a command (n,)."""
        return self.allocate(u, command, period)

    def reachable(self, last: Array, period: float) -> tuple[Array, Array]:
        """Return the bounds (n,) of the effectors [N] that are reached from the last command."""
        limits = self.problem.command_limits
        ends = reached(last, period, self.rates, self.braking, *limits)
        least, greatest = self.problem.commanded(np.array(ends))
        return least, greatest


def reached(
    last: Array, period: Any, up: Array, down: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return the least and greatest values (n,) that are reached in a period [s], within bounds.

    `up` is the greatest rate at which a value grows in size, and `down` at which it shrinks, (n,).
    The kernel computes the same bits (`ca_reach`), in the precision of the arrays.
    """
    start = np.minimum(np.maximum(last, low), high)
    return (
        np.maximum(_slowed(start, period, up, down), low),
        np.minimum(-_slowed(-start, period, up, down), high),
    )


def _slowed(start: Array, period: Any, up: Array, down: Array) -> Array:
    """Return the least values (n,); past zero they grow again, in the other direction."""
    change = down * period
    beyond = -up * (period - start / down)
    braked = np.where(change <= start, start - change, beyond)
    return np.where(start <= 0.0, start - up * period, braked)
