"""The two engines of the exact allocator: the kernel in C, and NumPy.

Both have the methods `allocate` and `allocate_batch` of `ca_ros.kernel.Kernel`.
"""

from __future__ import annotations

import numpy as np

from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.osqp_program import OsqpStart
from ca_ros.allocation.result import Status
from ca_ros.arrays import Array, IntArray
from ca_ros.kernel import Kernel
from ca_ros.problem.prioritization import Prioritization, sensed
from ca_ros.problem.problem import EXACT_TOLERANCE, AllocationProblem, lengths
from ca_ros.problem.vectored import VectoredProblem
from ca_ros.settings import ParameterError
from ca_ros.solver.dual_newton import AIM, DualNewton, Solution


def kernel_for(
    kernel: type[Kernel],
    problem: AllocationProblem,
    settings: ExactSettings,
    dtype: type[np.floating] = np.float64,
) -> Kernel:
    """Return a kernel for a problem.

    Parameters
    ----------
    kernel : type
        A class of `ca_ros.kernel.load`.
    problem : AllocationProblem
    settings : ExactSettings
    dtype : type
        The type of the kernel's numbers.

    Raises
    ------
    ValueError
        If the problem's admissible set has no volume, or a setting does not suit the problem.
    """
    if isinstance(problem, VectoredProblem):
        raise ParameterError('the C kernel takes numbers within bounds, not rotors that tilt')
    axes, serving = problem.axes, settings.serving(problem)
    keeps = sensed(serving.groups, serving.thrust_deviation)
    preference = settings.preference(problem)
    gamma, lower, upper, start = (
        np.ascontiguousarray(array, dtype)
        for array in (problem.gamma, problem.lower, problem.upper, serving.reference)
    )
    return kernel(
        gamma,
        lower,
        upper,
        start,
        order=[axes.index(axis) for group in serving.groups for axis in group],
        group=[i for i, group in enumerate(serving.groups) for _ in group],
        keep_sense=[int(axis in keeps) for axis in axes],
        policy=int(settings.status),
        on_reference=serving.on_reference,
        slack=settings.residual_slack,
        weight=preference and np.ascontiguousarray(preference[0], dtype),
        preferred=preference and np.ascontiguousarray(preference[1], dtype),
    )


class NumpyEngine:
    """The NumPy implementation: the reference of the kernel, and its replacement.

    With OSQP, Newton's method starts at its answer.
    """

    def __init__(self, problem: AllocationProblem, settings: ExactSettings) -> None:
        groups, thrust_deviation, reference, on_reference = settings.serving(problem)
        rows = [[problem.axes.index(axis) for axis in group] for group in groups]
        begin = reference if on_reference else None
        preference = settings.preference(problem)
        self._problem, self._status = problem, settings.status
        self._slack = settings.residual_slack
        self._serve = Prioritization(problem, rows, reference, thrust_deviation, begin)
        self._osqp = OsqpStart(problem, preference) if settings.solver == 'osqp' else None
        self._solver = problem.least_norm
        if preference is not None:
            self._solver = DualNewton(problem.gamma, problem.lower, problem.upper, *preference)
        self._idle = ~problem.gamma.any(axis=0)

    def allocate(self, u: Array, thrusts: Array) -> tuple[int, float, int, int] | None:
        """Write the thrusts for u; see `Kernel.allocate`.  Steps are not counted."""
        problem, solver = self._problem, self._solver
        u = problem.check(u)
        thrusts[:] = solver.unbounded(u)
        if (thrusts == problem.clip(thrusts)).all() and problem.is_exact(u, thrusts, AIM):
            return None
        solution = self._least(u)
        thrusts[:] = solution.thrusts
        # Whether u counts as attainable depends on u alone and not on the policy.
        missed = lengths(u - problem.gamma @ thrusts)
        size = problem.tolerance(u) / EXACT_TOLERANCE
        if solution.attained or (not solution.unattainable and missed <= self._slack * size):
            return None
        served = self._serve(u)
        other = np.where(self._idle, solution.thrusts, served.thrusts)
        if not solution.unattainable and problem.is_exact(u, other):
            thrusts[:] = other
            return None
        if self._status == Status.REJECTED:
            thrusts[:] = problem.resting_thrusts
            return self._status, 0.0, 0, 0
        solution = self._least(served.wrenches)
        thrusts[:] = solution.thrusts
        status = self._status
        if not solution.attained:
            thrusts[:] = np.where(self._idle, solution.thrusts, served.thrusts)
            if not problem.is_exact(served.wrenches, thrusts):
                status = Status.INEXACT
        return int(status), float(served.levels.min()), 0, 0

    def allocate_batch(
        self, wrenches: Array, thrusts: Array, status: IntArray, levels: Array, work: None
    ) -> None:
        """Write thrusts, status and levels for wrenches; see `Kernel.allocate_batch`."""
        for i, u in enumerate(wrenches):
            answer = self.allocate(u, thrusts[i])
            status[i], levels[i] = (0, 1.0) if answer is None else answer[:2]

    def _least(self, u: Array) -> Solution:
        start = None if self._osqp is None else self._osqp.multipliers(u)
        tolerance = float(self._problem.tolerance(u))
        slack = tolerance / EXACT_TOLERANCE * self._slack
        return self._solver.solve(u, tolerance, start, slack)
