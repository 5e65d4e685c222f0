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
from ca_ros.solver.dual_newton import AIM, DualNewton, Solution


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
        begin = setting.reference if setting.on_reference else None
        preference = setting.preference(problem.n)
        self._problem, self._slack, self._status = problem, setting.slack, setting.status
        self._serve = Prioritization(problem, rows, setting.reference, setting.reversal, begin)
        self._osqp = OsqpStart(problem, preference) if osqp else None
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
            thrusts[:] = problem.rest
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
