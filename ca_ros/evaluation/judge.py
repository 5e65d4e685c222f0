"""The judge of answers: errors of thrusts, computed from the problem's data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from time import perf_counter_ns
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import AllocationProblem, Allocator, Status
from ca_ros.arrays import Array
from ca_ros.errors import CaRosError
from ca_ros.problem.vehicle_problem import VehicleProblem

VIOLATION = 1e-9
"""Thrusts that are further outside their bounds than this violate them [N]."""

WRONG = 1e-6
"""Largest error of a right answer: of the wrench [N, N m], the bounds [N] and the norm [N]."""

FORCES = ('force_x', 'force_y', 'thrust')
"""The axes in N; the others are in N m."""

COLUMNS = {'roll': 'tau_x', 'pitch': 'tau_y', 'yaw': 'tau_z'}
"""Columns of a vehicle's axes whose column has another name."""

ERRORS = {
    'force_error': 'force error [N]',
    'torque_error': 'torque error [N m]',
    'error': 'error of all axes',
}
"""Titles of the errors: force and torque of a vehicle, one of a problem without a vehicle."""


class AnswerError(CaRosError, ValueError):
    """A method did not answer with thrusts of the vehicle's rotors."""


def columns(problem: AllocationProblem) -> list[str]:
    """Return the names of the columns of u."""
    if isinstance(problem, VehicleProblem):
        return [COLUMNS.get(axis, axis) for axis in problem.axes]
    return list(problem.axes)


class Judge:
    """Judges thrusts that answer wrenches (N, m) [N, N m]."""

    def __init__(self, problem: AllocationProblem, demands: Array) -> None:
        self.problem, self.demands = problem, demands
        force = np.array([axis in FORCES for axis in problem.axes])
        if isinstance(problem, VehicleProblem):
            self._parts = {'force_error': force, 'torque_error': ~force}
        else:
            self._parts = {'error': np.full(len(force), True)}

    @cached_property
    def attainable(self) -> Any:
        """Which wrenches are in the admissible set, (N,)."""
        problem = self.problem
        return problem.image.margin(self.demands) >= -problem.tolerance(self.demands)

    @cached_property
    def least_norms(self) -> Array:
        """Least |f| of all thrusts that give the wrench, (N,), NaN if it is unattainable [N]."""
        norms = np.full(len(self.demands), np.nan)
        for i in np.flatnonzero(self.attainable):
            least = self.problem.least(self.problem.multipliers(self.demands[i]))
            norms[i] = np.linalg.norm(least)
        return norms

    def errors(self, thrusts: Array) -> dict[str, Array]:
        """Return the errors of thrusts that `ERRORS` lists for this problem, (N,) each."""
        residual = self.problem.residual(self.demands, thrusts)
        return {
            name: np.linalg.norm(residual[:, part], axis=1) for name, part in self._parts.items()
        }

    def worst(self, answers: Sequence[Any]) -> dict[str, float]:
        """Return the largest errors of answers: thrusts (n,) or None for each wrench.

        For unattainable wrenches only the bounds are checked.

        Returns
        -------
        dict
            ``error`` [N, N m], ``violation`` [N], ``norm_excess`` [N] over the answers that are
            right otherwise (NaN if there are none), ``failures``: the number of attainable
            wrenches without an answer, ``attainable``: the number of attainable wrenches.

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
        given = np.where(answered[:, None], thrusts, 0.0)
        violation = self.problem.violation(given)
        error = np.linalg.norm(list(self.errors(given).values()), axis=0)
        judged = answered & self.attainable
        right = judged & (error <= WRONG) & (violation <= WRONG)
        excess = (np.linalg.norm(thrusts, axis=1) - self.least_norms)[right]
        return {
            'error': float(error[judged].max(initial=0.0)),
            'violation': float(violation[answered].max(initial=0.0)),
            'norm_excess': float(excess.max(initial=0.0)) if len(excess) else np.nan,
            'failures': int((self.attainable & ~answered).sum()),
            'attainable': int(self.attainable.sum()),
        }


def faults(worst: Mapping[str, Any]) -> str:
    """Return what is wrong with answers, '' if nothing is, from the result of `Judge.worst`."""
    missing = f'no answer to {worst["failures"]:.0f} of {worst["attainable"]:.0f}'
    found = {
        'wrench': worst['error'] > WRONG,
        'bounds': worst['violation'] > WRONG,
        'norm': worst['norm_excess'] > WRONG,
        missing: worst['failures'] > 0,
    }
    return ', '.join(fault for fault, wrong in found.items() if wrong)


def evaluate(
    name: str, allocator: Allocator, problem: AllocationProblem, demands: Array, batch: bool
) -> pd.DataFrame:
    """Allocate wrenches (N, m) [N, N m] and judge the answers by the problem's data.

    A batch is one call, whose time is divided equally; otherwise wrenches are allocated one by
    one.

    Returns
    -------
    DataFrame
        One row per wrench: the columns of static.csv but ``sample``, and ``violation``, the
        largest violation of the bounds by the method's thrusts before saturation [N].

    Raises
    ------
    AnswerError
        If the answers are not thrusts of the vehicle's rotors.
    """
    whole = batch and hasattr(allocator, 'allocate_batch')
    call = allocator.allocate_batch if whole else allocator.allocate
    answers, times = [], []
    for u in [demands] if whole else demands:
        start = perf_counter_ns()
        answers.append(call(u))
        times.append((perf_counter_ns() - start) / 1e9 / (len(demands) if whole else 1))
    try:
        used = ('thrusts', 'violation', 'status')
        parts = [np.array([getattr(each, part) for each in answers]) for part in used]
    except AttributeError:
        raise AnswerError(f'{name}: allocate has to return an Allocation') from None
    thrusts = parts[0].astype(float).reshape(-1, parts[0].shape[-1])
    if thrusts.shape != (len(demands), problem.n) or not np.isfinite(thrusts).all():
        raise AnswerError(
            f'{name}: expected finite thrusts of {problem.n} rotors for each wrench, got an array '
            f'of shape {thrusts.shape}'
        )
    outside = problem.violation(thrusts)
    violation = np.maximum(parts[1].astype(float).ravel(), outside)
    status = np.broadcast_to(parts[2].astype(np.int8).ravel(), outside.shape)
    return pd.DataFrame(
        {
            'method': name,
            **dict(zip(columns(problem), demands.T, strict=True)),
            **{f'f_{i + 1}': column for i, column in enumerate(thrusts.T)},
            'violated': (violation > VIOLATION).astype(np.int8),
            **Judge(problem, demands).errors(thrusts),
            'time': np.broadcast_to(times, outside.shape),
            'status': pd.Categorical.from_codes(status, [each.name for each in Status]),
            'violation': violation,
        }
    )
