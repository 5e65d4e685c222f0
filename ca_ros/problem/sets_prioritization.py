"""Priorities of the axes where effectors are vectors in convex sets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.kernel.vectored import priorities, sets_newton
from ca_ros.problem.interior import INSIDE
from ca_ros.problem.limits import Limits
from ca_ros.problem.prioritization import (
    AIRMODE,
    AXIS_REVERSAL,
    LAG,
    LAG_RATIO,
    Prioritization,
    Served,
    sensed,
)
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.sets_limits import limits_of_vectors
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import ConvexSets, Interval
from ca_ros.solver.faces import LEVEL, face, independent, whole
from ca_ros.solver.least_norm_over_sets import SetsNewton

PRIORITY_TOLERANCE = 1e-7
"""How far a more important axis may give way to the next steps, as a share of its range."""

MOVED = 1e-6
"""Change of a more important axis, as a share of its range, for which a step is left out."""

STILL = 1e-12  # distance to a goal, as a share of an axis's range, that counts as none


class SetsPrioritization:
    """Serve groups of axes in the order of their priority.

    The steps and their meaning are those of `ca_ros.problem.prioritization.Prioritization`.  Each
    goes along a line to the boundary of the attainable set, while the axes of the steps before it
    are kept at a value or in a range.  Where a step ends on the boundary, only the vectors with
    the greatest product with its normal can serve as much.  They are a face of the sets, and the
    later steps use this face alone, so they take nothing from the step.

    `groups`, `reference`, `axis_reversal` and `begin`: as in `Prioritization`, whose
    `airmode_limit` is refused: a ParameterError.  `solver`: has weights and preferred vectors.
    """

    def __init__(
        self, problem: AllocationProblem, groups: Sequence[Sequence[int]],
        reference: Array | None = None, axis_reversal: str = AXIS_REVERSAL,
        begin: Array | None = None, airmode_limit: Sequence[float] = AIRMODE,
        solver: SetsNewton | None = None,
    ) -> None:
        refuse_limits(airmode_limit)
        program: Any = problem.program
        self.problem, self.solver = problem, solver or program.least_norm
        self.groups = [list(group) for group in groups]
        self.reference = problem.reference if reference is None else reference
        named = [[problem.axes[row] for row in group] for group in groups]
        first = self.groups[0]
        middle = problem.gamma[first] @ problem.middle
        goal = (self.reference if begin is None else begin)[first]
        usual = bool((self.reference == problem.reference).all())
        if usual and begin is None and problem.interior.has_reference_near_middle:
            share = 1.0
        else:
            reached = sets_newton(problem.gamma[first], self.solver.sets).line(
                middle, goal - middle, 1.0 / INSIDE).length
            share = min(1.0, INSIDE * reached)
        self.begin = goal if share > 1.0 - 1e-9 else middle + share * (goal - middle)
        keeps = [problem.axes.index(axis) for axis in sensed(named, axis_reversal)]
        self.senses: list[int] = []
        if not usual or not problem.interior.has_reference:
            served = problem.gamma @ self._answer(self.reference, self.solver)[0]
            off = np.abs(served - self.reference) / problem.extent
            keeps = [row for row in keeps if off[row] <= 10.0 * PRIORITY_TOLERANCE]
        self.senses = keeps

    def __call__(self, u: Array) -> Served:
        """Return the served wrenches for demands (..., m) [N, N m]."""
        problem = self.problem
        if u.ndim > 1:
            # One row of wrenches, levels, whether reached and thrusts for each demand.
            found = zip(*[self(row)[:4] for row in u.reshape(-1, u.shape[-1])], strict=True)
            parts = [np.array(part) for part in found]
            return Served(*[part.reshape(*u.shape[:-1], *part.shape[1:]) for part in parts])
        point, share = self._answer(u, self.solver, self._kernel)
        served, way = problem.gamma @ point, u - self.reference
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            levels = np.clip(np.where(way != 0.0, (served - self.reference) / way, 0.0), 0.0, 1.0)
        if (self.begin == self.reference[self.groups[0]]).all():
            levels[self.groups[0]] = share
        met = np.abs(served - u) <= PRIORITY_TOLERANCE * problem.extent
        levels[met] = 1.0
        return Served(served, levels, np.asarray(met.all()), point)

    def moved(self, u: Array, sets: ConvexSets) -> Array:
        """Return the wrench (m,) that is served for u (m,) with other sets, such as wider ones."""
        given = self.solver.weights, self.solver.preferred
        solver = sets_newton(self.problem.gamma, sets, *given)
        return np.asarray(self.problem.gamma @ self._answer(u, solver)[0], float)

    def limits(
        self, u: Array, served: Array, within: AllocationProblem, by_rate: BoolArray
    ) -> tuple[Limits, BoolArray]:
        """Return what limits the axes; see `limits_of_vectors`."""
        best, serve = self(u).thrusts, partial(self.moved, u)
        return limits_of_vectors(self.problem, u, best, served, serve, by_rate)

    @property
    def fields(self) -> dict[str, Array]:
        """The fields of the priorities in ``ca_vectored`` in C."""
        problem, m = self.problem, len(self.problem.axes)
        begin, sense = np.zeros(m), np.zeros(m)
        begin[self.groups[0]], sense[self.senses] = self.begin, 1.0
        groups = np.repeat(np.arange(len(self.groups)), [len(group) for group in self.groups])
        return {
            'reference': self.reference, 'extent': problem.extent, 'middle': problem.middle,
            'order': np.concatenate(self.groups), 'group': groups, 'sense': sense,
            'line_begin': begin,
        }

    @cached_property
    def _kernel(self) -> Any:
        return priorities(self.solver, self.fields)

    def _answer(self, u: Array, solver: SetsNewton, kernel: Any = None) -> tuple[Array, float]:
        """Return vectors (n,), and the share of its line that the first group went."""
        kernel = kernel or priorities(solver, self.fields)
        if kernel is None:
            run = self._serve(u, solver)
            return run.point, run.share
        point = np.empty(self.problem.n)
        return point, kernel.prioritize(np.ascontiguousarray(u, float), point)

    def _serve(self, u: Array, solver: SetsNewton) -> _Run:
        run, (first, *later) = _Run(self.problem, solver), self.groups
        way = u[first] - self.begin
        if np.abs(way / self.problem.extent[first]).max() > STILL:
            run.share = run.go(first, self.begin, way, 1.0)
        else:
            run.go(first, self.begin, self.problem.extent[first], 0.0)
        if run.share == 1.0:
            run.hold(first, u[first], u[first])
        for row in self.senses:
            run.attempt(run.bring, row, *sorted((float(u[row]), float(self.reference[row]))))
        for group in later:
            if len(group) > 1:
                run.attempt(self._approach, run, group, u)
            for row in group:
                run.attempt(run.bring, row, float(u[row]), float(u[row]))
        run.attempt(run.settle)
        return run

    def _approach(self, run: _Run, group: Sequence[int], u: Array) -> None:
        """Bring all axes of a group as near to their demands as possible, by the same share."""
        extent = self.problem.extent
        off = np.abs(u - self.reference) / extent
        shares = np.maximum(np.maximum(off, LAG) / max(*off[group], LAG), LAG_RATIO) * extent
        rows = [row for row in group if run.moves(row)]
        while rows:
            before = run.copy()
            left = (u - run.wrench)[rows]
            most = float(np.abs(left / shares[rows]).max())
            if most <= STILL:
                return
            way = np.where(left < 0.0, -1.0, 1.0) * shares[rows]
            length = run.go(rows, u[rows] - most * way, way, most, most * way)
            beyond = (run.wrench - u)[rows] * np.sign(way) > PRIORITY_TOLERANCE * extent[rows]
            if not beyond.any():
                if length >= most:
                    run.hold(rows, u[rows], u[rows])
                return
            # Axes that went beyond can be at their demands: hold them there, and begin again.
            run.__dict__.update(before.__dict__)
            ahead = [row for row, each in zip(rows, beyond, strict=True) if each]
            run.hold(ahead, u[ahead], u[ahead])
            rows = [row for row in rows if row not in ahead]


FREE, KEPT, IMPLIED = range(3)


class _Run:
    """Vectors so far, what is left of their sets, and what the axes have to keep.

    Axes that are `IMPLIED` follow from the face and the axes that are kept.
    """

    def __init__(self, problem: AllocationProblem, solver: SetsNewton) -> None:
        self.problem, self.solver, self.share = problem, solver, 1.0
        self.parts, self.point = whole(solver.sets), np.array(problem.middle)
        m = len(problem.axes)
        self.state, self.low, self.high = np.full(m, FREE), np.zeros(m), np.zeros(m)

    def copy(self) -> _Run:
        """Return a run that goes on from here."""
        other = copy(self)
        other.parts, other.state = self.parts.copy(), self.state.copy()
        other.low, other.high = self.low.copy(), self.high.copy()
        return other

    def moves(self, row: int) -> bool:
        """Tell whether an axis may still move."""
        return bool(self.state[row] == FREE or (
            self.state[row] == KEPT and self.low[row] < self.high[row]))

    @property
    def wrench(self) -> Array:
        """What the vectors give (m,)."""
        return np.asarray(self.problem.gamma @ self.point, float)

    def hold(self, rows: Sequence[int], low: Array | float, high: Array | float) -> None:
        """Keep axes in ranges from now on, unless they follow from others."""
        self.low[rows], self.high[rows], self.state[rows] = low, high, KEPT

    def attempt(self, step: Callable[..., None], *given: Any) -> None:
        """Take a step, and undo it if it moved an axis of the steps before it.

        Near a curved boundary the normal may not be exact enough to tell the face.
        """
        before, kept, axes = self.copy(), self.wrench, self.state != FREE
        step(*given)
        held, rounding = before.state == KEPT, MOVED * self.problem.extent
        low = np.where(held, np.minimum(kept, before.low), kept) - rounding
        high = np.where(held, np.maximum(kept, before.high), kept) + rounding
        if ((self.wrench < low) | (self.wrench > high))[axes].any():
            self.__dict__.update(before.__dict__)

    def bring(self, row: int, low: float, high: float) -> None:
        """Bring an axis into a range, or as near to it as possible, and keep it there."""
        at, extent = float(self.wrench[row]), float(self.problem.extent[row])
        if self.state[row] == KEPT:
            low, high = np.clip((low, high), self.low[row], self.high[row]).tolist()
        goal = min(max(at, low), high)
        if self.state[row] == IMPLIED:
            return
        if abs(goal - at) > STILL * extent:
            way = extent if goal > at else -extent
            # From behind, so that the length is not small.
            end = 1.0 + (goal - at) / way
            if self.go([row], np.array([at - way]), np.array([way]), end) < end:
                return
        self.hold([row], low, high)

    def go(
        self, rows: Sequence[int], begin: Array, way: Array, end: float, spare: Array | None = None
    ) -> float:
        """Move axes along ``begin + t way`` as far as possible, at most to t = end; return t.

        An axis may be ahead of the line by up to `spare` (k,).
        """
        m, extent = len(self.problem.axes), self.problem.extent
        goals, ways, low, high = np.zeros(m), np.zeros(m), self.low.copy(), self.high.copy()
        goals[rows], ways[rows] = begin, way
        low[rows] = high[rows] = 0.0
        if spare is not None:
            low[rows], high[rows] = np.minimum(spare, 0.0), np.maximum(spare, 0.0)
        kept = [row for row in range(m) if self.state[row] == KEPT and row not in rows]
        wide = [row for row in [*kept, *rows] if low[row] < high[row]]
        goals[kept] = np.where(low[kept] < high[kept], 0.0, low[kept])
        order = [row for row in kept if row not in wide] + [row for row in kept if row in wide]
        newton, columns, use = self._left(order + list(rows), wide, low, high)
        if newton is None or not set(rows) <= set(use):
            self.state[list(set(rows) - set(use))] = IMPLIED
            return 0.0 if spare is not None or len(rows) > 1 else 1.0
        u = (goals - self.problem.gamma @ self._base)[use]
        line = newton.line(u, ways[use], end)
        self.point = self._base + columns @ line.point[: columns.shape[1]]
        if line.length >= end:
            return end
        normal = np.zeros(m)
        normal[use] = line.normal
        rise = float(normal[rows] @ way)
        # Of nearly dependent axes, such as after a short period, the normal may be lost.
        normal *= np.abs(way / extent[rows]).max() / rise if rise > 0.0 else 0.0
        widths = np.where(np.isin(np.arange(m), wide), high - low, 0.0)
        self.state[rows] = KEPT
        at = goals + line.length * ways
        ahead = at if spare is None else goals + end * ways
        self.low[rows], self.high[rows] = np.minimum(at, ahead)[rows], np.maximum(at, ahead)[rows]
        for row in use:
            if self.low[row] < self.high[row] and abs(normal[row]) * widths[row] > LEVEL:
                self.low[row] = self.high[row] = self.wrench[row]
        if rise > 0.0:
            self._reduce(normal)
            self.state[rows[int(np.argmax(np.abs(normal[rows] * extent[rows])))]] = IMPLIED
        return line.length

    def settle(self) -> None:
        """Take the vectors of least cost that give the same wrench."""
        m = len(self.problem.axes)
        rows = [row for row in range(m) if self.state[row] != IMPLIED]
        newton, columns, use = self._left(rows, [], self.low, self.high)
        if newton is None:
            return
        goals = np.where(self.low == self.high, self.low, self.wrench)
        found = newton.solve((goals - self.problem.gamma @ self._base)[None, use])
        if found.attained[0]:
            self.point = self._base + columns @ found.points[0]
        self.point = self.solver.sets.project(self.point)

    @property
    def _base(self) -> Array:
        return np.concatenate([part.base for part in self.parts])

    def _left(
        self, rows: Sequence[int], wide: Sequence[int], low: Array, high: Array
    ) -> tuple[SetsNewton | None, Array, list[int]]:
        """Return the problem of what is left, its columns, and the rows that are independent."""
        problem, solver = self.problem, self.solver
        count = sum(part.ways.shape[1] for part in self.parts)
        columns, sets, k = np.zeros((problem.n, count)), [], 0
        for part, first in zip(self.parts, solver.sets.first, strict=True):
            size, more = part.ways.shape
            columns[first : first + size, k : k + more] = part.ways
            k += more
            sets += [part.shape] if part.shape is not None else []
        weights = solver.weights @ columns**2
        preferred = (solver.preferred - self._base) @ columns
        units = problem.extent[wide] / solver.greatest
        sets += [Interval(low[row] / unit, high[row] / unit)
                 for row, unit in zip(wide, units, strict=True)]
        matrix = np.hstack([problem.gamma @ columns, np.zeros((len(problem.axes), len(wide)))])
        matrix[wide, count + np.arange(len(wide))] = -units
        weights = np.concatenate([weights, np.ones(len(wide))])
        preferred = np.concatenate([preferred, np.zeros(len(wide))])
        use = [rows[i] for i in independent(matrix[rows] / weights)] if sets else []
        if not use:
            return None, columns, use
        return sets_newton(matrix[use], ConvexSets(sets), weights, preferred), columns, use

    def _reduce(self, normal: Array) -> None:
        """Keep the face of the sets that a normal of the boundary touches."""
        slopes = normal @ self.problem.gamma
        for i, (part, first) in enumerate(zip(self.parts, self.solver.sets.first, strict=True)):
            place = slice(first, first + len(part.base))
            self.parts[i] = face(part, slopes[place], self.point[place], LEVEL)


AnyPrioritization = Prioritization | SetsPrioritization

PRIORITIZATIONS: dict[str, type[AnyPrioritization]] = {
    'exact': Prioritization, 'vectored': SetsPrioritization}
"""By the name of the kernel that allocates: `BoxProgram.kernel`."""


def refuse_limits(airmode_limit: Sequence[float]) -> None:
    """Raise a `ParameterError` if airmode is limited: vectors are served without limits."""
    if min(airmode_limit) < 1.0:
        limits = list(airmode_limit)
        raise ParameterError(f'airmode_limit: expected 1 for rotors that tilt, got {limits}')
