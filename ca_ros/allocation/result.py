"""What an allocator answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from ca_ros.allocation.certificate import Certificate, certify
from ca_ros.arrays import Array, IntArray
from ca_ros.problem.problem import EXACT_TOLERANCE, AllocationProblem


class Status(IntEnum):
    """What became of the demanded wrench."""

    EXACT = 0
    """It is given, to rounding."""
    PRIORITIZED = 1
    """It is not attainable; the axes were served in the order of their priority."""
    SCALED = 2
    """It is not attainable; its direction was kept."""
    INEXACT = 3
    """The method gave something near it."""
    REJECTED = 4
    """It is not attainable and nothing is to be commanded; the thrusts are the lower bounds."""


@dataclass(frozen=True, eq=False, init=False)
class Allocation:
    """The thrusts that answer a demanded wrench; for a batch of N, each field has a leading N.

    Attributes
    ----------
    problem : AllocationProblem
    demand : (m,) array
        The wrench u that was asked for [N, N m].
    thrusts : (n,) array
        Within their bounds to the last bit [N].
    status : Status
        (N,) array of its values for a batch.
    level : float
        Share of the way to the demand that was served: alpha of Eqs. (14)-(17), 1 if the method
        knows no such share.
    violation : float
        How far the method's own answer lay outside the bounds before it was saturated [N].
    """

    problem: AllocationProblem
    demand: Array
    thrusts: Array
    status: Status | IntArray
    level: float | Array = 1.0
    violation: float | Array = 0.0

    def __init__(
        self,
        problem: AllocationProblem,
        demand: Array,
        thrusts: Array,
        status: Status | IntArray,
        level: float | Array = 1.0,
        violation: float | Array = 0.0,
    ) -> None:
        # A frozen dataclass takes three times as long to set them.
        fields = self.__dict__
        fields['problem'] = problem
        fields['demand'] = demand
        fields['thrusts'] = thrusts
        fields['status'] = status
        fields['level'] = level
        fields['violation'] = violation

    @property
    def speeds(self) -> Array:
        """Rotor speeds (n,), within their bounds to the last bit [rad/s], Eq. (11)."""
        return self.problem.vehicle.speeds(self.thrusts)

    @property
    def wrench(self) -> Array:
        """The wrench Gamma f that the thrusts give, (m,) [N, N m]."""
        return self.thrusts @ self.problem.gamma.T

    @property
    def residual(self) -> Array:
        """Demand minus wrench, (m,) [N, N m]."""
        return self.demand - self.wrench

    @property
    def saturation(self) -> IntArray:
        """Per rotor, (n,): -1 at its lower and +1 at its upper bound, to rounding; 0 between."""
        low, high = self.problem.lower, self.problem.upper
        rounding = EXACT_TOLERANCE * np.maximum(1.0, high)
        above = (self.thrusts >= high - rounding).astype(np.int8)
        return np.where(self.thrusts <= low + rounding, np.int8(-1), above)

    @cached_property
    def certificate(self) -> Certificate:
        """What proves the answer, from the problem's own data; made when it is first asked for."""
        return certify(self.problem, self.demand, self.thrusts)
