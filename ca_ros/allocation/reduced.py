"""A method for some of the axes of a problem: those that failures have left."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator, AtRest
from ca_ros.allocation.certificate import Certificate
from ca_ros.allocation.explanation import Explanation
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.arrays import Array
from ca_ros.problem.audit import Audit, audit
from ca_ros.problem.problem import AllocationProblem


def allocator_for(kind: type[Allocator], report: Audit, settings: Any) -> Allocator:
    """Return the allocator of a class for what an audit left, with its `independent` axes."""
    problem = report.independent
    if problem.powerless:
        # The settings must suit the effectors when they return.
        kind(audit(report.full.with_health(1.0)).independent, settings)
        return AtRest(problem)
    part, suited = kind.suited(report, settings)
    if part.axes == problem.axes:
        return kind(problem, suited)
    return Reduced(problem, kind(part, suited), settings)


def after_failures(
    kind: type[Allocator], problem: AllocationProblem, settings: Any
) -> Allocator:
    """Return the allocator of a class for all axes of a problem; see `Allocator.with_health`."""
    if not problem.failed:
        return kind(problem, settings)
    report = audit(problem)
    method = allocator_for(kind, report, settings)
    whole = type(method) is kind and method.problem.axes == problem.axes and not report.lost
    return method if whole else Failed(report, kind, method, settings)


class WholeAllocation(Allocation):
    """The answer for all axes of a problem, of a method that has some of them.

    - `part`: the answer of the method, whose certificate this answer has
    - `maker`: the allocator
    """

    part: Allocation | None = None
    maker: Reduced | None = None

    @classmethod
    def of(cls, maker: Reduced, part: Allocation, demand: Array, status: Status) -> Allocation:
        """Return the answer of an allocator for a demand (m,)."""
        made = cls(
            maker.problem, demand, part.thrusts, status, part.level, part.violation,
            part.preference, part.bounds, part.by_rate)
        made.__dict__.update(part=part, maker=maker)
        return made

    @cached_property
    def certificate(self) -> Certificate[float]:
        """The certificate of the axes that the method has."""
        return super().certificate if self.part is None else self.part.certificate

    @cached_property
    def explanation(self) -> Explanation:
        """As that of the method, with rows for all axes."""
        if self.part is None or self.maker is None:
            return super().explanation
        return self.maker.explained(self.part, self)


class WholeBatch(AllocationBatch):
    """The same for many demands."""

    part: AllocationBatch | None = None
    maker: Reduced | None = None

    def __getitem__(self, i: Any) -> Any:
        """Return one answer, or the answers of a slice."""
        if self.part is None or self.maker is None:
            return super().__getitem__(i)
        return self.maker.whole(self.part[i], self.demand[i])


class Reduced(Allocator):
    """Takes demands for all axes of a problem, and gives some of them to a method.

    Other axes get what the method's thrusts produce there.  An answer is EXACT only if all axes
    are met.  Where the method is exact and an axis that it does not have is missed, the answer is
    what the method calls `missed`.

    - `problem`: of all axes
    - `method`: with the problem of its axes
    - `within`: the same within rates, if these limit the answers
    """

    takes_vectors = True

    def __init__(
        self, problem: AllocationProblem, method: Allocator, settings: Any, within: Any = None
    ) -> None:
        self.problem, self.method, self.settings = problem, method, settings
        self.engine, self.missed = method.engine, method.missed
        self._answering: Any = method if within is None else within
        axes = problem.axes
        self._rows = np.array([axes.index(axis) for axis in method.problem.axes], dtype=int)

    def _allocate(self, u: Array) -> Allocation:
        return self.whole(self._answering.allocate(u[self._rows]), u)

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
            return WholeAllocation.of(self, answer, u, status)
        found = np.where(answer.status == Status.EXACT, np.int8(self.missed), answer.status)
        made = WholeBatch(
            self.problem, u, answer.thrusts,
            np.where(exact, np.int8(Status.EXACT), found).astype(np.int8),
            answer.level, answer.violation, answer.preference)
        made.__dict__.update(part=answer, maker=self)
        return made

    def explained(self, answer: Allocation, whole: Allocation) -> Explanation:
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

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> Allocator:
        """Raise a TypeError: ask the allocator of the sound vehicle."""
        raise TypeError('with_health: ask the allocator before within_rates')


class Failed(Reduced):
    """The method of an allocator after failures, with all axes."""

    def __init__(
        self, report: Audit, kind: type[Allocator], method: Allocator, settings: Any
    ) -> None:
        super().__init__(report.full, method, settings)
        self._kind, self.audit = kind, report

    def __repr__(self) -> str:
        """Return the same as of the method, with the lost axes."""
        lost = ', '.join(self.lost_axes) or 'none'
        return f'{super().__repr__()}, lost axes {lost}'.replace(
            type(self).__name__, self._kind.__name__, 1)

    def explained(self, answer: Allocation, whole: Allocation) -> Explanation:
        """Return the explanation with NaN as what was served of lost axes."""
        found = super().explained(answer, whole)
        lost = [axis in self.audit.lost for axis in self.problem.axes]
        return replace(found, served=np.where(lost, np.nan, found.served))

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> Allocator:
        """Return the same method for other health; see `Allocator.with_health`."""
        return self._for(self.problem.with_health(health, failed_arms, stuck))

    def _for(self, problem: AllocationProblem) -> Allocator:
        return after_failures(self._kind, problem, self.settings)
