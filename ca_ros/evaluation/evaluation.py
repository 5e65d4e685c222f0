"""What a method makes of wrenches, judged by the problem's own data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from time import perf_counter_ns
from typing import Any

import numpy as np

from ca_ros.allocation import AllocationProblem, Allocator
from ca_ros.arrays import Array, BoolArray, IntArray

VIOLATION = 1e-9
"""Thrusts that are further outside their bounds than this violate them [N]."""

FORCES = ('force_x', 'force_y', 'thrust')
"""The axes in N; the others are in N m."""


class AnswerError(ValueError):
    """What a method answered is no allocation."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What one method made of N wrenches.

    Attributes
    ----------
    demands : (N, m) array
        [N, N m]
    thrusts : (N, n) array
        After saturation [N].
    violation : (N,) array
        How far the method's own thrusts were outside their bounds, before saturation [N].
    force_error, torque_error : (N,) arrays
        Norms of demand minus wrench over the axes of force [N] and of torque [N m].
    time : (N,) array
        [s]
    status : (N,) int8 array
        Values of `ca_ros.Status`.
    """

    demands: Array
    thrusts: Array
    violation: Array
    force_error: Array
    torque_error: Array
    time: Array
    status: IntArray

    @property
    def violated(self) -> BoolArray:
        """Whether the method's own thrusts violated their bounds, (N,)."""
        return self.violation > VIOLATION


def evaluate(
    name: str, allocator: Allocator, problem: AllocationProblem, demands: Array, batch: bool
) -> Evaluation:
    """Allocate wrenches and judge the answers.

    Parameters
    ----------
    name : str
        For messages.
    allocator : Allocator
    problem : AllocationProblem
        By whose data the answers are judged.
    demands : (N, m) array
        Wrenches [N, N m].
    batch : bool
        Allocate them in one call, and give each the same share of its time; otherwise one by one.

    Raises
    ------
    AnswerError
        If the answers are not thrusts of the vehicle's rotors.
    """
    if batch and hasattr(allocator, 'allocate_batch'):
        start = perf_counter_ns()
        answer = allocator.allocate_batch(demands)
        times = np.full(len(demands), (perf_counter_ns() - start) / 1e9 / len(demands))
        parts: list[Any] = [answer.thrusts, answer.violation, answer.status]
    else:
        answers, times = [], np.empty(len(demands))
        for i, u in enumerate(demands):
            start = perf_counter_ns()
            answers.append(allocator.allocate(u))
            times[i] = (perf_counter_ns() - start) / 1e9
        fields_used = ('thrusts', 'violation', 'status')
        if not all(hasattr(a, part) for a in answers for part in fields_used):
            raise AnswerError(f'{name}: allocate has to return an Allocation')
        parts = [[getattr(a, part) for a in answers] for part in fields_used]
    thrusts = np.asarray(parts[0], dtype=float)
    if thrusts.shape != (len(demands), len(problem.lower)) or not np.isfinite(thrusts).all():
        raise AnswerError(
            f'{name}: expected finite thrusts of {len(problem.lower)} rotors for each wrench, got '
            f'an array of shape {thrusts.shape}'
        )
    outside = np.abs(thrusts - problem.clip(thrusts)).max(axis=1)
    # Not by a product of matrices, whose last digits depend on how many wrenches there are.
    residual = demands - np.einsum('ij,kj->ik', thrusts, problem.gamma)
    force = [axis in FORCES for axis in problem.axes]
    return Evaluation(
        demands,
        thrusts,
        np.maximum(np.broadcast_to(np.asarray(parts[1], dtype=float), outside.shape), outside),
        np.linalg.norm(residual[:, force], axis=1),
        np.linalg.norm(residual[:, np.logical_not(force)], axis=1),
        times,
        np.broadcast_to(np.asarray(parts[2], dtype=np.int8), outside.shape),
    )


def join(parts: Sequence[Evaluation]) -> Evaluation:
    """Return evaluations of one method, one after the other, as one."""
    return Evaluation(
        *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Evaluation))
    )
