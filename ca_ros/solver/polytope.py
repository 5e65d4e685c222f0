"""Convex polytopes by their vertices: sections and projections of zonotopes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ca_ros.arrays import Array, constant

MERGED = 1e-11  # distance over the polytope's size below which vertices are one
ON_BOUNDARY = 1e-12  # the same, from a half-space, that is rounding
ON_FACET = 1e-9  # the same, from a facet, that is rounding
PARALLEL = 1e-10  # share of a segment along a normal that is rounding


@dataclass(frozen=True, eq=False)
class Polytope:
    """The convex hull of points.

    `axes`: names of the k coordinates.  `vertices` (V, k): counter-clockwise for k = 2, ascending
    for k = 1; no rows if the polytope is empty.
    """

    axes: tuple[str, ...]
    vertices: Array

    @property
    def empty(self) -> bool:
        """Whether there is no point in the polytope."""
        return len(self.vertices) == 0

    @cached_property
    def facets(self) -> tuple[Array, Array]:
        """Outward unit normals (F, k) and offsets (F,): ``normals @ x <= offsets``.

        Raises a ValueError if the polytope has no volume.
        """
        if self.volume == 0.0:
            raise ValueError('a polytope without volume has no facets')
        points = self.vertices
        if points.shape[1] == 1:
            return np.array([[-1.0], [1.0]]), np.array([-points[0, 0], points[-1, 0]])
        if points.shape[1] == 2:
            edges = np.roll(points, -1, axis=0) - points
            normals = np.column_stack([edges[:, 1], -edges[:, 0]])
            normals /= np.linalg.norm(normals, axis=1)[:, None]
            return normals, np.einsum('ij,ij->i', normals, points)
        from scipy.spatial import ConvexHull

        # Qhull splits facets into simplices.
        size = np.ptp(points, axis=0)
        planes = ConvexHull(points / size).equations
        _, first = np.unique(np.round(planes, 9), axis=0, return_index=True)
        normals, offsets = planes[first, :-1] / size, -planes[first, -1]
        lengths = np.linalg.norm(normals, axis=1)
        return normals / lengths[:, None], offsets / lengths

    def corners(self) -> list[list[int]]:
        """Return the vertices of each facet of a polytope with k = 3, in order around it."""
        found = []
        size = np.ptp(self.vertices, axis=0)
        points = (self.vertices - self.vertices.mean(axis=0)) / size
        for normal, offset in zip(*Polytope(self.axes, points).facets, strict=True):
            on = np.flatnonzero(np.abs(points @ normal - offset) <= ON_FACET)
            middle = points[on] - points[on].mean(axis=0)
            first = middle[0] / np.linalg.norm(middle[0])
            angles = np.arctan2(middle @ np.cross(normal, first), middle @ first)
            found.append(on[np.argsort(angles)].tolist())
        return found

    @cached_property
    def volume(self) -> float:
        """Volume of the polytope: a length for k = 1, an area for k = 2."""
        count, k = self.vertices.shape
        if count <= k:
            return 0.0
        if k == 1:
            return float(np.ptp(self.vertices))
        if k == 2:
            x, y = (self.vertices - self.vertices[0]).T
            return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
        from scipy.spatial import ConvexHull

        size = np.ptp(self.vertices, axis=0)
        return float(ConvexHull(self.vertices / size).volume * size.prod())


def ordered(points: Array) -> Array:
    """Return the vertices (V, k) of a polytope: in order for k up to 2, each once."""
    if len(points) == 0:
        return constant(points)
    size = np.ptp(points, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    scaled = (points - points.mean(axis=0)) / size
    if points.shape[1] == 2:
        turn = np.argsort(np.arctan2(scaled[:, 1], scaled[:, 0]), kind='stable')
    else:
        turn = np.lexsort(scaled.T[::-1])
    points, scaled = points[turn], scaled[turn]
    kept: list[int] = []
    for i, point in enumerate(scaled):
        others = kept if points.shape[1] > 2 else [*kept[:1], *kept[-1:]]
        if not any(np.abs(point - scaled[j]).max() <= MERGED for j in others):
            kept.append(i)
    return constant(points[kept])


def section(planes: Array, slacks: Array) -> Array:
    """Return the vertices (V, k) of ``planes @ x <= slacks``, a polytope with -1 <= x <= 1.

    `planes` (F, k): parts of unit vectors.  `slacks` (F,).
    """
    points = _section(planes, slacks)
    # A point on the boundary belongs to the polytope, in spite of rounding.
    return points if len(points) else _section(planes, slacks + ON_BOUNDARY)


def _section(planes: Array, slacks: Array) -> Array:
    k = planes.shape[1]
    sizes = np.linalg.norm(planes, axis=1)
    cutting = sizes > PARALLEL
    if np.any(slacks[~cutting] < -PARALLEL):
        return np.empty((0, k))
    planes, slacks = planes[cutting] / sizes[cutting, None], slacks[cutting] / sizes[cutting]
    if k == 1:
        low = (-slacks[planes[:, 0] < 0.0]).max()
        high = slacks[planes[:, 0] > 0.0].min()
        return np.array([[low], [high]]) if low <= high else np.empty((0, 1))
    if k == 2:
        square = 2.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return _cut(square, planes, slacks)
    return _intersection(planes, slacks)


def _cut(corners: Array, planes: Array, slacks: Array) -> Array:
    """Return the corners (V, 2) of a convex polygon after cuts by half-planes."""
    for plane, slack in zip(planes, slacks, strict=True):
        heights = corners @ plane - slack
        following = np.roll(heights, -1)
        inside, crossing = heights <= 0.0, (heights > 0.0) != (following > 0.0)
        cuts = np.roll(corners, -1, axis=0)
        shares = heights[crossing] / (heights - following)[crossing]
        cuts[crossing] = corners[crossing] + shares[:, None] * (cuts - corners)[crossing]
        both = np.stack([corners, cuts], axis=1).reshape(-1, 2)
        corners = both[np.column_stack([inside, crossing]).ravel()]
        if len(corners) == 0:
            break
    return corners


def _intersection(planes: Array, slacks: Array) -> Array:
    """Return the vertices (V, k) of an intersection of half-spaces; none if it has no volume."""
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection

    k = planes.shape[1]
    # The centre of the largest ball that fits into it.
    ball = linprog(
        np.append(np.zeros(k), -1.0), A_ub=np.column_stack([planes, np.ones(len(planes))]),
        b_ub=slacks, bounds=[(None, None)] * k + [(0.0, None)],
    )
    if not ball.success or ball.x[-1] <= PARALLEL:
        return np.empty((0, k))
    halfspaces = np.column_stack([planes, -slacks])
    return np.array(HalfspaceIntersection(halfspaces, ball.x[:-1]).intersections)
