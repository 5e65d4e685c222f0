"""The backends of the exact allocator for vectors in convex sets: NumPy, and the kernel in C."""

from functools import cached_property, partial
from typing import Any

import numpy as np

from ca_ros.allocation.exact_settings import ExactSettings, Serving
from ca_ros.allocation.explanation import (
    BY_ORDER,
    BY_POLICY,
    Explanation,
    explained,
)
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.kernel.vectored import fields_of, sets_newton
from ca_ros.problem.interior import INSIDE
from ca_ros.problem.limits import Limits, shares
from ca_ros.problem.prioritization import airmode_limits
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.programs import EXACT_TOLERANCE, lengths
from ca_ros.problem.sets_limits import limits_of_vectors
from ca_ros.problem.sets_prioritization import SetsPrioritization, refuse_limits
from ca_ros.solver.convex_sets import ConvexSets
from ca_ros.solver.least_norm_over_sets import SetsNewton


class SetsNumpy:
    """The NumPy implementation, whose solvers are in C where they are built.

    Newton's method answers attainable wrenches.  On the boundary of the attainable set there may
    be no finite multipliers; there, and for `scale`, the answer is the end of the line to the
    demand, see `ca_ros.solver.least_norm_over_sets`.
    """

    allocate_batch: Any = None

    def __init__(self, problem: AllocationProblem, settings: ExactSettings) -> None:
        problem.check_volume()
        self._problem, self._settings = problem, settings
        settings.groups(problem.axes)
        refuse_limits(airmode_limits(settings.airmode_limit))
        program: Any = problem.program
        self._solver: SetsNewton = program.solver(settings.preference(problem))
        self.engine = self._solver.engine

    @cached_property
    def _serving(self) -> Serving:
        return self._settings.serving(self._problem)

    @cached_property
    def _begin(self) -> Array:
        """An attainable wrench (m,), where lines to demands begin."""
        serving, middle = self._serving, self._problem.gamma @ self._problem.middle
        if serving.begin is not None:
            return serving.begin
        way = serving.reference - middle
        usual = serving.reference is self._problem.reference
        if usual and self._problem.interior.has_reference_near_middle:
            return serving.reference
        reached = self._solver.line(middle, way, 1.0 / INSIDE).length
        return np.asarray(middle + min(1.0, INSIDE * reached) * way, float)

    @cached_property
    def _serve(self) -> SetsPrioritization:
        return SetsPrioritization(self._problem, *self._serving[:3], solver=self._solver)

    def explain(self, answer: Allocation) -> Explanation:
        """Return why an answer is what it is."""
        problem, u = self._problem, answer.demand
        served = shares(problem, u, answer.wrench)
        found, other = Limits.none(served, problem.n), BY_ORDER
        if answer.status is Status.REJECTED:
            other = BY_POLICY
        elif (served < 1.0).any():
            by_rate = np.zeros(problem.n, bool) if answer.by_rate is None else answer.by_rate
            found, _ = limits_of_vectors(
                problem, u, answer.thrusts, served, partial(self._moved, u), by_rate)
        margin = problem.margin(u)
        return explained(problem, u, answer.thrusts, found, margin, [other] * len(u))

    def _moved(self, u: Array, sets: ConvexSets) -> Array:
        """Return the wrench (m,) that is served for u (m,) with other sets."""
        if self._settings.status is Status.PRIORITIZED:
            return self._serve.moved(u, sets)
        gamma, begin = self._problem.gamma, self._begin
        given = self._solver.weights, self._solver.preferred
        line = sets_newton(gamma, sets, *given).line(begin, u - begin, 1.0)
        return np.asarray(gamma @ line.point, float)

    @property
    def fields(self) -> dict[str, Array | float]:
        """The fields of ``ca_vectored`` in C."""
        return fields_of(self._solver, **self._policy)

    @property
    def _policy(self) -> dict[str, Array | float]:
        prioritizes = self._settings.status is Status.PRIORITIZED
        given = self._serve.fields if prioritizes else {'reference': self._serving.reference}
        return {
            'slack': self._settings.residual_slack, 'policy': float(self._settings.status),
            'begin': self._begin, 'on_reference': float(self._serving.begin is not None),
            'resting': self._problem.resting_thrusts, **given,
        }

    def kernel(self) -> Any:
        """Return a `Vectored` of the extension module; None if it has no room for the problem."""
        fits = self._solver.prioritizes or self._settings.status is not Status.PRIORITIZED
        return self._solver.with_policy(**self._policy) if fits else None

    def allocate(self, u: Array, demand: Array, thrusts: Array) -> Any:
        """Copy u to `demand`, and write its vectors; see `ca_ros.kernel.Kernel.allocate`."""
        demand[:] = self._problem.check(u)
        thrusts[:], status, level = self._answer(demand)
        return None if status == Status.EXACT else (int(status), level)

    def _answer(self, u: Array) -> tuple[Array, int, float]:
        """Return vectors, status and level for a wrench: ``ca_vectored_allocate`` in NumPy."""
        problem, status, begin = self._problem, self._settings.status, self._begin
        found = self._solver.solve(u[None])
        slack = self._settings.residual_slack * float(problem.tolerance(u)) / EXACT_TOLERANCE
        unattainable = bool(found.unattainable[0])

        def within_slack(points: Array) -> bool:
            return bool(not unattainable and lengths(u - problem.gamma @ points) <= slack)

        if found.attained[0] or within_slack(found.points[0]):
            return found.points[0], Status.EXACT, 1.0
        if not unattainable or status is Status.SCALED:
            line = self._solver.line(begin, u - begin, 1.0)
            if problem.is_exact(u, line.point) or within_slack(line.point):
                return line.point, Status.EXACT, 1.0
        if status is Status.REJECTED:
            return problem.resting_thrusts, status, 0.0
        if status is Status.PRIORITIZED:
            answer = self._serve(u)
            return answer.thrusts, status, float(answer.levels.min())
        level, way = line.length, u - self._serving.reference
        if self._serving.begin is None:
            served = problem.gamma @ line.point - self._serving.reference
            shares = np.divide(served, way, out=np.ones_like(way), where=way != 0.0)
            level = float(np.clip(shares, 0.0, 1.0).min())
        return line.point, status, level


class SetsKernel:
    """A `Vectored` of the extension module in place of the NumPy implementation."""

    engine = 'C'

    def __init__(self, kernel: Any, other: SetsNumpy) -> None:
        self.allocate, self.allocate_batch = kernel.allocate, kernel.allocate_batch
        self.explain = other.explain
