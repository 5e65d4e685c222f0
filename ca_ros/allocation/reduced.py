"""A method for some of the axes of a problem: those that failures have left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator, AtRest
from ca_ros.allocation.explanation import Explanation
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.arrays import Array
from ca_ros.problem.audit import Audit, accept, audit
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import vehicle_of


def allocator_for(kind: type[Allocator], report: Audit, settings: Any) -> Allocator:
    """Return the allocator of a class for what an audit left, with its `independent` axes."""
    problem = report.independent
    if problem.vehicle.powerless:
        # The settings must suit the rotors when they return.
        kind(accept(problem.vehicle.with_health(1.0), 'drop').independent, settings)
        return AtRest(problem)
    part, suited = kind.suited(report, settings)
    method = kind(part, suited)
    return method if part is problem else Reduced(problem, method, part.axes, settings)


def after_failures(kind: type[Allocator], report: Audit, settings: Any) -> Allocator:
    """Return the same with all axes of the vehicle; see `Allocator.with_health`."""
    full, method = report.full, allocator_for(kind, report, settings)
    sound = method.problem.axes == full.axes and not report.lost
    return method if sound else Failed(report, kind, method, settings)


class Reduced(Allocator):
    """Takes demands for all axes of a problem, and gives some of them to a method.

    Other axes get what the method's thrusts produce there.  An answer is EXACT only if all axes
    are met.  Where the method is exact and an axis that it does not have is missed, the answer is
    PRIORITIZED if the method serves axes by priorities, else INEXACT.

    - `problem`: of all axes
    - `method`: what answers, with the problem of `axes`
    """

    takes_vectors = True

    def __init__(
        self, problem: AllocationProblem, method: Any, axes: Sequence[str], settings: Any
    ) -> None:
        self.problem, self.method, self.settings = problem, method, settings
        self.engine = getattr(method, 'engine', 'NumPy')
        self._rows = np.array([problem.axes.index(axis) for axis in axes], dtype=int)
        by_priorities = getattr(settings, 'policy', '') == 'prioritize'
        self._missed = Status.PRIORITIZED if by_priorities else Status.INEXACT

    def _allocate(self, u: Array) -> Allocation:
        return self._whole(self.method.allocate(u[self._rows]), u)

    def allocate_within(self, u: ArrayLike, lower: Array, upper: Array) -> Allocation:
        """Allocate one wrench within narrower bounds; see `Allocator.allocate_within`."""
        demand = self.problem.check(u)
        return self._whole(self.method.allocate_within(demand[self._rows], lower, upper), demand)

    def allocate_after(self, u: ArrayLike, command: Array, period: float) -> Allocation:
        """Allocate one wrench a period [s] after a command (n + k,), of a method within rates."""
        demand = self.problem.check(u)
        return self._whole(self.method.allocate_after(demand[self._rows], command, period), demand)

    def _allocate_batch(self, demands: Array) -> AllocationBatch:
        found = self.method.allocate_batch(demands[:, self._rows])
        exact = self.problem.is_exact(demands, found.thrusts)
        status = np.where(
            exact, np.int8(Status.EXACT),
            np.where(found.status == Status.EXACT, np.int8(self._missed), found.status))
        return replace(
            found, problem=self.problem, demand=demands, status=status.astype(np.int8))

    def _whole(self, answer: Allocation, u: Array) -> Allocation:
        """Return the answer for all axes of the demand (m,)."""
        status = answer.status
        if self.problem.is_exact(u, answer.thrusts):
            status = Status.EXACT
        elif status is Status.EXACT:
            status = self._missed
        return replace(
            answer, problem=self.problem, demand=u, status=status,
            _explain=lambda whole: self._explained(answer, whole))

    def _explained(self, answer: Allocation, whole: Allocation) -> Explanation:
        """Return the explanation of an answer with rows for all axes; NaN for those left out."""
        part, m = answer.explanation, len(self.problem.axes)

        def spread(rows: Any, rest: float) -> Any:
            full = np.full((m, *rows.shape[1:]), rest, dtype=rows.dtype)
            full[self._rows] = rows
            return full

        others = ['the failures, which leave the axis uncontrollable'] * m
        for row, words in zip(self._rows.tolist(), part.others, strict=True):
            others[row] = words
        return replace(
            part, problem=self.problem, demand=whole.demand, others=others,
            served=spread(part.served, np.nan), missed=spread(part.missed, np.nan),
            blocks=spread(part.blocks, 0), gain=spread(part.gain, 0.0),
            joint_gain=spread(part.joint_gain, 0.0),
            airmode_blocks=spread(part.airmode_blocks, 0), airmode=spread(part.airmode, 0.0))


class Failed(Reduced):
    """The method of an allocator for the vehicle after failures, with all axes."""

    def __init__(
        self, report: Audit, kind: type[Allocator], method: Allocator, settings: Any
    ) -> None:
        super().__init__(report.full, method, method.problem.axes, settings)
        self._kind, self.audit = kind, report

    def _explained(self, answer: Allocation, whole: Allocation) -> Explanation:
        """Return the explanation with NaN as what was served of lost axes."""
        found = super()._explained(answer, whole)
        lost = [axis in self.audit.lost for axis in self.problem.axes]
        return replace(found, served=np.where(lost, np.nan, found.served))

    def with_health(self, health: ArrayLike) -> Allocator:
        """Return the same method for other rotor health; see `Allocator.with_health`."""
        report = audit(vehicle_of(self.problem).with_health(health))
        return after_failures(self._kind, report, self.settings)
