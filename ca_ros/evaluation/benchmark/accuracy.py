"""What answers are worth, judged by the problem's own data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.evaluation.evaluation import AnswerError
from ca_ros.problem.problem import AllocationProblem

WRONG = 1e-6
"""Greatest error of a right answer: of the wrench [N, N m], the bounds [N] and the norm [N]."""


@dataclass
class Accuracy:
    """The worst of all answers of a contender to a load.

    Attributes
    ----------
    error : float
        Greatest |u - Gamma f| over the attainable wrenches that were answered [N, N m].
    violation : float
        Farthest that a thrust of any answer is outside its bounds [N].
    norm_excess : float or None
        Greatest |f| above the least |f| over the answers that are right otherwise [N]; None if
        there are none.
    failures : int
        Attainable wrenches without an answer, in the worst repetition.
    wrenches : int
        Attainable wrenches.
    """

    error: float = 0.0
    violation: float = 0.0
    norm_excess: float | None = None
    failures: int = 0
    wrenches: int = 0

    @property
    def faults(self) -> list[str]:
        """What is wrong, in words; empty if nothing is."""
        found = {
            'wrench': self.error > WRONG,
            'bounds': self.violation > WRONG,
            'norm': (self.norm_excess or 0.0) > WRONG,
            f'no answer to {self.failures} of {self.wrenches}': self.failures > 0,
        }
        return [word for word, wrong in found.items() if wrong]

    def figures(self) -> dict[str, Any]:
        """Return what benchmark.json holds."""
        return {
            'error': self.error,
            'violation': self.violation,
            'norm_excess': self.norm_excess,
            'failures': self.failures,
            'attainable': self.wrenches,
            'faults': self.faults,
            'correct': not self.faults,
        }


class Judge:
    """Judges answers to wrenches.

    A wrench outside of the admissible set has no right answer: to give none is right, and of one
    that is given only the bounds are looked at.

    Parameters
    ----------
    problem : AllocationProblem
    wrenches : (W, m) array
        [N, N m]
    """

    def __init__(self, problem: AllocationProblem, wrenches: Array) -> None:
        self.problem, self.wrenches = problem, wrenches
        self.attainable = problem.image.margin(wrenches) >= -problem.tolerance(wrenches)
        # Thrusts of this form have the least norm of all that give the same wrench.
        self.least_norms = np.array(
            [
                np.linalg.norm(problem.clip(problem.multipliers(u) @ problem.gamma))
                for u in wrenches[self.attainable]
            ]
        )

    def judge(self, worst: Accuracy, answers: Sequence[Any]) -> None:
        """Take answers, thrusts (n,) or None for each wrench, into the worst so far.

        Raises
        ------
        AnswerError
            If an answer is not of that form.
        """
        nothing = np.full(len(self.problem.lower), np.nan)
        for answer in answers:
            if answer is not None and answer.shape != nothing.shape:
                raise AnswerError(
                    f'expected thrusts of {len(nothing)} rotors, got an array {answer.shape}'
                )
        thrusts = np.array([nothing if a is None else a for a in answers])
        answered = np.isfinite(thrusts).all(axis=1)
        given = thrusts[answered]
        outside = np.maximum(self.problem.lower - given, given - self.problem.upper)
        worst.violation = max(worst.violation, float(outside.max(initial=0.0)))
        worst.wrenches = int(self.attainable.sum())
        thrusts, answered = thrusts[self.attainable], answered[self.attainable]
        worst.failures = max(worst.failures, int((~answered).sum()))
        thrusts, demands = thrusts[answered], self.wrenches[self.attainable][answered]
        errors = np.linalg.norm(demands - thrusts @ self.problem.gamma.T, axis=1)
        worst.error = max(worst.error, float(errors.max(initial=0.0)))
        violations = np.abs(thrusts - self.problem.clip(thrusts)).max(axis=1, initial=0.0)
        right = (errors <= WRONG) & (violations <= WRONG)
        if right.any():
            excess = np.linalg.norm(thrusts, axis=1) - self.least_norms[answered]
            worst.norm_excess = max(worst.norm_excess or 0.0, float(excess[right].max()))
