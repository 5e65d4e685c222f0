"""The attainable set of vectors in convex sets, known by its support function."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.kernel.vectored import sets_newton
from ca_ros.solver.convex_sets import ConvexSets, Interval
from ca_ros.solver.least_norm_over_sets import TOLERANCE, SetsNewton

SETTLED = 1e-9  # share by which a margin may still shrink when the search for it ends
SEARCHES = 20  # limit of the lines or points of one search for a margin
NEAR = 1e-2  # weight of the vectors beside the distance to a set
DIRECTIONS = 72  # rays of a section, and then more
OUTLINE = 1e-3  # greatest distance of an outline from its set, as a share of the range of an axis
REFINEMENTS = 20  # how often a ray of an outline may be drawn between two others
DRAWS = 4096  # wrenches that are drawn at a time


class SupportedSet:
    """All wrenches B x of vectors x in convex sets, as in a solver.

    `center` and `extent` (m,): middle and half length of the range of each axis [N, N m].

    The set has no list of facets.  Lines to its boundary (`SetsNewton.line`) and the support
    function of the sets, which bounds it from outside, take their place.
    """

    def __init__(self, solver: SetsNewton, center: Array, extent: Array) -> None:
        self._solver, self._matrix, self._sets = solver, solver.matrix, solver.sets
        self._center, self._extent = center, extent

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
            return most, self._plane(u, normal)[0]
        frame = np.linalg.qr(np.column_stack([normal, np.eye(len(u))]))[0].T
        lengths = [min(self._shoot(u, way)[0], self._shoot(u, -way)[0]) for way in frame]
        return float(1.0 / np.sqrt((1.0 / np.square(lengths)).sum())), most

    def contains(self, u: Array, tolerance: float = 0.0) -> BoolArray:
        """Tell which wrenches (..., m) are in the set or at most `tolerance` away from it."""
        rows = u.reshape(-1, u.shape[-1])
        found = self._solver.solve(rows)
        inside = found.attained.copy()
        for i in np.flatnonzero(~inside):
            most = max(tolerance, TOLERANCE * max(1.0, float(np.linalg.norm(rows[i]))))
            # Often the multipliers already give a plane between the wrench and the set.
            normal = found.multipliers[i]
            apart = -self._plane(rows[i], normal)[0] if normal.any() else 0.0
            inside[i] = apart <= most and self._outside(rows[i])[0] >= -most
        return inside.reshape(u.shape[:-1])

    def nearest_facet(self, u: Array) -> None:
        """Return None: there is no list of facets."""

    def gauge(self, u: Array) -> Array:
        """Return how far out wrenches (..., m) are: 0 at an inner one, 1 on the boundary."""
        # The middles of the ranges may be outside together.
        inner = self._matrix @ self._sets.middle
        ways = u.reshape(-1, u.shape[-1]) - inner
        lengths = [
            self._solver.line(inner, way, np.inf).length if way.any() else np.inf
            for way in ways]
        return np.reshape(1.0 / np.array(lengths), u.shape[:-1])

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw wrenches (size, m) uniformly by volume [N, N m], from the box around the set."""
        m, count = len(self._center), 0
        found = [np.zeros((0, m))]
        while count < size:
            drawn = self._center + self._extent * rng.uniform(-1, 1, (DRAWS, m))
            kept = drawn[self._solver.solve(drawn).attained]
            found.append(kept)
            count += len(kept)
        return np.concatenate(found)[:size]

    def section(self, rows: Sequence[int], at: Array) -> Array:
        """Return points (k, d) on the outline of a section in one or two axes, see `_outline`.

        `rows`: the axes that stay.  `at` (m,): the values of the other axes [N, N m].
        """
        axes, start = np.diag(self._extent), self._sets.middle
        others = [row for row in range(len(at)) if row not in rows]
        if others:
            given = sets_newton(self._matrix[others], self._sets).solve(at[None, others])
            if not given.attained[0]:
                return np.zeros((0, len(rows)))
            start = given.points[0]
        begin = self._matrix @ start
        for row in [*rows, *rows]:
            # To the middle of the section along each axis.
            ends = [self._solver.line(begin, sign * axes[row]).length for sign in (1.0, -1.0)]
            begin = begin + 0.5 * (ends[0] - ends[1]) * axes[row]

        def end(way: Array) -> tuple[Array, Array]:
            line = self._solver.line(begin, way @ axes[rows])
            return begin[rows] + line.length * way * self._extent[rows], line.normal[rows]

        return _outline(rows, end)

    def shadow(self, rows: Sequence[int]) -> Array:
        """Return points (k, d) on the outline of the projection to one or two axes."""
        matrix = self._matrix[rows]

        def end(way: Array) -> tuple[Array, Array]:
            normal = way / self._extent[rows]
            return matrix @ self._sets.farthest(normal @ matrix), normal

        return _outline(rows, end)

    def _shoot(self, u: Array, way: Array) -> tuple[float, Array]:
        """Return the distance to the boundary from an inner wrench, and the normal there."""
        line = self._solver.line(u, way)
        return line.length * float(np.linalg.norm(way)), line.normal

    def _nearest(self, u: Array) -> tuple[float, Array]:
        """Return the signed distance to the nearest boundary found, and its unit normal."""
        outside = self._outside(u)
        if outside[0] < 0.0:
            return outside
        # A plane that touches the set where a line along the normal of another one ends is nearer
        # than that one.
        starts = np.concatenate([np.diag(self._extent), -np.diag(self._extent)])
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
        return float(self._sets.support(unit @ self._matrix) - unit @ u), unit

    def _outside(self, u: Array) -> tuple[float, Array]:
        """Return minus the distance of a wrench from the set, and its direction; 0 inside."""
        m, n, point = *self._matrix.shape, self._sets.middle
        matrix = np.hstack([self._matrix, np.eye(m)])
        reach = 2.0 * float(np.abs(u - self._matrix @ point).max()) + 1.0
        sets = ConvexSets([*self._sets.sets, *[Interval(-reach, reach)] * m])
        weights = np.concatenate([np.full(n, NEAR), np.ones(m)])
        for _ in range(SEARCHES):
            # The cost of moving away from the last point vanishes.
            preferred = np.concatenate([point, np.zeros(m)])
            found = sets_newton(matrix, sets, weights, preferred).solve(u[None]).points[0]
            point, missed = found[:n], found[n:]
            distance = float(np.linalg.norm(missed))
            if distance < 1e-7 * float(self._extent.max()):
                return 0.0, missed
            least = float(missed @ u - self._sets.support(missed @ self._matrix))
            if least >= (1.0 - SETTLED) * distance**2:
                break
        return -distance, missed / distance


def _outline(
    rows: Sequence[int], end: Callable[[Array], tuple[Array, Array]]
) -> Array:
    """Return points (k, d) on an outline in one or two axes.

    The outline is convex and inside its set.  Planes that touch the set at the points bound it
    from outside; where they leave more than `OUTLINE`, rays between two others are added.

    `end`: returns the point (d,) on the outline for a unit vector (d,), and a normal there.
    """
    if len(rows) > 2:
        raise ValueError('axes: expected one or two for a set that is not a polytope')
    if len(rows) == 1:
        return np.array([end(np.array([way]))[0] for way in (-1.0, 1.0)])
    angles = np.arange(DIRECTIONS + 1) * 2.0 * np.pi / DIRECTIONS
    ends = [end(np.array([np.cos(angle), np.sin(angle)])) for angle in angles]
    scale = np.ptp([point for point, _ in ends], axis=0)
    todo = [(*pair, 0) for pair in pairwise(zip(angles, ends, strict=True))]
    points = [point for point, _ in ends[:-1]]
    while todo:
        (low, first), (high, last), depth = todo.pop()
        if depth == REFINEMENTS or _beyond_chord(first, last, scale) <= OUTLINE:
            continue
        angle = (low + high) / 2.0
        found = angle, end(np.array([np.cos(angle), np.sin(angle)]))
        points.append(found[1][0])
        todo += [((low, first), found, depth + 1), (found, (high, last), depth + 1)]
    return np.array(points)


def _beyond_chord(
    first: tuple[Array, Array], last: tuple[Array, Array], scale: Array
) -> float:
    """Return how far a convex set may go beyond the line between two points on its outline.

    The points (2,) follow each other counterclockwise, each with a normal (2,); the distance is in
    units of `scale` (2,).
    """
    along = np.divide(last[0] - first[0], scale, out=np.zeros(2), where=scale > 0.0)
    length = float(np.linalg.norm(along))
    if length <= OUTLINE:
        return 0.0
    along /= length
    away = np.array([along[1], -along[0]])
    # How fast the two planes rise above the line: at the first point, and seen from the last one.
    rises = [(-sign * float(normal * scale @ along), float(normal * scale @ away))
             for sign, (_, normal) in ((1.0, first), (-1.0, last))]
    slopes = [max(rise, 0.0) / run if run > 0.0 else np.inf for rise, run in rises]
    if np.isinf(slopes).all():
        return np.inf
    if min(slopes) <= 0.0:
        return 0.0
    return length / sum(1.0 / slope for slope in slopes)
