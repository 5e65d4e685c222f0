"""What stands in for every method when all rotors are lost."""

from __future__ import annotations

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array


class Powerless(Allocator):
    """Answers every wrench with rotors at rest, as INEXACT: no wrench can be given.

    Parameters
    ----------
    vehicle : Vehicle
        All of whose rotors are lost.
    """

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self.problem.lower.copy()
        return Allocation(self.problem, u, thrusts, Status.INEXACT, level=0.0)
