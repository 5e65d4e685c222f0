"""The dual Newton method of the exact allocator for effectors in convex sets."""

from typing import Any, NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.solver.convex_sets import ConvexSets
from ca_ros.solver.least_norm_qp import AIM, meets

TOLERANCE = 1e-12  # residual of a wrench that is met, relative to max(1, |u|)
STEPS = 60  # limit of Newton's iteration
TRIALS = 60  # limit of the evaluations in one search along a way
ROUNDING = 1e-12  # of the value of the dual
FLAT = 1e-9  # curvature of the dual that counts as none, relative to its greatest
DAMPING = 0.01  # of the steps for a line, so that they are not much longer than y
PULLS = 20  # limit of the pulls along one line
GROWTH = 4.0  # of the pull
PULL_MAX = 1e7  # in units of the greatest deviation
FAR = 1e20  # multipliers, in units of the greatest deviation, that say no more
GAP = 5e-10  # by which a line may be too short, as a share of it
HALVINGS = 40  # limit of those of the rest of a line


class SetsSolution(NamedTuple):
    """The result of `SetsNewton.solve`; every field has a leading K.

    - `points` (K, n): in the sets; of all iterates those with the least slope of the dual
    - `multipliers` (K, m): y with ``points = P(x_p + W^-2 A^T y)``, to rounding
    - `attained` (K,): whether |A x - u| is within the tolerance, or the rounding error of A x
    - `unattainable` (K,): whether a plane proves that |A x - u| exceeds the tolerance for all x
    """

    points: Array
    multipliers: Array
    attained: BoolArray
    unattainable: BoolArray


class Line(NamedTuple):
    """How far a line ``begin + t way`` goes inside the attainable set.

    - `point` (n,): in the sets; of least cost for the last wrench of the line
    - `length`: t of that wrench
    - `most`: no attainable wrench of the line has a greater t, by the normal and the support
      function of the sets
    - `normal` (m,): of a plane that touches the set where the line ends
    """

    point: Array
    length: float
    most: float
    normal: Array


class SetsNewton:
    """Solve ``min |W (x - x_p)|^2`` with ``A x = u`` and x in a product of convex sets.

    For given multipliers y the optimal x is ``P(x_p + W^-2 A^T y)``, where P is the projection on
    the sets.  Boxes have the clip in its place: see `ca_ros.solver.least_norm_qp`.  The remaining
    equation ``A x(y) = u`` is the gradient of a concave function, the dual.  Newton's method with
    a generalized derivative of P solves it, from the pseudo-inverse on, with a line search on the
    slope of the dual.  This is the reference of `ca_ros/kernel/vectored.c`.

    - `matrix` (m, n): A, with rank m
    - `sets`
    - `weights` (n,): the diagonal of W, positive and the same for all components of a set; by
      default ones
    - `preferred` (n,): x_p, by default zeros
    """

    engine = 'NumPy'
    prioritizes = False
    """Whether `with_policy` has room for priorities."""

    def __init__(
        self, matrix: Array, sets: ConvexSets, weights: Array | None = None,
        preferred: Array | None = None,
    ) -> None:
        self.matrix, self.sets = matrix, sets
        self.weights = np.ones(sets.n) if weights is None else weights
        self.preferred = np.zeros(sets.n) if preferred is None else preferred
        self.basis, triangle = np.linalg.qr((matrix / self.weights).T)
        self.coordinates = np.linalg.inv(triangle.T)
        self.rates = self.basis / self.weights[:, None]
        ends = np.abs([sets.lower - self.preferred, sets.upper - self.preferred])
        self.greatest = float((self.weights * ends).max())

    def with_policy(self, **policy: Any) -> Any:
        """Return None: there is nothing in C that serves unattainable wrenches by a policy."""

    def least_norm(self, multipliers: Array) -> Array:
        """Return the points (..., n) with the least cost for multipliers (..., m)."""
        return self.sets.project(self.preferred + multipliers @ self.matrix / self.weights**2)

    def solve(self, wrenches: Array) -> SetsSolution:
        """Find the points of least cost that produce wrenches (K, m)."""
        rows = [self._solve(u, self.coordinates @ (u - self.matrix @ self.preferred))
                for u in wrenches]
        if not rows:
            none = np.zeros(0, bool)
            return SetsSolution(np.zeros((0, self.sets.n)), wrenches, none, none)
        return SetsSolution(*map(np.array, zip(*rows, strict=True)))

    def line(self, begin: Array, way: Array, end: float = np.inf) -> Line:
        """Go as far as possible along ``begin + t way``, at most to t = end.

        The points minimise the cost less a pull times t.  While the pull grows, t goes to its
        greatest value, and the multipliers go to the normal there, along a path with the slope
        `tangent`.

        - `begin`, `way` (m,): `begin` is attainable
        """
        y = self.coordinates @ way
        size = float(np.linalg.norm(y))
        if not size:
            point, normal, *_ = self._solve(begin, self.coordinates @ begin)
            return Line(point, end, end, normal)
        e, pull, bounds = y / size, self.greatest, list[tuple[float, Array]]()
        y, reached, last = pull * e, -1.0, self.preferred
        for trial in range(PULLS):
            goal = TOLERANCE * max(self.greatest, pull / 1000.0)
            y, met, _ = self._newton(begin, y, goal, e)
            points, rate = self._at(y)
            length = float(e @ self.coordinates @ (self.matrix @ points - begin)) / size
            if length >= end:
                found = self._solve(begin + end * way, y)
                if found[2] or self._near(begin, way, end, found[0]):
                    return Line(found[0], end, end, found[1])
                met = False
                bounds.append(self._bound(begin, way, y))
                break
            if met:
                reached, last = length, points
            bend = self._curvature(rate)
            # At a corner there are many: by turns that nearest to the multipliers, or to the way.
            near = e if trial % 2 else y / (y @ e)
            tangent = near + _beside(bend, e, -bend @ near, 0.0)
            bounds += [self._bound(begin, way, tangent), self._bound(begin, way, y)]
            most = min(bounds, key=lambda bound: bound[0])[0]
            if most - length <= GAP * length or pull >= PULL_MAX * self.greatest:
                break
            y = y + (GROWTH - 1.0) * pull * tangent
            pull *= GROWTH
        most, normal = min(bounds, key=lambda bound: bound[0])
        if not met and (length >= end or not self._near(begin, way, length, points)):
            points, length = self._halved(begin, way, reached, min(end, most), last)
        return Line(points, max(length, 0.0), most, normal)

    def _bound(self, begin: Array, way: Array, y: Array) -> tuple[float, Array]:
        """Return the length of a line by the plane normal to multipliers of the basis, and it."""
        normal = y @ self.coordinates
        most = float(self.sets.support(normal @ self.matrix) - normal @ begin)
        return most / float(normal @ way), normal

    def _near(self, begin: Array, way: Array, length: float, points: Array) -> bool:
        """Tell whether points (n,) produce the wrench of a line at a length of it."""
        missed = self.matrix @ points - begin - length * way
        return float(np.linalg.norm(missed)) <= GAP * length * float(np.linalg.norm(way))

    def _halved(
        self, begin: Array, way: Array, low: float, high: float, points: Array
    ) -> tuple[Array, float]:
        """Return points (n,) and length for a line whose end the pulls have lost.

        `points` are those at `low`, which is negative if there are none; `high` is beyond the end.
        """
        for _ in range(HALVINGS):
            if high - low <= GAP * high:
                break
            middle = 0.0 if low < 0.0 else (low + high) / 2.0
            found = self.solve((begin + middle * way)[None])
            if found.attained[0] or low < 0.0:
                low, points = middle, found.points[0]
            else:
                high = middle
        return points, low

    def _solve(self, u: Array, y: Array) -> tuple[Array, Array, bool, bool]:
        """Solve for one wrench, from multipliers y of the basis on."""
        tolerance = TOLERANCE * max(1.0, float(np.linalg.norm(u)))
        y, attained, beyond = self._newton(u, y, tolerance)
        return self._at(y)[0], y @ self.coordinates, attained, beyond and not attained

    def _at(self, y: Array) -> tuple[Array, Array]:
        return self.sets.project_with_derivative(self.preferred + self.rates @ y)

    def _curvature(self, rate: Array) -> Array:
        return np.asarray(self.basis.T @ rate @ self.basis, float)

    def _newton(
        self, u: Array, y: Array, tolerance: float, e: Array | None = None
    ) -> tuple[Array, bool, bool]:
        """Return the multipliers for u, whether it is met, and whether a plane excludes it.

        With e, a unit vector, the wrench is free along it, and y stays as great along it.
        """

        def missed(y: Array) -> tuple[Array, float, Array, Array]:
            points, rate = self._at(y)
            left = u - self.matrix @ points
            slope = self.coordinates @ left
            if e is not None:
                slope = left = slope - float(slope @ e) * e
            return slope, float(np.linalg.norm(left)), rate, points

        # Of the iterates the best is the one with the least slope.
        best, least, sizes, last = y, np.inf, (np.inf, self.preferred), np.inf
        for step in range(STEPS):
            slope, size, rate, points = missed(y)
            now = float(np.linalg.norm(slope))
            if now < least:
                best, least, sizes = y, now, (size, points)
            if self._within(size, tolerance, points, AIM):
                return y, True, False
            stalls = step > 3 and now > last / 2.0
            if stalls and e is None and self._beyond(u, y, tolerance):
                return best, self._within(sizes[0], tolerance, sizes[1], 1.0), True
            last = now
            bend = self._curvature(rate)
            if e is None:
                way = _solved(bend, slope)
            else:
                damping = DAMPING * float(np.linalg.norm(slope) / np.linalg.norm(y))
                way = _beside(bend, e, slope, damping)
            first = float(slope @ way)
            if not first > 0.0:
                break
            y = self._search(u, y, way, first, lambda y: missed(y)[0])
            if self._far(y):
                slope, size, rate, points = missed(y)
                if float(np.linalg.norm(slope)) < least:
                    best, sizes = y, (size, points)
                beyond = e is None and self._beyond(u, y, tolerance)
                return best, self._within(sizes[0], tolerance, sizes[1], 1.0), beyond
        return best, self._within(sizes[0], tolerance, sizes[1], 1.0), False

    def _search(self, u: Array, y: Array, way: Array, first: float, slope: Any) -> Array:
        """Return y moved along a way until the slope of the dual has fallen by half.

        Beyond the greatest value of the dual, it must not be less than at the beginning: the slope
        may fall below zero at once, and then stay flat.
        """
        low, high = 0.0, np.inf
        length = min(1.0, FAR * self.greatest / float(np.linalg.norm(way)))
        for _ in range(TRIALS):
            there = y + length * way
            now = float(slope(there) @ way)
            if now > first / 2.0:
                low = length
                if self._far(there):
                    break
            elif now < -first / 2.0 or (now < 0.0 and self._falls(u, y, there)):
                high = length
            else:
                break
            length = 4.0 * low if high == np.inf else (low + high) / 2.0 if low else high / 8.0
        return y + length * way

    def _far(self, y: Array) -> bool:
        """Tell whether the squares of still longer multipliers of the basis would overflow."""
        return float(np.linalg.norm(y)) > FAR * self.greatest

    def _falls(self, u: Array, *ways: Array) -> bool:
        """Tell whether the dual is less at the second of two multipliers of the basis."""
        values = []
        for y in ways:
            points = self._at(y)[0]
            cost = 0.5 * float(((self.weights * (points - self.preferred)) ** 2).sum())
            values.append((cost, float(y @ self.coordinates @ (u - self.matrix @ points))))
        first, second = np.sum(values, axis=1)
        return bool(second < first - ROUNDING * np.abs(values[0]).max())

    def _within(self, size: float, tolerance: float, points: Array, share: float) -> bool:
        return bool(meets(size, tolerance, self.matrix, points, share))

    def _beyond(self, u: Array, y: Array, tolerance: float) -> bool:
        """Tell whether a plane normal to the multipliers y of the basis excludes a wrench."""
        normal = y @ self.coordinates
        height, most = float(normal @ u), float(self.sets.support(normal @ self.matrix))
        rounding = 1e-14 * (abs(height) + abs(most))
        return height - most > tolerance * float(np.linalg.norm(normal)) + rounding


def _solved(bend: Array, slope: Array, raised: bool = True) -> Array:
    """Return the way with ``bend way = slope``.

    Small curvatures are raised, or the way does not go where they are.
    """
    values, axes = np.linalg.eigh(bend)
    floor = FLAT * max(float(values[-1]), FLAT)
    along = np.where(raised | (values >= floor), axes.T @ slope, 0.0)
    return np.asarray(axes @ (along / np.maximum(values, floor)), float)


def _beside(bend: Array, e: Array, slope: Array, damping: float) -> Array:
    """Return the way normal to e, a unit vector, with ``bend way = slope`` but along e.

    Damping raises small curvatures.
    """
    if len(e) == 1:
        return np.zeros(1)
    normal = np.linalg.svd(e[None])[2][1:]
    less = normal @ bend @ normal.T + damping * np.eye(len(normal))
    return np.asarray(normal.T @ _solved(less, normal @ slope, damping > 0.0), float)
