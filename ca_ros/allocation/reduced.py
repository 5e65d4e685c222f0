"""A method for the axes of a problem that failures have left, and its answers for all axes."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator, AtRest
from ca_ros.allocation.explanation import Explanation
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.arrays import Array
from ca_ros.problem.audit import Audit, audit
from ca_ros.problem.problem import AllocationProblem


def allocator_for(kind: type[Allocator], report: Audit, settings: Any) -> Allocator:
    """Return the allocator of a class for what an audit left, with its `independent` axes."""
    problem, method = report.independent, method_for(kind, report, settings)
    whole = method.problem.axes == problem.axes
    return method if whole else Reduced(problem, kind, method, report, settings)


def after_failures(
    kind: type[Allocator], problem: AllocationProblem, settings: Any
) -> Allocator:
    """Return the allocator of a class for all axes of a problem; see `Allocator.with_health`."""
    if not problem.failed:
        return kind(problem, settings)
    report = audit(problem)
    method = method_for(kind, report, settings)
    whole = type(method) is kind and method.problem.axes == problem.axes and not report.lost
    return method if whole else Reduced(report.full, kind, method, report, settings)


def method_for(kind: type[Allocator], report: Audit, settings: Any) -> Allocator:
    """Return the method of a class for the axes that it can serve of what an audit left."""
    if report.independent.powerless:
        # The settings must suit the effectors when they return.
        sound = report.full.with_health(np.ones_like(report.full.health), stuck={})
        kind(audit(sound).independent, settings)
        return AtRest(report.independent)
    return kind(*kind.suited(report, settings))


class Reduced(Allocator):
    """Takes demands for all axes of a problem, and gives some of them to a method.

    Other axes get what the method's thrusts produce there.  An answer is EXACT only if all axes
    are met.  Where the method is exact and an axis that it does not have is missed, the answer is
    what the method calls `missed`.

    - `problem`: of all axes
    - `kind`: the class that was asked for; `method` may be `AtRest`
    - `method`: with the problem of its axes
    - `report`: the audit that found the lost axes
    - `within`: the same within rates, if these limit the answers
    """

    takes_vectors = True

    def __init__(
        self, problem: AllocationProblem, kind: type[Allocator], method: Allocator, report: Audit,
        settings: Any, within: Any = None,
    ) -> None:
        self.problem, self.method, self.settings = problem, method, settings
        self.engine, self.missed = method.engine, method.missed
        self._kind, self.audit = kind, report
        self._answering: Any = method if within is None else within
        axes = problem.axes
        self._rows = np.array([axes.index(axis) for axis in method.problem.axes], dtype=int)

    def __repr__(self) -> str:
        """Return the line of the method, with the lost axes."""
        lost = ', '.join(self.lost_axes) or 'none'
        within = '' if self._answering is self.method else f'{type(self._answering).__name__}: '
        return within + f'{super().__repr__()}, lost axes {lost}'.replace(
            type(self).__name__, self._kind.__name__, 1)

    @property
    def lost_axes(self) -> tuple[str, ...]:
        """The axes of the problem that are lost: all of them without any effector."""
        return self.problem.axes if self.audit.independent.powerless else self.audit.lost

    def limited(self, rates: ArrayLike | None = None, braking: ArrayLike | None = None) -> Any:
        """Return this allocator with its method within rates; see `Allocator.limited`."""
        inner = self.method.limited(rates, braking)
        return inner and Reduced(
            self.problem, self._kind, self.method, self.audit, self.settings, inner)

    def allocate(self, u: ArrayLike, *last: Any, **more: Any) -> Allocation:
        """Allocate one wrench; a method within rates takes the last command, see there."""
        demand = self.problem.check(u)
        answer: Allocation = self.whole(
            self._answering.allocate(demand[self._rows], *last, **more), demand)
        return answer

    def _allocate(self, u: Array) -> Allocation:
        return self.allocate(u)

    def allocate_within(self, u: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Allocation:
        """Allocate one wrench within narrower bounds; see `Allocator.allocate_within`."""
        demand = self.problem.check(u)
        return self.whole(
            self._answering.allocate_within(demand[self._rows], lower, upper), demand)

    def allocate_after(self, u: ArrayLike, command: Array, period: float) -> Allocation:
        """Allocate one wrench a period [s] after a command (n + k,), of a method within rates."""
        demand = self.problem.check(u)
        return self.whole(
            self._answering.allocate_after(demand[self._rows], command, period), demand)

    def _allocate_batch(self, demands: Array) -> AllocationBatch:
        batch: AllocationBatch = self.whole(
            self._answering.allocate_batch(demands[:, self._rows]), demands)
        return batch

    def whole(self, answer: Any, u: Array) -> Any:
        """Return the answer for all axes of a demand (m,), or the batch for demands (N, m)."""
        exact = self.problem.is_exact(u, answer.thrusts)
        if isinstance(answer, Allocation):
            status = Status.EXACT if exact else (
                self.missed if answer.status is Status.EXACT else answer.status)
            one = Allocation(
                self.problem, u, answer.thrusts, status, answer.level, answer.violation,
                answer.preference, answer.bounds, answer.by_rate, partial(self._explained, answer))
            one.__dict__['part'] = answer
            return one
        found = np.where(answer.status == Status.EXACT, np.int8(self.missed), answer.status)
        made = AllocationBatch(
            self.problem, u, answer.thrusts,
            np.where(exact, np.int8(Status.EXACT), found).astype(np.int8),
            answer.level, answer.violation, answer.preference)
        made.__dict__.update(part=answer, maker=self)
        return made

    def _explained(self, part: Allocation, whole: Allocation) -> Explanation:
        """Return the explanation of an answer with rows for all axes; NaN for lost ones."""
        found, axes = part.explanation, self.problem.axes

        def spread(rows: Any, rest: float) -> Any:
            full = np.full((len(axes), *rows.shape[1:]), rest, dtype=rows.dtype)
            full[self._rows] = rows
            return full

        others = ['the failures, which leave the axis uncontrollable'] * len(axes)
        for row, words in zip(self._rows.tolist(), found.others, strict=True):
            others[row] = words
        lost = [axis in self.lost_axes for axis in axes]
        return replace(
            found, problem=self.problem, demand=whole.demand, others=others,
            served=np.where(lost, np.nan, spread(found.served, np.nan)),
            missed=spread(found.missed, np.nan),
            blocks=spread(found.blocks, 0), gain=spread(found.gain, 0.0),
            joint_gain=spread(found.joint_gain, 0.0),
            airmode_blocks=spread(found.airmode_blocks, 0), airmode=spread(found.airmode, 0.0))

    def _for(self, problem: AllocationProblem) -> Allocator:
        if self._answering is not self.method:
            raise TypeError('with_health: ask the allocator before within_rates')
        return after_failures(self._kind, problem, self.settings)
