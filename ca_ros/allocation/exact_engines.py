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
    """

    groups: Sequence[Sequence[str]]
    reversal: str
    reference: Array
    on_reference: bool
    status: Status
    slack: float


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
        If the problem's admissible set has no volume.
    """
    if not problem.spans:
        raise problem.no_volume()
    axes = problem.axes
    groups = setting.groups
    keeps = sensed(groups, setting.reversal)
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
    )


class NumpyEngine:
    """The NumPy implementation: the reference of the kernel, and its replacement.

    With `osqp` Newton's method starts at OSQP's answer.
    """

    def __init__(self, problem: AllocationProblem, setting: Setting, osqp: bool = False) -> None:
        rows = [[problem.axes.index(axis) for axis in group] for group in setting.groups]
        reference = setting.reference
        begin = reference if setting.on_reference else None
        self._problem, self._slack, self._status = problem, setting.slack, setting.status
        self._serve = Prioritization(problem, rows, reference, setting.reversal, begin)
        self._osqp = OsqpStart(problem) if osqp else None

    def allocate(self, u: Array, thrusts: Array) -> tuple[int, float, int, int] | None:
        """Write the thrusts for u; see `Kernel.allocate`.  Steps are not counted."""
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
