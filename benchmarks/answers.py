"""The check of answers: what is wrong with thrusts, by the data of the problem alone."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.errors import CaRosError
from ca_ros.problem.problem import AllocationProblem

WRONG = 1e-6  # largest error of a right answer: wrench [N, N m], bounds [N] and norm [N]


class AnswerError(CaRosError):
    """A method did not answer with thrusts of the vehicle's rotors."""


class Answers:
    """Checks answers to wrenches (N, m) [N, N m], of which some are `attainable`, (N,)."""

    def __init__(self, problem: AllocationProblem, demands: Array) -> None:
        self.problem, self.demands = problem, demands
        self.attainable = problem.attainable_set.margin(demands) >= -problem.tolerance(demands)
        self._least = np.full(len(demands), np.nan)
        solver = problem.box.least_norm
        for i in np.flatnonzero(self.attainable):
            answer = solver.solve(demands[i], float(problem.tolerance(demands[i])))
            self._least[i] = np.linalg.norm(solver.least_norm(answer.multipliers))

    def worst(self, answers: Sequence[Any]) -> dict[str, float]:
        """Return the largest errors of answers: thrusts (n,) or None for each wrench.

        For unattainable wrenches only the bounds are checked.  ``error`` [N, N m], ``violation``
        [N], ``norm_excess`` [N] over the answers that are right otherwise (NaN if there are none),
        ``failures``: how many ``attainable`` wrenches have no answer.  Raises an AnswerError if an
        answer has another shape.
        """
        nothing = np.full(self.problem.n, np.nan)
        thrusts = [nothing if answer is None else answer for answer in answers]
        if shapes := {np.shape(each) for each in thrusts} - {nothing.shape}:
            shape = shapes.pop()
            raise AnswerError(f'expected thrusts of {len(nothing)} rotors, got an array {shape}')
        answered = np.isfinite(np.array(thrusts)).all(axis=1)
        given = np.where(answered[:, None], thrusts, 0.0)
        violation = self.problem.violation(given)
        error = np.linalg.norm(self.problem.residual(self.demands, given), axis=1)
        checked = answered & self.attainable
        right = checked & (error <= WRONG) & (violation <= WRONG)
        excess = (np.linalg.norm(given, axis=1) - self._least)[right]
        return {
            'error': float(error[checked].max(initial=0.0)),
            'violation': float(violation[answered].max(initial=0.0)),
            'norm_excess': float(excess.max(initial=0.0)) if len(excess) else np.nan,
            'failures': int((self.attainable & ~answered).sum()),
            'attainable': int(self.attainable.sum()),
        }


def faults(worst: Mapping[str, Any]) -> str:
    """Return what is wrong with answers, '' if nothing is, from the result of `Answers.worst`."""
    found = {
        'wrench': worst['error'] > WRONG, 'bounds': worst['violation'] > WRONG,
        'norm': worst['norm_excess'] > WRONG,
        f'no answer to {worst["failures"]:.0f}': worst['failures'] > 0,
    }
    return ', '.join(fault for fault, wrong in found.items() if wrong)
