"""Priorities of the axes where effectors are vectors in convex sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.prioritization import (
    AIRMODE,
    LAG,
    THRUST_DEVIATION,
    Prioritization,
    Served,
    sensed,
)
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vectored import VectoredProblem
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import ConvexSet, ConvexSets, Interval
from ca_ros.solver.interior_point import minimize

YIELD = 1e-7
"""How far a more important axis may give way to the next steps, as a share of its range."""

BEYOND = 1.001
"""How far lines go beyond the demand, so that a demand inside the set is seen to be inside."""

INSIDE = 0.99  # greatest share of the way from the middle to the boundary where a line may begin


@dataclass
class _State:
    """A point inside the sets, and the ranges of the axes that are already served."""

    point: Array
    ranges: dict[int, tuple[float, float]] = field(default_factory=dict)


class VectoredPrioritization:
    """Serve groups of axes in the order of their priority.

    The steps and their meaning are those of `ca_ros.problem.prioritization.Prioritization`.  Each
    is a convex program over the sets, solved by an interior-point method.  A later step may move
    a more important axis by `YIELD` of its range.  So each axis is served at least as far as with
    exact priorities, except for this share.

    `groups`, `reference`, `thrust_deviation` and `begin`: as in `Prioritization`.
    """

    def __init__(
        self, problem: VectoredProblem, groups: Sequence[Sequence[int]],
        reference: Array | None = None, thrust_deviation: str = THRUST_DEVIATION,
        begin: Array | None = None,
    ) -> None:
        self._problem = problem
        self._first, *self._later = (list(group) for group in groups)
        self._reference = problem.reference if reference is None else reference
        named = [[problem.axes[row] for row in group] for group in groups]
        keeps = [problem.axes.index(axis) for axis in sensed(named, thrust_deviation)]
        rows = problem.gamma[self._first]
        middle = rows @ problem.middle
        self._start, self._begin = problem.middle, middle
        wanted = (self._reference if begin is None else begin)[self._first]
        reached = problem.line(
            self._first, problem.middle, middle, wanted - middle, 1.0 / INSIDE
        ).length
        share = min(1.0, INSIDE * reached)
        if share > 1.0 - 1e-9:
            self._begin = wanted
        else:
            self._begin = middle + share * (wanted - middle)
        # The middle of all points that give the wrench where lines begin.
        found = minimize(
            problem.sets, rows, self._begin, np.zeros(problem.n), problem.middle,
            problem.sets.complexity,
        )
        self._start = found.point
        self._senses: list[int] = []
        rest = problem.gamma @ self._serve(self._reference)[0]
        off = np.abs(rest - self._reference) / problem.extent
        self._senses = [row for row in keeps if off[row] <= 10.0 * YIELD]

    def __call__(self, u: Array) -> Served:
        """Return the served wrenches for demands (..., m) [N, N m]."""
        problem = self._problem
        if u.ndim > 1:
            found = [self(row) for row in u.reshape(-1, u.shape[-1])]
            rows = [served[:4] for served in found]
            wrenches, levels, reached, thrusts = map(np.array, zip(*rows, strict=True))
            shape = u.shape[:-1]
            return Served(
                wrenches.reshape(u.shape), levels.reshape(u.shape), reached.reshape(shape),
                thrusts.reshape(*shape, problem.n),
            )
        point, share = self._serve(u)
        thrusts = problem.clip(point)
        served = problem.gamma @ thrusts
        way = u - self._reference
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            levels = np.clip(np.where(way != 0.0, (served - self._reference) / way, 0.0), 0.0, 1.0)
        if (self._begin == self._reference[self._first]).all():
            levels[self._first] = min(share, 1.0)
        near = np.abs(served - u) <= 2.0 * YIELD * problem.extent
        levels[near & (levels > 1.0 - 1e-6)] = 1.0
        return Served(served, levels, np.asarray(share >= 1.0 and near.all()), thrusts)

    def _serve(self, u: Array) -> tuple[Array, float]:
        """Return a point (n,) that serves a demand, and the share of the first group."""
        problem = self._problem
        way = u[self._first] - self._begin
        point, share, *_ = problem.line(self._first, self._start, self._begin, way, BEYOND)
        if share > 1.0:
            # Back on the straight line to the demand, which is inside.
            point = self._start + (point - self._start) / share
        state = _State(point)
        if not self._later and not self._senses:
            return point, share
        share = min(share, 1.0)
        for row, begin, off in zip(self._first, self._begin, way, strict=True):
            at = float(begin + share * off)
            state.ranges[row] = at - self._slack(row), at + self._slack(row)
        for row in self._senses:
            self._bring(state, row, *sorted((float(u[row]), float(self._reference[row]))))
        for group in self._later:
            if len(group) > 1:
                self._approach(state, group, u)
            for row in group:
                self._bring(state, row, float(u[row]), float(u[row]))
        return state.point, share

    def _slack(self, row: int) -> float:
        return YIELD * float(self._problem.extent[row])

    def _bring(self, state: _State, row: int, low: float, high: float) -> None:
        """Bring an axis into a range, or as near to it as possible, and keep it there."""
        slack, extent = self._slack(row), float(self._problem.extent[row])
        at = float(self._problem.gamma[row] @ state.point)
        before = state.ranges.get(row, (-np.inf, np.inf))
        if not low <= at <= high:
            goal, sign = (low, 1.0) if at < low else (high, -1.0)
            ends = sorted((at - sign * slack, goal + sign * slack))
            ends = [max(ends[0], before[0]), min(ends[1], before[1])]
            state.ranges[row] = ends[0], ends[1]
            self._minimise(state, {row: -sign / extent})
            at = float(self._problem.gamma[row] @ state.point)
            if abs(at - goal) > 2.0 * slack:
                low, high = sorted((at, goal))
        state.ranges[row] = max(low - slack, before[0]), min(high + slack, before[1])

    def _approach(self, state: _State, group: Sequence[int], u: Array) -> None:
        """Bring all axes of a group as near to their demands as possible, by the same share."""
        problem = self._problem
        extent = problem.extent[group]
        off = np.abs(u[group] - self._reference[group]) / extent
        shares = np.maximum(off, LAG) / max(float(off.max()), LAG)
        rows = problem.gamma[group] / (extent * shares)[:, None]
        goals = u[group] / (extent * shares)
        missed = rows @ state.point - goals
        begin = float(np.abs(missed).max()) + 0.1
        # Each |row - goal| <= lag is two equations with a slack each.
        k, ends = len(group), Interval(0.0, 3.0 * begin)
        extra: list[ConvexSet] = [Interval(-0.1, begin + 0.1), *[ends] * (2 * k)]
        matrix = np.zeros((2 * k, problem.n + 1 + 2 * k))
        matrix[:k, : problem.n], matrix[k:, : problem.n] = rows, rows
        matrix[:k, problem.n], matrix[k:, problem.n] = -1.0, 1.0
        matrix[:k, problem.n + 1 : problem.n + 1 + k] = np.eye(k)
        matrix[k:, problem.n + 1 + k :] = -np.eye(k)
        start = np.concatenate([[begin], begin - missed, begin + missed])
        lag = self._minimise(state, {}, (extra, matrix, np.tile(goals, 2), start))
        for row, share, width in zip(group, shares, extent, strict=True):
            reach = (max(lag, 0.0) * share + YIELD) * width
            before = state.ranges.get(row, (-np.inf, np.inf))
            state.ranges[row] = max(u[row] - reach, before[0]), min(u[row] + reach, before[1])

    def _minimise(
        self, state: _State, costs: dict[int, float],
        more: tuple[list[ConvexSet], Array, Array, Array] | None = None,
    ) -> float:
        """Move the point to the least cost of axes, or of the first of more variables."""
        problem = self._problem
        extra, matrix, goal, start = more or ([], np.zeros((0, problem.n)), np.zeros(0), [])
        held = list(state.ranges)
        extent = problem.extent[held]
        ends = [Interval(*(np.array(state.ranges[row]) / problem.extent[row])) for row in held]
        sets = ConvexSets([*problem.sets.sets, *extra, *ends])
        wide = np.zeros((len(held) + len(goal), sets.n))
        wide[: len(held), : problem.n] = problem.gamma[held] / extent[:, None]
        wide[: len(held), problem.n + len(start) :] = -np.eye(len(held))
        wide[len(held) :, : problem.n + len(start)] = matrix
        cost = np.zeros(sets.n)
        if extra:
            cost[problem.n] = 1.0
        for row, each in costs.items():
            cost[problem.n + len(start) + held.index(row)] = each * problem.extent[row]
        values = problem.gamma[held] @ state.point / extent
        # Rounding may have put the point on the end of a range.
        low, high = np.array(list(state.ranges.values())).T / extent
        inner = np.minimum(np.maximum(values, 0.9 * low + 0.1 * high), 0.1 * low + 0.9 * high)
        values = np.where((values > low) & (values < high), values, inner)
        begin = np.concatenate([state.point, start, values])
        goals = np.concatenate([np.zeros(len(held)), goal])
        found = minimize(sets, wide, goals, cost, begin, 0.1 * YIELD).point
        state.point = found[: problem.n]
        return float(found[problem.n]) if extra else 0.0


AnyPrioritization = Prioritization | VectoredPrioritization


def prioritization_of(
    problem: AllocationProblem, groups: Sequence[Sequence[int]], reference: Array | None = None,
    thrust_deviation: str = THRUST_DEVIATION, begin: Array | None = None,
    airmode_limit: Sequence[float] = AIRMODE,
) -> AnyPrioritization:
    """Return the prioritization of a problem; see `Prioritization` for the arguments.

    Raises a ParameterError if airmode is limited for effectors that are vectors.
    """
    if not isinstance(problem, VectoredProblem):
        return Prioritization(problem, groups, reference, thrust_deviation, begin, airmode_limit)
    refuse_limits(airmode_limit)
    return VectoredPrioritization(problem, groups, reference, thrust_deviation, begin)


def refuse_limits(airmode_limit: Sequence[float]) -> None:
    """Raise a `ParameterError` if airmode is limited: vectors are served without limits."""
    if min(airmode_limit) < 1.0:
        limits = list(airmode_limit)
        raise ParameterError(f'airmode_limit: expected 1 for rotors that tilt, got {limits}')
