"""The attainable set of vectors in convex sets, known by its support function."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vectored import VectoredProblem
from ca_ros.solver.convex_sets import ConvexSets, Interval
from ca_ros.solver.zonotope import Zonotope

SETTLED = 1e-9  # share by which a margin may still shrink when the search for it ends
SEARCHES = 20  # limit of the lines or points of one search for a margin
NEAR = 1e-2  # weight of the vectors beside the distance to a set
DIRECTIONS = 72  # corners of a section
DRAWS = 4096  # wrenches that are drawn at a time


class SupportedSet:
    """All wrenches B x of vectors x in convex sets.

    The set has no list of facets.  Lines to its boundary (`SetsNewton.line`) and the support
    function of the sets, which bounds it from outside, take their place.
    """

    def __init__(self, problem: VectoredProblem) -> None:
        self.problem = problem
        self._all = list(range(len(problem.axes)))

    def margin(self, u: Array) -> Array:
        """Return the signed distance of wrenches (..., m), positive inside [N, N m].

        Inside, it is the upper bound of `margin_bounds`.
        """
        rows = u.reshape(-1, u.shape[-1])
        return np.array([self._nearest(row)[0] for row in rows]).reshape(u.shape[:-1])

    def margin_bounds(self, u: Array) -> tuple[float, float]:
        """Return a lower and an upper bound of the signed distance of a wrench (m,) [N, N m].

        The upper bound is the distance to a plane that touches the set.  It is the distance to
        the boundary if no other part of the boundary is nearer than those that the search found.
        Inside, the lower bound is the radius of the ball in the hull of points on the boundary.
        """
        most, normal = self._nearest(u)
        if most <= 0.0:
            height = float(normal @ u - self.problem.sets.support(normal @ self.problem.gamma))
            return most, -height
        frame = np.linalg.qr(np.column_stack([normal, np.eye(len(u))]))[0].T
        lengths = [min(self._shoot(u, way)[0], self._shoot(u, -way)[0]) for way in frame]
        return float(1.0 / np.sqrt((1.0 / np.square(lengths)).sum())), most

    def contains(self, u: Array, tolerance: float = 0.0) -> BoolArray:
        """Tell which wrenches (..., m) are in the set or at most `tolerance` away from it."""
        problem, rows = self.problem, u.reshape(-1, u.shape[-1])
        found = problem.least_norm.solve(rows)
        inside = found.attained.copy()
        for i in np.flatnonzero(~inside):
            most = max(tolerance, float(problem.tolerance(rows[i])))
            # Often the multipliers already give a plane between the wrench and the set.
            normal = found.multipliers[i]
            apart = -self._plane(rows[i], normal)[0] if normal.any() else 0.0
            inside[i] = apart <= most and self._outside(rows[i])[0] >= -most
        return inside.reshape(u.shape[:-1])

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw wrenches (size, m) uniformly by volume [N, N m], from the box around the set."""
        problem, found, count = self.problem, [np.zeros((0, len(self._all)))], 0
        while count < size:
            drawn = problem.center + problem.extent * rng.uniform(-1, 1, (DRAWS, len(self._all)))
            kept = drawn[problem.least_norm.solve(drawn).attained]
            found.append(kept)
            count += len(kept)
        return np.concatenate(found)[:size]

    def section(
        self, rows: Sequence[int], at: Array, directions: int = DIRECTIONS
    ) -> tuple[Array, float]:
        """Return points (k, d) on the outline of a section in one or two axes, and an error.

        The outline of the set is outside of the polygon of these points by at most the error, as
        a share of the range of its axis.

        `rows`: the axes that stay.  `at` (m,): the values of the other axes [N, N m].
        """
        ways, problem = _ways(rows, directions), self.problem
        others = [row for row in self._all if row not in rows]
        start = problem.middle
        if others:
            given = sets_newton(problem.gamma[others], problem.sets).solve(at[None, others])
            if not given.attained[0]:
                return np.zeros((0, len(rows))), 0.0
            start = given.points[0]
        begin = problem.gamma @ start
        for row in [*rows, *rows]:
            # To the middle of the section along each axis.
            way = problem.extent[row] * np.eye(len(self._all))[row]
            lines = [problem.least_norm.line(begin, sign * way) for sign in (1.0, -1.0)]
            begin = begin + 0.5 * (lines[0].length - lines[1].length) * way
        steps = np.zeros((len(ways), len(self._all)))
        steps[:, rows] = ways * problem.extent[rows]
        scaled = [problem.least_norm.line(begin, step) for step in steps]
        lengths = np.array([line.length for line in scaled])
        points = begin[rows] + lengths[:, None] * ways * problem.extent[rows]
        if len(rows) == 1:
            return points, max(line.most - line.length for line in scaled)
        # Between neighbours the set is convex: it stays below the lines of the edges before.
        corners = lengths[:, None] * ways
        return points, _bulge(np.roll(corners, -1, axis=0) - corners)

    def shadow(self, rows: Sequence[int], directions: int = DIRECTIONS) -> Array:
        """Return points (k, d) on the outline of the projection to one or two axes."""
        ways, gamma = _ways(rows, directions), self.problem.gamma[rows]
        farthest = self.problem.sets.farthest(ways / self.problem.extent[rows] @ gamma)
        return np.asarray(farthest @ gamma.T, float)

    def _shoot(self, u: Array, way: Array) -> tuple[float, Array]:
        """Return the distance to the boundary from an inner wrench, and the normal there."""
        line = self.problem.least_norm.line(u, way)
        return line.length * float(np.linalg.norm(way)), line.normal

    def _nearest(self, u: Array) -> tuple[float, Array]:
        """Return the signed distance to the nearest boundary found, and its unit normal."""
        outside = self._outside(u)
        if outside[0] < 0.0:
            return outside
        # A plane that touches the set where a line along the normal of another one ends is nearer
        # than that one.
        starts = np.concatenate([np.diag(self.problem.extent), -np.diag(self.problem.extent)])
        shots = [self._plane(u, self._shoot(u, way)[1]) for way in starts]
        least, normal = min(shots, key=lambda shot: shot[0])
        for _ in range(SEARCHES):
            nearer, other = self._plane(u, self._shoot(u, normal)[1])
            if nearer >= least * (1.0 - SETTLED):
                break
            least, normal = nearer, other
        return least, normal

    def _plane(self, u: Array, normal: Array) -> tuple[float, Array]:
        unit = normal / np.linalg.norm(normal)
        return float(self.problem.sets.support(unit @ self.problem.gamma) - unit @ u), unit

    def _outside(self, u: Array) -> tuple[float, Array]:
        """Return minus the distance of a wrench from the set, and its direction; 0 inside."""
        problem, m = self.problem, len(u)
        matrix, point = np.hstack([problem.gamma, np.eye(m)]), problem.middle
        reach = 2.0 * float(np.abs(u - problem.gamma @ point).max()) + 1.0
        sets = ConvexSets([*problem.sets.sets, *[Interval(-reach, reach)] * m])
        weights = np.concatenate([np.full(problem.n, NEAR), np.ones(m)])
        for _ in range(SEARCHES):
            # The cost of moving away from the last point vanishes.
            preferred = np.concatenate([point, np.zeros(m)])
            found = sets_newton(matrix, sets, weights, preferred).solve(u[None]).points[0]
            point, missed = found[: problem.n], found[problem.n :]
            distance = float(np.linalg.norm(missed))
            if distance < 1e-7 * float(problem.extent.max()):
                return 0.0, missed
            least = float(missed @ u - problem.sets.support(missed @ problem.gamma))
            if least >= (1.0 - SETTLED) * distance**2:
                break
        return -distance, missed / distance


def _ways(rows: Sequence[int], directions: int) -> Array:
    """Return unit vectors (k, d) all around in one or two axes."""
    if len(rows) > 2:
        raise ValueError('axes: expected one or two for a set that is not a polytope')
    if len(rows) == 1:
        return np.array([[-1.0], [1.0]])
    angles = np.arange(directions) * 2.0 * np.pi / directions
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _bulge(edges: Array) -> float:
    """Return how far a convex outline can be outside of the edges (k, 2) of a polygon in it."""
    before, after = np.roll(edges, 1, axis=0), np.roll(edges, -1, axis=0)
    worst = 0.0
    for edge, first, last in zip(edges, before, after, strict=True):
        # The lines of the neighbouring edges meet above the edge.
        across = first[0] * last[1] - first[1] * last[0]
        if abs(across) < 1e-15:
            continue
        share = (edge[0] * last[1] - edge[1] * last[0]) / across
        apex = share * first
        length = float(np.hypot(*edge)) or 1.0
        height = abs(edge[0] * apex[1] - edge[1] * apex[0]) / length
        worst = max(worst, float(height) if share > 0.0 else 0.0)
    return worst


def attainable_set_of(problem: AllocationProblem) -> Zonotope | SupportedSet:
    """Return the attainable set of a problem; raise a ValueError if it has no volume."""
    if not isinstance(problem, VectoredProblem):
        return problem.attainable_set
    if not problem.has_volume:
        raise problem.no_volume()
    return SupportedSet(problem)
