"""The allocator of a vehicle that has lost all rotors."""

from __future__ import annotations

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array


class Powerless(Allocator):
    """Leaves all rotors at rest for every wrench, with the status INEXACT."""

    takes_vectors = True

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self.problem.lower.copy()
        return Allocation(self.problem, u, thrusts, Status.INEXACT, level=0.0)
