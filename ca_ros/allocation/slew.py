"""Slew limits: allocation within bounds that move with the last command."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation import make_allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array, constant
from ca_ros.problem.audit import accept
from ca_ros.problem.numbers import numbers
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem, problem_of
from ca_ros.vehicle.vehicle import Vehicle


class SlewLimited:
    """An allocation method whose effectors change no faster than given rates.

    The bounds of each call are the bounds of the problem, narrowed to what the effectors can reach
    from the last command.  Within them the method is as exact as it is without rates.  The result
    depends on the last command, which is its attribute `last`.

    Parameters
    ----------
    method : str
        A name in `ca_ros.ALLOCATORS`.
    vehicle : Vehicle or AllocationProblem
        A vehicle is audited, as in `make_allocator`.
    rates : float or (n,) array
        Greatest rate of change, positive: of the rotor speeds of a vehicle [rad/s^2], or of the
        effectors of a problem, in their units per second.
    **options
        Keyword arguments of the method's class.

    Raises
    ------
    ValueError
        If the rates are not positive, or as in `make_allocator`.

    Examples
    --------
    >>> slow = SlewLimited('exact', Vehicle.load('hexarotor'), rates=2000.0)
    >>> hover = np.full(6, 255.7)
    >>> slow.allocate([12.0, 0.2, 0.0, 0.0], hover, period=0.01).speeds.round(1)
    array([275.7, 275.7, 275.7, 275.7, 253.9, 253.9])
    """

    def __init__(
        self, method: str, vehicle: Vehicle | AllocationProblem, rates: ArrayLike, **options: Any
    ) -> None:
        problem = accept(vehicle).problem if isinstance(vehicle, Vehicle) else problem_of(vehicle)
        self.method, self.problem, self.options = method, problem, options
        self.rates = constant(numbers('rates', rates, problem.n))
        if not np.all(self.rates > 0.0):
            raise ValueError(f'rates: expected positive numbers, got {rates!r}')
        # A wrong option is an error now, not at the first command.
        make_allocator(method, problem, **options)

    def allocate(self, u: ArrayLike, last: ArrayLike, period: float) -> Allocation:
        """Allocate one wrench.

        Parameters
        ----------
        u : (m,) array
            As in `Allocator.allocate`.
        last : (n,) array
            The last command: rotor speeds of a vehicle [rad/s], or effectors.  Beyond a bound it
            counts as the bound.
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
        command = constant(numbers('last', last, self.problem.n))
        seconds = float(numbers('period', period))
        if seconds < 0.0:
            raise ValueError(f'period: expected a time from 0 on [s], got {period!r}')
        moved = self._reachable(command, self.rates * seconds)
        if moved.spans:
            result = make_allocator(self.method, moved, **self.options).allocate(u)
        else:
            result = _held(moved, u)
        result.__dict__['last'] = command
        return result

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
