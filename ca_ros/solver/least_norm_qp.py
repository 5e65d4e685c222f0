"""Least-norm thrusts within bounds: the quadratic program of the exact allocator."""

from copy import copy
from typing import NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray

STEPS = 50  # limit of Newton's iteration; the tests have not seen more than 20 steps

SINGULAR_MIN = 1e-8  # of the free rows of `basis`, below which they do not span an axis
STEEP = 2e4  # size of multipliers, over the greatest thrust, that shows almost parallel facets
FULL_SLACK = 0.05  # multiple of `STEEP` at which a relaxed solution uses the whole slack
SAME = 1e-7  # change of a thrust, in units of the greatest thrust, for which no slack is used

IMAGE_ROUNDING = 16 * 2.2e-16  # of thrusts computed from y, as a share of |y|
CHANGED = 1e-10  # difference of thrusts that counts as a change of the active set
STILL = 1e-12  # share of the fastest rate below which a rotor does not move along a step
EXACT_SUM = 4 * 2.2e-16  # rounding error of A f that counts as exact, as a share of |A| |f|
SUM = 1e-14  # rounding error of a sum along a step, as a share of its terms
AIM = 0.5  # share of the tolerance that the method aims at


class Solution(NamedTuple):
    """The result of `DualNewton.solve`.

    - `thrusts` (n,): within their bounds; of all iterates those with the least |A f - u| [N]
    - `multipliers` (m,): y with ``thrusts = clip(f_p + W^-2 A^T y)``, up to rounding
    - `attained`: whether |A f - u| is within the tolerance, or the rounding error of A f
    - `unattainable`: whether a plane proves that |A f - u| exceeds the tolerance for all thrusts
    - `relaxed`: whether the thrusts use the slack
    """

    thrusts: Array
    multipliers: Array
    attained: bool
    unattainable: bool
    relaxed: bool


def sum_rounding(matrix: Array, thrusts: Array) -> Array:
    """Return the rounding error (...) of A f that counts as exact, for thrusts (..., n)."""
    sums = np.abs(thrusts) @ np.abs(matrix).T
    return EXACT_SUM * np.sqrt(np.einsum('...i,...i->...', sums, sums))


def meets(
    residual: Array | float, tolerance: Array | float, matrix: Array, thrusts: Array, share: float
) -> BoolArray:
    """Tell whether |A f - u| (...) is within a share of the tolerance or of the rounding error."""
    near = np.asarray(residual <= share * tolerance)
    return near if near.all() else near | (residual <= share * sum_rounding(matrix, thrusts))


class DualNewton:
    """Solve ``min |W (f - f_p)|^2`` with ``A f = u`` and ``lower <= f <= upper``, Eqs. (20)-(22).

    The cost is separable, so for given multipliers y of the equation the optimal deviations
    ``g = W (f - f_p)`` are ``g(y) = clip((A W^-1)^T y)``.  The remaining equation ``A f(y) = u``
    is piecewise linear, and it is the gradient of a concave function, the dual.  Newton's method
    solves it: it starts at the pseudo-inverse, treats the rotors between their bounds as free, and
    searches exactly along each step.  It ends after finitely many steps.  The bounds hold in every
    iteration.  The residual is that of the thrusts, so that preferred thrusts far away take no
    digits from it.

    - `matrix` (m, n): A, with rank m
    - `lower` and `upper` (n,): bounds
    - `weights` and `preferred` (n,): the diagonal of W, positive, and f_p; by default ones and
      zeros

    - `basis` (n, m): orthonormal columns that span the rows of A W^-1
    - `coordinates` (m, m): the equation is equivalent to ``basis^T g = coordinates (u - A f_p)``
    - `greatest`: the greatest size of a bound of g, at least 1
    """

    def __init__(
        self, matrix: Array, lower: Array, upper: Array, weights: Array | None = None,
        preferred: Array | None = None,
    ) -> None:
        n = len(lower)
        self.matrix, self.lower, self.upper = matrix, lower, upper
        self._weights = np.ones(n) if weights is None else weights
        self._preferred = np.zeros(n) if preferred is None else preferred
        self._low, self._high = (self._weights * (end - self._preferred) for end in (lower, upper))
        self._offset = matrix @ self._preferred
        self.basis, triangle = np.linalg.qr((matrix / self._weights).T)
        self._back = triangle.T
        self.coordinates = np.linalg.inv(self._back)
        self._lengths = np.linalg.norm(matrix, axis=1)
        self.greatest = max(1.0, *np.abs([self._low, self._high]).ravel().tolist())

    def solve(self, u: Array, tolerance: float, slack: float = 0.0) -> Solution:
        """Find the smallest thrusts that produce u.

        A facet of the attainable set may contain more than m - 1 columns of A.  If these columns
        lie in one plane only up to rounding, the facet splits into facets that are almost
        parallel.  Near them the multipliers are large, and the smallest thrusts change by newtons
        while u changes by 1e-9.  There the solver may miss u by up to `slack`, so that the thrusts
        depend on u as if the columns lay in one plane.

        - `u` (m,): if it is not attainable, the thrusts are some that produce about the nearest
          wrench
        - `tolerance`: goal for |A f - u|
        - `slack`: greatest |A f - u| where multipliers are large
        """
        thrusts, y, residual, proven = self._solve(u, tolerance, self._target(u))
        attained = self._within(residual, tolerance, thrusts)
        proven = proven and not attained
        steep = STEEP * self.greatest
        relaxed = attained and tolerance < slack and float(np.linalg.norm(y)) > steep
        if relaxed:
            n, m = self.basis.shape
            room = slack / (np.sqrt(m) * np.linalg.norm(self._back))
            rate = np.sqrt(room / (FULL_SLACK * steep))
            # One virtual actuator for each axis produces the part of u that may be missed.
            wider = copy(self)
            wider.basis = np.vstack([self.basis, rate * np.eye(m)])
            wider.matrix = np.hstack([self.matrix, rate * self._back])
            ends = np.full(m, room / rate)
            wider.lower, wider._low = np.append(self.lower, -ends), np.append(self._low, -ends)
            wider.upper, wider._high = np.append(self.upper, ends), np.append(self._high, ends)
            wider._weights = np.append(self._weights, np.ones(m))
            wider._preferred = np.append(self._preferred, np.zeros(m))
            softer, after, _, _ = wider._solve(u, tolerance, self._target(u))
            # On the boundary multipliers may be large although slack changes nothing.
            greatest = float((self._weights * np.abs(softer[:n] - thrusts)).max())
            missed = float(np.linalg.norm(u - self.matrix @ softer[:n]))
            relaxed = greatest > SAME * self.greatest and missed <= slack
            if relaxed:
                thrusts, y = softer[:n], after
        return Solution(thrusts, self.coordinates.T @ y, attained, proven, relaxed)

    def _target(self, u: Array) -> Array:
        target: Array = self.coordinates @ (u - self._offset)
        return target

    def _within(
        self, residual: float, tolerance: float, thrusts: Array, share: float = 1.0
    ) -> bool:
        return bool(meets(residual, tolerance, self.matrix, thrusts, share))

    def thrusts(self, deviations: Array) -> Array:
        """Return the thrusts (n,) of deviations (n,), within their bounds."""
        thrusts = self.clip(self._preferred + deviations / self._weights)
        low, high = deviations <= self._low, deviations >= self._high
        return np.where(low, self.lower, np.where(high, self.upper, thrusts))

    def least_norm(self, multipliers: Array) -> Array:
        """Return the least-norm thrusts (..., n) for multipliers (..., m) [N]."""
        slopes = multipliers @ self.matrix
        return self.clip(self._preferred + slopes / (self._weights * self._weights))

    def _solve(self, u: Array, tolerance: float, y: Array) -> tuple[Array, Array, float, bool]:
        """Return thrusts, multipliers of `basis`, the residual, and whether u is out of reach."""
        best, least, proven = (self.lower, y), np.inf, False
        for _ in range(STEPS):
            now, slopes, thrusts, after, steps = self._steps(u, y, tolerance)
            residual = float(np.linalg.norm(u - self.matrix @ thrusts))
            if residual < least:
                best, least = (thrusts, after), residual
            if self._within(residual, tolerance, thrusts, AIM):
                break
            for step in steps:
                rate, lag = self.basis @ step, float(slopes @ step)
                advance, gap = _search(self.basis @ y, now, rate, self._low, self._high, lag)
                beyond = gap > tolerance * np.linalg.norm(self.coordinates.T @ step)
                proven = proven or bool(beyond)
                if advance > 0.0:
                    y = y + advance * step
                    break
            else:
                break
            if proven:
                break
        thrusts, y = best
        if not proven and not self._within(least, tolerance, thrusts, AIM):
            thrusts = self.settle(thrusts, u, tolerance)
            least = float(np.linalg.norm(u - self.matrix @ thrusts))
            proven = self._is_beyond(u, y, tolerance)
        return thrusts, y, least, proven

    def _is_beyond(self, u: Array, way: Array, tolerance: float) -> bool:
        """Tell whether u is beyond a plane that touches the attainable set along multipliers."""
        ends = (self.basis @ way) * np.array([self._low, self._high])
        height = float(way @ self._target(u))
        gap = max(height - ends.max(axis=0).sum(), ends.min(axis=0).sum() - height)
        gap -= SUM * np.abs(ends).max(axis=0).sum()
        return bool(gap > tolerance * np.linalg.norm(self.coordinates.T @ way))

    def _steps(
        self, u: Array, y: Array, tolerance: float
    ) -> tuple[Array, Array, Array, Array, list[Array]]:
        """Return deviations and slopes of the dual at y, thrusts, their y, and steps to try."""
        basis = self.basis
        unbounded = basis @ y
        free = (unbounded > self._low) & (unbounded < self._high)
        deviations = self._clip(unbounded)
        thrusts = self.thrusts(deviations)
        left = u - self.matrix @ thrusts
        # Newton's system is basis_F^T basis_F step = gradient.  The singular values of basis_F
        # solve it without squaring its condition number.
        directions, singular, axes = np.linalg.svd(basis[free], full_matrices=True)
        sizes = np.zeros(len(y))
        sizes[: len(singular)] = singular
        slopes = self.coordinates @ left
        turned = axes @ slopes
        flat = sizes < SINGULAR_MIN
        shares = turned[~flat] / sizes[~flat]
        step = (shares / sizes[~flat]) @ axes[~flat]
        # Along an axis that the free rotors do not span, the residual is either a rounding error,
        # which is ignored, or the step goes along this axis until the next rotor becomes free.
        away = turned[flat] @ axes[flat]
        missed = float(np.linalg.norm(self._back @ away))
        if not self._within(missed, tolerance, thrusts, 0.8 * AIM):
            return deviations, slopes, thrusts, y, [away, step]
        change = np.zeros(len(thrusts))
        change[free] = directions[:, : len(shares)] @ shares
        # If the step does not change the active set, it ends at the solution.  Adding the step to
        # the thrusts loses fewer digits than adding it to y, which may be large.
        stepped = self._clip(deviations + change)
        aimed = self._clip(unbounded + basis @ step)
        lost = CHANGED * (1.0 + np.abs(stepped).max()) + IMAGE_ROUNDING * np.linalg.norm(y + step)
        if np.abs(aimed - stepped).max() <= lost:
            inside = free & (stepped > self._low) & (stepped < self._high)
            moved = self.clip(thrusts + change / self._weights)
            after = np.where(inside, moved, self.thrusts(stepped))
            return deviations, slopes, after, y + step, [step]
        return deviations, slopes, thrusts, y, [step]

    def unbounded(self, u: Array) -> Array:
        """Return the smallest thrusts (n,) for u (m,) without bounds, Eq. (12)."""
        deviations: Array = self.basis.dot(self.coordinates.dot(u - self._offset))
        return self._preferred + deviations / self._weights

    def settle(self, thrusts: Array, u: Array, tolerance: float) -> Array:
        """Remove the rounding error of u (m,) by the thrusts (n,) between their bounds.

        Newton's coordinates serve problems whose axes are almost dependent; the axes themselves
        keep their digits where coordinates lose them.  The method aims at a share of the
        tolerance of |A f - u|, and returns the iterate with the least.
        """
        best, least = thrusts, np.inf
        for in_axes in (False, True):
            thrusts = best
            for _ in range(len(thrusts)):
                left = u - self.matrix @ thrusts
                residual = float(np.linalg.norm(left))
                if residual < least:
                    best, least = thrusts, residual
                free = (thrusts > self.lower) & (thrusts < self.upper)
                if self._within(residual, tolerance, thrusts, AIM):
                    return thrusts
                if not free.any():
                    break
                if in_axes:
                    columns, goal = self.matrix / self._lengths[:, None], left / self._lengths
                else:
                    columns, goal = self.basis.T, self.coordinates @ left
                change = np.zeros(len(thrusts))
                change[free] = np.linalg.lstsq(columns[:, free], goal, rcond=SINGULAR_MIN)[0]
                thrusts = self.clip(thrusts + (change if in_axes else change / self._weights))
            if self._within(least, tolerance, best):
                break
        return best

    def clip(self, thrusts: Array) -> Array:
        """Return thrusts (..., n) within their bounds."""
        return np.minimum(np.maximum(thrusts, self.lower), self.upper)

    def _clip(self, deviations: Array) -> Array:
        return np.minimum(np.maximum(deviations, self._low), self._high)


def _search(
    start: Array, now: Array, rate: Array, lower: Array, upper: Array, lag: float
) -> tuple[float, float]:
    """Search along a step for t >= 0 with ``rate @ (clip(start + t rate) - now) = lag``.

    Return t, and by how much the left side stays below `lag` for all t, or zero.
    """
    # The corner of a rotor that moves only by rounding would be far away.
    moving: BoolArray = np.abs(rate) > STILL * np.abs(rate).max(initial=0.0)
    start, now, rate = start[moving], now[moving], rate[moving]
    lower, upper = lower[moving], upper[moving]
    corners = np.concatenate([(lower - start) / rate, (upper - start) / rate])
    corners = np.sort(np.append(corners[corners > 0.0], 0.0))
    ways = np.minimum(np.maximum(start + np.outer(corners, rate), lower), upper) - now
    values = ways @ rate - lag
    # On the boundary of the admissible set the goal is reached at a corner, and kept beyond it:
    # the search ends at the corner.
    rounding = SUM * float(np.abs(rate) @ np.maximum(np.abs(lower), np.abs(upper)))
    after = int(np.searchsorted(values, -rounding))
    if after == 0:
        return 0.0, 0.0
    if after == len(corners):
        # Unattainable, perhaps by a rounding error: move every rotor clearly to its bound.
        return float(2.0 * corners[-1]), -float(values[-1])
    share = min(values[after - 1] / (values[after - 1] - values[after]), 1.0)
    return float(corners[after - 1] + share * (corners[after] - corners[after - 1])), 0.0
