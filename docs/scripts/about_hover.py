"""Direct allocation about hover: from zero it has no answer to many wrenches."""

from __future__ import annotations

from ca_ros import Allocation, AllocationProblem, Allocator, make_allocator
from ca_ros.arrays import Array


class DirectAboutHover(Allocator):
    """Direct allocation of the change from hover: it keeps the direction of this change."""

    def __init__(self, problem: object) -> None:
        super().__init__(problem)
        problem = self.problem
        self._hover = make_allocator('exact', problem).allocate(problem.hover).thrusts
        shifted = AllocationProblem(
            problem.gamma, problem.lower - self._hover, problem.upper - self._hover, problem.axes
        )
        self._direct = make_allocator('direct', shifted)

    def _allocate(self, u: Array) -> Allocation:
        change = self._direct.allocate(u - self.problem.hover).thrusts
        thrusts = self.problem.clip(self._hover + change)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))
