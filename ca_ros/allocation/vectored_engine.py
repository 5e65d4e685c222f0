"""The engine of the exact allocator for effectors that are vectors in convex sets."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ca_ros.allocation.exact_settings import ExactSettings, Serving
from ca_ros.allocation.result import Status
from ca_ros.arrays import Array, IntArray
from ca_ros.problem.prioritization import airmode_limits
from ca_ros.problem.problem import EXACT_TOLERANCE, lengths
from ca_ros.problem.vectored import VectoredProblem
from ca_ros.problem.vectored_priorities import VectoredPrioritization, refuse_limits
from ca_ros.solver.interior_point import minimize
from ca_ros.solver.sets_newton import SetsNewton

COST_GAP = 1e-10
"""By how much the cost may exceed the least one near the boundary, as a share of its scale."""


class VectoredEngine:
    """The NumPy implementation of `exact` on a `VectoredProblem`.

    Newton's method answers attainable wrenches.  On the boundary of the attainable set there may
    be no finite multipliers; there, and outside, an interior-point method finds the wrench to
    serve, and the vectors of least cost if Newton's method does not.
    """

    def __init__(self, problem: VectoredProblem, settings: ExactSettings) -> None:
        if not problem.has_volume:
            raise problem.no_volume()
        self._problem, self._settings = problem, settings
        settings.groups(problem.axes)
        refuse_limits(airmode_limits(settings.airmode_limit))
        preference = settings.preference(problem) or (None, None)
        self._solver = SetsNewton(problem.gamma, problem.sets, *preference)

    @cached_property
    def _serving(self) -> Serving:
        return self._settings.serving(self._problem)

    @cached_property
    def _line(self) -> VectoredPrioritization:
        """The last attainable point on a line to a demand."""
        serving = self._serving
        rows = [list(range(len(self._problem.axes)))]
        begin = serving.reference if serving.on_reference else None
        return VectoredPrioritization(self._problem, rows, serving.reference, begin=begin)

    @cached_property
    def _serve(self) -> VectoredPrioritization:
        if self._settings.status is not Status.PRIORITIZED:
            return self._line
        axes, serving = self._problem.axes, self._serving
        rows = [[axes.index(axis) for axis in group] for group in serving.groups]
        return VectoredPrioritization(
            self._problem, rows, serving.reference, serving.thrust_deviation
        )

    def allocate(self, u: Array, thrusts: Array) -> tuple[int, float, int, int] | None:
        """Write the vectors for u; see `ca_ros.kernel.Kernel.allocate`."""
        status, level = np.empty(1, np.int8), np.empty(1)
        demand = self._problem.check(u)
        self.allocate_batch(demand[None], thrusts[None], status, level, None)
        return None if status[0] == Status.EXACT else (int(status[0]), float(level[0]), 0, 0)

    def allocate_batch(
        self, wrenches: Array, thrusts: Array, status: IntArray, levels: Array, work: None
    ) -> None:
        """Write vectors, status and levels for wrenches; see `Kernel.allocate_batch`."""
        problem = self._problem
        tolerance = problem.tolerance(wrenches)
        found = self._solver.solve(wrenches, tolerance)
        thrusts[:], status[:], levels[:] = found.points, Status.EXACT, 1.0
        missed = lengths(wrenches - found.points @ problem.gamma.T)
        size = tolerance / EXACT_TOLERANCE
        near = ~found.unattainable & (missed <= self._settings.residual_slack * size)
        for i in np.flatnonzero(~(found.attained | near)):
            slack = float(self._settings.residual_slack * size[i])
            answer = self._other(wrenches[i], bool(found.unattainable[i]), slack)
            thrusts[i], status[i], levels[i] = answer

    def _other(self, u: Array, unattainable: bool, slack: float) -> tuple[Array, int, float]:
        """Return the vectors, status and level of a wrench that Newton's method cannot serve."""
        problem, status = self._problem, self._settings.status
        if not unattainable:
            served = self._line(u)
            missed = float(lengths(u - served.wrenches))
            if served.reached or missed <= slack:
                return self._least(served.wrenches, served.thrusts), Status.EXACT, 1.0
        if status is Status.REJECTED:
            return problem.resting_thrusts, status, 0.0
        served = self._serve(u)
        return (
            self._least(served.wrenches, served.thrusts), status, float(served.levels.min())
        )

    def _least(self, u: Array, point: Array) -> Array:
        """Return the vectors of least cost for an attainable wrench, from some that give it."""
        problem, solver = self._problem, self._solver
        found = solver.solve(u[None], np.atleast_1d(problem.tolerance(u)))
        if found.attained[0] or not (problem.sets.slacks(point) > 0.0).all():
            return np.asarray(found.points[0] if found.attained[0] else point, float)
        scale = max(1.0, float(solver.cost(point)))
        curvature = solver.weights**2 / scale
        least = minimize(
            problem.sets, problem.gamma, problem.gamma @ point, -curvature * solver.preferred,
            point, COST_GAP, curvature,
        ).point
        least = problem.clip(least)
        better = lengths(u - problem.gamma @ least) <= problem.tolerance(u)
        return least if better and solver.cost(least) < solver.cost(point) else point
