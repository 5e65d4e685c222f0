"""The two engines of the exact allocator: the kernel in C, and NumPy.

Both have the methods `allocate` and `allocate_batch` of `ca_ros.kernel.Kernel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.allocation.osqp_start import OsqpStart
from ca_ros.allocation.result import Status
from ca_ros.arrays import Array, IntArray
from ca_ros.kernel import Kernel
from ca_ros.problem.prioritization import Prioritization, sensed
from ca_ros.problem.problem import EXACT_TOLERANCE, AllocationProblem, lengths
from ca_ros.solver.dual_newton import Solution


@dataclass(frozen=True, eq=False)
class Setting:
    """The options of an exact allocator in the terms of its engine.

    Attributes
    ----------
    groups : sequence of sequences of str
        The axes of each group of the priorities.
    reversal : 'prevent', 'avoid' or 'allow'
    reference : (m,) array
        The wrench from which demands are counted [N, N m].
    on_reference : bool
        Whether the reference is attainable; the lines of the priorities then begin there.
    status : Status
        The status of a wrench that is not attainable.
    slack : float
        See `Exact`.
    weight, preferred : (n,) arrays, optional
        W > 0 and f_p of the cost ``|W (f - f_p)|^2`` [f_p in N]; by default ones and zeros.
    """

    groups: Sequence[Sequence[str]]
    reversal: str
    reference: Array
    on_reference: bool
    status: Status
    slack: float
    weight: Array | None = None
    preferred: Array | None = None

    def preference(self, n: int) -> tuple[Array, Array] | None:
        """Return W and f_p (n,); None if neither is given.

        Raises
        ------
        ValueError
            If one of them has not n finite numbers, or a weight is not positive.
        """
        if self.weight is None and self.preferred is None:
            return None
        weight = np.ones(n) if self.weight is None else np.asarray(self.weight, float)
        preferred = np.zeros(n) if self.preferred is None else np.asarray(self.preferred, float)
        for name, array in (('weight', weight), ('preferred', preferred)):
            if array.shape != (n,) or not np.isfinite(array).all():
                raise ValueError(f'{name}: expected {n} finite numbers, got {array.tolist()}')
        if not np.all(weight > 0.0):
            raise ValueError(f'weight: expected positive numbers, got {weight.tolist()}')
        return weight, preferred


def kernel_for(
    kernel: type[Kernel],
    problem: AllocationProblem,
    setting: Setting,
    dtype: type[np.floating] = np.float64,
) -> Kernel:
    """Return a kernel for a problem.

    Parameters
    ----------
    kernel : type
        A class of `ca_ros.kernel.load`.
    problem : AllocationProblem
    setting : Setting
    dtype : type
        The type of the kernel's numbers.

    Raises
    ------
    ValueError
        If the problem's admissible set has no volume, or a weight or preferred thrust is wrong.
    """
    if not problem.spans:
        raise problem.no_volume()
    axes = problem.axes
    groups = setting.groups
    keeps = sensed(groups, setting.reversal)
    preference = setting.preference(problem.n)
    gamma, lower, upper, start = (
        np.ascontiguousarray(array, dtype)
        for array in (problem.gamma, problem.lower, problem.upper, setting.reference)
    )
    return kernel(
        gamma,
        lower,
        upper,
        start,
        order=[axes.index(axis) for group in groups for axis in group],
        group=[i for i, group in enumerate(groups) for _ in group],
        keep_sense=[int(axis in keeps) for axis in axes],
        policy=int(setting.status),
        on_reference=setting.on_reference,
        slack=setting.slack,
        weight=preference and np.ascontiguousarray(preference[0], dtype),
        preferred=preference and np.ascontiguousarray(preference[1], dtype),
    )


class NumpyEngine:
    """The NumPy implementation: the reference of the kernel, and its replacement.

    With `osqp` Newton's method starts at OSQP's answer.
    """

    def __init__(self, problem: AllocationProblem, setting: Setting, osqp: bool = False) -> None:
        if not problem.spans:
            raise problem.no_volume()
        rows = [[problem.axes.index(axis) for axis in group] for group in setting.groups]
        reference = setting.reference
        self._given, self._preference = problem, setting.preference(problem.n)
        if self._preference is not None:
            self._offset = problem.gamma @ self._preference[1]
            reference = reference - self._offset
            problem = problem.preferring(*self._preference)
        begin = reference if setting.on_reference else None
        self._problem, self._slack, self._status = problem, setting.slack, setting.status
        self._serve = Prioritization(problem, rows, reference, setting.reversal, begin)
        self._osqp = OsqpStart(problem) if osqp else None

    def allocate(self, u: Array, thrusts: Array) -> tuple[int, float, int, int] | None:
        """Write the thrusts for u; see `Kernel.allocate`.  Steps are not counted."""
        if self._preference is None:
            return self._allocate(u, thrusts)
        given, scaled = self._given, self._problem
        answer = self._allocate(given.check(u) - self._offset, thrusts)
        if answer is not None and answer[0] == Status.REJECTED:
            thrusts[:] = given.rest
            return answer
        weight, preferred = self._preference
        low, high = thrusts <= scaled.lower, thrusts >= scaled.upper
        thrusts[:] = given.clip(preferred + thrusts / weight)
        thrusts[low], thrusts[high] = given.lower[low], given.upper[high]
        return answer

    def _allocate(self, u: Array, thrusts: Array) -> tuple[int, float, int, int] | None:
        problem = self._problem
        u = problem.check(u)
        if problem.attains_unbounded(u):
            thrusts[:] = problem.least_norm.unbounded(u)
            if lengths(u - problem.gamma @ thrusts) <= 0.5 * problem.tolerance(u):
                return None
        served, levels, reached = self._serve(u)
        if reached:
            solution = self._least(u)
            thrusts[:] = solution.thrusts
            if solution.attained or self._within_slack(u, served, thrusts):
                return None
        if self._status == Status.REJECTED:
            thrusts[:] = problem.rest
            return self._status, 0.0, 0, 0
        solution = self._least(served)
        thrusts[:] = solution.thrusts
        status = self._status if solution.attained else Status.INEXACT
        return int(status), float(levels.min()), 0, 0

    def allocate_batch(
        self, wrenches: Array, thrusts: Array, status: IntArray, levels: Array, work: None
    ) -> None:
        """Write thrusts, status and levels for wrenches; see `Kernel.allocate_batch`."""
        for i, u in enumerate(wrenches):
            answer = self.allocate(u, thrusts[i])
            status[i], levels[i] = (0, 1.0) if answer is None else answer[:2]

    def _within_slack(self, u: Array, served: Array, thrusts: Array) -> bool:
        """Tell whether u is attainable, as `served` proves, and missed by no more than `slack`."""
        tolerance = self._problem.tolerance(u)
        missed = lengths(u - self._problem.gamma @ thrusts)
        return bool(
            lengths(served - u) <= tolerance
            and missed <= tolerance / EXACT_TOLERANCE * self._slack
        )

    def _least(self, u: Array) -> Solution:
        start = None if self._osqp is None else self._osqp.multipliers(u)
        tolerance = float(self._problem.tolerance(u))
        slack = tolerance / EXACT_TOLERANCE * self._slack
        return self._problem.least_norm.solve(u, tolerance, start, slack)
