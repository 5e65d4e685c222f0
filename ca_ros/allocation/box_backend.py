"""The backends of the exact allocator for numbers within bounds: the kernel in C, and NumPy."""

from itertools import combinations
from math import ceil, comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.explanation import BY_ORDER, BY_POLICY, Explanation, explained
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.kernel import Kernel
from ca_ros.problem.limits import Limits, shares
from ca_ros.problem.prioritization import Prioritization, sensed
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.programs import EXACT_TOLERANCE, lengths
from ca_ros.solver.least_norm_qp import AIM, DualNewton, Solution

LEVEL, NEARLY_LEVEL = 1e-9, 1e-4  # rates of edges that are not quite level, with a margin
DEPENDENT = 1e-5  # singular value of a basis below which the simplex method does not meet it
BASES, BASES_MAX = 2000, 100_000  # that are looked at together, and at most


def has_nearly_level_edges(gamma: Array, half_range: Array) -> bool:
    """Return whether an edge of the admissible set is level along an axis, but not quite.

    Along an edge one thrust moves, others or axes with it, and the rest stay.  The simplex method
    takes a rate below 1e-6 for a rounding error of zero in single precision, in double precision
    one below 1e-8.  This looks for rates between them, scaled, in the dictionaries of all bases.
    If there are more bases than `BASES_MAX`, the answer is yes.

    `gamma` (m, n): control allocation matrix.  `half_range` (n,): of the thrusts.
    """
    scaled = gamma * half_range
    scaled = scaled[:, scaled.any(axis=0)] / np.abs(scaled).sum(axis=1)[:, None]
    columns = np.hstack([scaled, np.eye(len(gamma))])
    m, count = columns.shape
    if comb(count, m) > BASES_MAX:
        return True
    chosen = np.array(list(combinations(range(count), m)))
    for some in np.array_split(chosen, ceil(len(chosen) / BASES)):
        bases = np.moveaxis(columns[:, some], 1, 0)
        sound = bases[np.linalg.svd(bases, compute_uv=False)[:, -1] > DEPENDENT]
        rates = np.abs(np.linalg.solve(sound, np.broadcast_to(columns, (len(sound), m, count))))
        if ((rates > LEVEL) & (rates < NEARLY_LEVEL)).any():
            return True
    return False


class BoxBackend:
    """What both backends have.

    `allocate(u, demand, thrusts, *bounds)` and `allocate_batch`, if there is one, are those of
    `ca_ros.kernel.Kernel`, and so is `limits`, its `explain`.
    """

    engine: str
    allocate: Any
    limits: Any
    allocate_batch: Any = None

    def __init__(self, problem: AllocationProblem) -> None:
        self._problem = problem

    def explain(self, answer: Allocation) -> Explanation:
        """Return why an answer is what it is."""
        m, n = self._problem.gamma.shape
        numbers, names = np.empty(m * (3 + n)), np.empty((m + 1) * (1 + n), dtype=np.int32)
        margin = self.limits(
            answer.demand, answer.thrusts, numbers, names, *(answer.bounds or ()))
        found = Limits.of(numbers.reshape(m, -1), names.reshape(m + 1, -1))
        other = BY_POLICY if answer.status is Status.REJECTED else BY_ORDER
        return explained(
            self._problem, answer.demand, answer.thrusts, found, margin, [other] * m)


class BoxKernel(BoxBackend):
    """The kernel in C, of a class of `ca_ros.kernel.load`."""

    engine = 'C'

    def __init__(
        self, kernel: type[Kernel], problem: AllocationProblem, settings: ExactSettings
    ) -> None:
        super().__init__(problem)
        made = kernel_for(kernel, problem, settings)
        self.allocate, self.allocate_batch = made.allocate, made.allocate_batch
        self.limits = made.explain


def kernel_for(
    kernel: type[Kernel], problem: AllocationProblem, settings: ExactSettings,
    dtype: type[np.floating] = np.float64,
) -> Kernel:
    """Return a kernel for a problem.

    Raises a ValueError if the problem's admissible set has no volume, or a setting does not suit
    the problem, or a TypeError if effectors are vectors.

    `kernel`: a class of `ca_ros.kernel.load`.  `dtype`: the type of the kernel's numbers.
    """
    axes, sets, serving = problem.axes, problem.box.sets, settings.serving(problem)
    named = [[axes[row] for row in group] for group in serving.groups]
    keeps = sensed(named, serving.axis_reversal)
    preference = settings.preference(problem)
    gamma, lower, upper, start = (
        np.ascontiguousarray(array, dtype)
        for array in (problem.gamma, sets.lower, sets.upper, serving.reference)
    )
    # What single precision loses of Γ: with it the kernel tells edges that are level from others.
    rest = (problem.gamma - gamma).astype(dtype).ravel()
    return kernel(
        gamma, lower, upper, start,
        order=[row for group in serving.groups for row in group],
        group=[i for i, group in enumerate(serving.groups) for _ in group],
        keep_sense=[int(axis in keeps) for axis in axes], policy=int(settings.status),
        on_reference=serving.begin is not None, slack=settings.residual_slack,
        weight=preference and np.ascontiguousarray(preference[0], dtype),
        preferred=preference and np.ascontiguousarray(preference[1], dtype),
        thrust=axes.index('thrust') if 'thrust' in axes else -1, airmode=serving.airmode_limit,
        impaired=problem.impaired.tolist(), rest=rest,
        nearly_level=dtype == np.float32 and has_nearly_level_edges(
            problem.gamma, problem.half_range),
    )


class BoxNumpy(BoxBackend):
    """The NumPy implementation: the reference of the kernel, and its replacement."""

    engine = 'NumPy'

    def __init__(self, problem: AllocationProblem, settings: ExactSettings) -> None:
        super().__init__(problem)
        preference = settings.preference(problem)
        self._status, self._slack = settings.status, settings.residual_slack
        self._serve = Prioritization(problem, *settings.serving(problem))
        self._preference, self._solver = preference, problem.box.solver(preference)
        self._idle = ~problem.gamma.any(axis=0)

    def _within(self, *bounds: Array) -> AllocationProblem | None:
        """Return the problem with narrower bounds; None if none is narrower."""
        if not bounds:
            return None
        lower, upper = (self._problem.clip(bound) for bound in bounds)
        same = (lower == self._problem.lower).all() and (upper == self._problem.upper).all()
        return None if same else self._problem.bounded(lower, upper)

    def limits(  # type: ignore[override]
        self, u: Array, thrusts: Array, numbers: Array, names: NDArray[np.int32], *bounds: Array
    ) -> float:
        """Write why thrusts are the answer to u; see `Kernel.explain`."""
        problem, within = self._problem, self._within(*bounds) or self._problem
        served = shares(problem, u, problem.gamma @ thrusts)
        if lengths(u - problem.gamma @ thrusts) <= self._slack * max(1.0, float(lengths(u))):
            served = np.ones_like(served)
        found = Limits.none(served, problem.n)
        if self._status != Status.REJECTED and (served < 1.0).any():
            found, _ = self._serve.limits(u, served, within)
        numbers.reshape(len(u), -1)[:] = np.column_stack(
            [found.served, found.joint_gain, found.airmode, found.gain])
        names.reshape(len(u) + 1, -1)[:] = np.vstack([
            np.column_stack([found.airmode_blocks, found.blocks]), np.append([0], found.limit)])
        return within.margin(u)

    def allocate(  # type: ignore[override]
        self, u: Array, demand: Array, thrusts: Array, *bounds: Array
    ) -> tuple[int, float] | None:
        """Copy u to `demand`, and write its thrusts; see `Kernel.allocate`."""
        within, problem, solver = self._within(*bounds), self._problem, self._solver
        demand[:] = u = problem.check(u)
        if within is not None:
            problem = within
            solver = problem.box.solver(self._preference)
        thrusts[:] = solver.unbounded(u)
        if (thrusts == problem.clip(thrusts)).all() and problem.is_exact(u, thrusts, AIM):
            return None
        solution = self._least(solver, u)
        thrusts[:] = solution.thrusts
        # Whether u counts as attainable depends on u alone and not on the policy.
        missed = lengths(u - problem.gamma @ thrusts)
        size = problem.tolerance(u) / EXACT_TOLERANCE
        if solution.attained or (not solution.unattainable and missed <= self._slack * size):
            return None
        served = self._serve(u, within)
        other = np.where(self._idle, solution.thrusts, served.thrusts)
        if not solution.unattainable and problem.is_exact(u, other):
            thrusts[:] = other
            return None
        if self._status == Status.REJECTED:
            thrusts[:] = problem.resting_thrusts
            return int(self._status), 0.0
        solution = self._least(solver, served.wrenches)
        thrusts[:] = solution.thrusts
        status = self._status
        low = (problem.lower > self._problem.lower) & (served.thrusts <= problem.middle)
        high = (problem.upper < self._problem.upper) & (served.thrusts >= problem.middle)
        if (served.held & (low | high)).any():
            status = Status.RATE_LIMITED
        if not solution.attained:
            thrusts[:] = np.where(self._idle, solution.thrusts, served.thrusts)
            if not problem.is_exact(served.wrenches, thrusts):
                status = Status.INEXACT
        return int(status), float(served.levels.min())

    def _least(self, solver: DualNewton, u: Array) -> Solution:
        tolerance = float(self._problem.tolerance(u))
        slack = tolerance / EXACT_TOLERANCE * self._slack
        return solver.solve(u, tolerance, slack)
