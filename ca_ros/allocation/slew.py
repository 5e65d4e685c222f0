"""Slew limits: allocation within bounds that move with the last command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array, constant
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.validation import numbers


class SlewLimited(Allocator):
    """An allocator whose effectors change no faster than given rates.

    The bounds of each call are the bounds of the problem, narrowed to what the effectors can reach
    from the last command.  Within them the method is as exact as it is without rates.  The result
    depends on the last command, which is its attribute `last`.

    Parameters
    ----------
    allocator : Allocator
        The method, with its problem and settings.
    rates : float or (n,) array
        Greatest rate of change, positive: of the rotor speeds of a vehicle [rad/s^2], or of the
        effectors of a problem, in their units per second.

    Raises
    ------
    ValueError
        If the rates are not positive.

    Examples
    --------
    >>> slow = SlewLimited(Exact(Vehicle.load('hexarotor')), rates=2000.0)
    >>> hover = np.full(6, 255.7)
    >>> slow.allocate([12.0, 0.2, 0.0, 0.0], hover, period=0.01).speeds.round(1)
    array([275.7, 275.7, 275.7, 275.7, 253.9, 253.9])
    """

    def __init__(self, allocator: Allocator, rates: ArrayLike) -> None:
        self.allocator, self.problem = allocator, allocator.problem
        self.settings, self.engine = allocator.settings, allocator.engine
        self.rates = constant(numbers('rates', rates, self.problem.n))
        if not np.all(self.rates > 0.0):
            raise ValueError(f'rates: expected positive numbers, got {rates!r}')

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
            Its `problem` has the bounds of this call.

        Raises
        ------
        ValueError
            If an argument is not finite, or has a wrong shape, or `period` is negative.
        """
        if last is None:
            return self.allocator.allocate(u)
        command = constant(numbers('last', last, self.problem.n))
        seconds = float(numbers('period', period))
        if seconds < 0.0:
            raise ValueError(f'period: expected a time from 0 on [s], got {period!r}')
        moved = self._reachable(command, self.rates * seconds)
        if moved.has_volume:
            result = type(self.allocator).made(moved, self.settings).allocate(u)
        else:
            result = _held(moved, u)
        return replace(result, last=command)

    def _allocate(self, u: Array) -> Allocation:
        return self.allocate(u)

    def _reachable(self, last: Array, change: Array) -> AllocationProblem:
        """Return the problem with the bounds that are at most `change` from the last command."""
        problem = self.problem
        if isinstance(problem, VehicleProblem):
            vehicle = problem.vehicle
            lower, upper = _narrowed(vehicle.speed_min, vehicle.speed_max, last, change)
            return VehicleProblem(replace(vehicle, speed_min=lower, speed_max=upper))
        lower, upper = _narrowed(problem.lower, problem.upper, last, change)
        return problem.bounded(lower, upper)


def _held(problem: AllocationProblem, u: ArrayLike) -> Allocation:
    """Return the allocation of effectors that cannot move."""
    demand, thrusts = problem.check(u), problem.clip(problem.middle)
    exact = problem.is_exact(demand, thrusts)
    return Allocation(problem, demand, thrusts, Status.EXACT if exact else Status.INEXACT)


def _narrowed(lower: Array, upper: Array, last: Array, change: Array) -> tuple[Array, Array]:
    start = np.minimum(np.maximum(last, lower), upper)
    return np.maximum(start - change, lower), np.minimum(start + change, upper)
