"""The judge of answers: what thrusts are worth, by the problem's own data."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from time import perf_counter_ns
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import AllocationProblem, Allocator, Status
from ca_ros.arrays import Array

VIOLATION = 1e-9
"""Thrusts that are further outside their bounds than this violate them [N]."""

WRONG = 1e-6
"""Greatest error of a right answer: of the wrench [N, N m], the bounds [N] and the norm [N]."""

FORCES = ('force_x', 'force_y', 'thrust')
"""The axes in N; the others are in N m."""

COLUMNS = {'roll': 'tau_x', 'pitch': 'tau_y', 'yaw': 'tau_z'}
"""Columns of the axes that go by another name."""


class AnswerError(ValueError):
    """What a method answered is no allocation."""


class Judge:
    """Judges thrusts that answer N wrenches.

    Parameters
    ----------
    problem : AllocationProblem
    demands : (N, m) array
        Wrenches [N, N m].
    """

    def __init__(self, problem: AllocationProblem, demands: Array) -> None:
        self.problem, self.demands = problem, demands
        self._force = np.array([axis in FORCES for axis in problem.axes])

    @cached_property
    def attainable(self) -> Any:
        """Which wrenches are in the admissible set, (N,)."""
        problem = self.problem
        return problem.image.margin(self.demands) >= -problem.tolerance(self.demands)

    @cached_property
    def least_norms(self) -> Array:
        """Least |f| of all thrusts that give the wrench, (N,), NaN if it is not attainable [N]."""
        norms = np.full(len(self.demands), np.nan)
        for i in np.flatnonzero(self.attainable):
            least = self.problem.least(self.problem.multipliers(self.demands[i]))
            norms[i] = np.linalg.norm(least)
        return norms

    def errors(self, thrusts: Array) -> tuple[Array, Array, Array]:
        """Return violation [N], force error [N] and torque error [N m] of thrusts, (N,) each."""
        residual = self.problem.residual(self.demands, thrusts)
        return (
            self.problem.violation(thrusts),
            np.linalg.norm(residual[:, self._force], axis=1),
            np.linalg.norm(residual[:, ~self._force], axis=1),
        )

    def worst(self, answers: Sequence[Any]) -> dict[str, float]:
        """Return the greatest faults of answers, thrusts (n,) or None for each wrench.

        For wrenches that are not attainable only the bounds are checked.

        Returns
        -------
        dict
            ``error`` [N, N m], ``violation`` [N], ``norm_excess`` [N] over the answers that are
            right otherwise (NaN if there are none), ``failures``: attainable wrenches without an
            answer.

        Raises
        ------
        AnswerError
            If an answer has another shape.
        """
        nothing = np.full(self.problem.n, np.nan)
        for answer in answers:
            if answer is not None and answer.shape != nothing.shape:
                raise AnswerError(
                    f'expected thrusts of {len(nothing)} rotors, got an array {answer.shape}'
                )
        thrusts = np.array([nothing if answer is None else answer for answer in answers])
        answered = np.isfinite(thrusts).all(axis=1)
        violation, force, torque = self.errors(np.where(answered[:, None], thrusts, 0.0))
        error, judged = np.hypot(force, torque), answered & self.attainable
        right = judged & (error <= WRONG) & (violation <= WRONG)
        excess = (np.linalg.norm(thrusts, axis=1) - self.least_norms)[right]
        return {
            'error': float(error[judged].max(initial=0.0)),
            'violation': float(violation[answered].max(initial=0.0)),
            'norm_excess': max(float(excess.max()), 0.0) if len(excess) else np.nan,
            'failures': int((self.attainable & ~answered).sum()),
        }


def verdict(worst: Any, attainable: int) -> dict[str, Any]:
    """Return the greatest faults, as of `Judge.worst`, with what is wrong in words."""
    excess, failures = float(worst['norm_excess']), int(worst['failures'])
    found = {
        'wrench': worst['error'] > WRONG,
        'bounds': worst['violation'] > WRONG,
        'norm': excess > WRONG,
        f'no answer to {failures} of {attainable}': failures > 0,
    }
    faults = [word for word, wrong in found.items() if wrong]
    return {
        'error': float(worst['error']),
        'violation': float(worst['violation']),
        'norm_excess': None if np.isnan(excess) else excess,
        'failures': failures,
        'attainable': attainable,
        'faults': faults,
        'correct': not faults,
    }


def evaluate(
    name: str, allocator: Allocator, problem: AllocationProblem, demands: Array, batch: bool
) -> pd.DataFrame:
    """Allocate wrenches and judge the answers.

    Parameters
    ----------
    name : str
        Of the method.
    allocator : Allocator
    problem : AllocationProblem
        By whose data the answers are judged.
    demands : (N, m) array
        Wrenches [N, N m].
    batch : bool
        Allocate them in one call, and give each the same share of its time; otherwise one by one.

    Returns
    -------
    DataFrame
        A row a wrench, with the columns of static.csv but ``sample``, and ``violation``: how far
        the method's own thrusts were outside their bounds, before saturation [N].

    Raises
    ------
    AnswerError
        If the answers are not thrusts of the vehicle's rotors.
    """
    used = ('thrusts', 'violation', 'status')
    if batch and hasattr(allocator, 'allocate_batch'):
        start = perf_counter_ns()
        answer = allocator.allocate_batch(demands)
        times = np.full(len(demands), (perf_counter_ns() - start) / 1e9 / len(demands))
        parts: list[Any] = [getattr(answer, part) for part in used]
    else:
        answers, times = [], np.empty(len(demands))
        for i, u in enumerate(demands):
            start = perf_counter_ns()
            answers.append(allocator.allocate(u))
            times[i] = (perf_counter_ns() - start) / 1e9
        if not all(hasattr(answer, part) for answer in answers for part in used):
            raise AnswerError(f'{name}: allocate has to return an Allocation')
        parts = [[getattr(answer, part) for answer in answers] for part in used]
    thrusts = np.asarray(parts[0], dtype=float)
    if thrusts.shape != (len(demands), problem.n) or not np.isfinite(thrusts).all():
        raise AnswerError(
            f'{name}: expected finite thrusts of {problem.n} rotors for each wrench, got an array '
            f'of shape {thrusts.shape}'
        )
    outside, force, torque = Judge(problem, demands).errors(thrusts)
    violation = np.maximum(np.asarray(parts[1], dtype=float), outside)
    status = np.broadcast_to(np.asarray(parts[2], dtype=np.int8), outside.shape)
    names = [COLUMNS.get(axis, axis) for axis in problem.axes]
    return pd.DataFrame(
        {
            'method': name,
            **dict(zip(names, demands.T, strict=True)),
            **{f'f_{i + 1}': column for i, column in enumerate(thrusts.T)},
            'violated': (violation > VIOLATION).astype(np.int8),
            'force_error': force,
            'torque_error': torque,
            'time': times,
            'status': pd.Categorical.from_codes(status, [each.name for each in Status]),
            'violation': violation,
        }
    )
