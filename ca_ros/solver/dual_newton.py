"""Least-norm thrusts within bounds: the quadratic program of the exact allocator."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray

STEPS = 50
"""Limit of Newton's iteration; the tests have not seen more than 20 steps."""

SINGULAR_MIN = 1e-8
"""Singular value of the free rows of `basis` below which the free rotors do not span an axis."""

STEEP = 2e4
"""Multipliers above this, in units of the greatest thrust, indicate almost parallel facets."""

SOFT = 0.05
"""Multiple of `STEEP` at which a relaxed solution uses the whole slack."""

SAME = 1e-7
"""Change of a thrust, in units of the greatest thrust, for which no slack is used."""

IMAGE_ROUNDING = 16 * float(np.finfo(float).eps)
"""Rounding error of thrusts that are computed from y, as a share of |y|."""


class Solution(NamedTuple):
    """The result of `DualNewton.solve`.

    Attributes
    ----------
    thrusts : (n,) array
        Within their bounds; of all iterates those with the least |A f - u| [N].
    multipliers : (m,) array
        y with ``thrusts = clip(A^T y)``, up to rounding.
    attained : bool
        Whether |A f - u| is within the tolerance.
    relaxed : bool
        Whether the thrusts use the slack.
    """

    thrusts: Array
    multipliers: Array
    attained: bool
    relaxed: bool


class DualNewton:
    """Solve ``min |f|^2`` subject to ``A f = u`` and ``lower <= f <= upper``, Eqs. (20)-(22).

    The cost is separable, so for given multipliers y of the equation the optimal thrusts are
    ``f(y) = clip(A^T y)``.  The remaining equation ``A f(y) = u`` is piecewise linear, and it is
    the gradient of a concave function, the dual.  Newton's method solves it: it starts at the
    pseudo-inverse, treats the rotors between their bounds as free, and searches exactly along
    each step.  It ends after finitely many steps.  The bounds hold in every iteration.

    Parameters
    ----------
    matrix : (m, n) array
        A, with rank m.
    lower, upper : (n,) arrays
        Bounds.

    Attributes
    ----------
    basis : (n, m) array
        Orthonormal columns that span the rows of A.
    coordinates : (m, m) array
        The equation is equivalent to ``basis^T f = coordinates u``.
    greatest : float
        The greatest size of a bound, at least 1.
    """

    def __init__(self, matrix: Array, lower: Array, upper: Array) -> None:
        self.matrix, self.lower, self.upper = matrix, lower, upper
        self.basis, triangle = np.linalg.qr(matrix.T)
        self._back = triangle.T
        self.coordinates = np.linalg.inv(self._back)
        self.greatest = max(1.0, *np.abs([lower, upper]).ravel().tolist())

    def solve(
        self, u: Array, tolerance: float, start: Array | None = None, slack: float = 0.0
    ) -> Solution:
        """Find the smallest thrusts that produce u.

        A facet of the attainable set may contain more than m - 1 columns of A.  If these columns
        lie in one plane only up to rounding, the facet splits into facets that are almost
        parallel.  Near them the multipliers are large, and the smallest thrusts change by newtons
        while u changes by 1e-9.  There the solver may miss u by up to `slack`, so that the thrusts
        depend on u as if the columns lay in one plane.

        Parameters
        ----------
        u : (m,) array
            Attainable, up to rounding.
        tolerance : float
            Goal for |A f - u|.
        start : (m,) array, optional
            Multipliers to start at.
        slack : float
            Greatest |A f - u| where multipliers are large.

        Returns
        -------
        Solution
        """
        first = None if start is None else self._back.T @ start
        thrusts, y, residual = self._solve(u, tolerance, first)
        steep = STEEP * self.greatest
        relaxed = residual <= tolerance < slack and float(np.linalg.norm(y)) > steep
        if relaxed:
            n, m = self.basis.shape
            room = slack / (np.sqrt(m) * np.linalg.norm(self._back))
            rate = np.sqrt(room / (SOFT * steep))
            # One virtual actuator for each axis produces the part of u that may be missed.
            wider = copy(self)
            wider.basis = np.vstack([self.basis, rate * np.eye(m)])
            wider.matrix = np.hstack([self.matrix, rate * self._back])
            wider.lower = np.append(self.lower, np.full(m, -room / rate))
            wider.upper = np.append(self.upper, np.full(m, room / rate))
            softer, after, _ = wider._solve(u, tolerance, None)
            # On the boundary multipliers may be large although slack changes nothing.
            greatest = float(np.abs(softer[:n] - thrusts).max())
            missed = float(np.linalg.norm(u - self.matrix @ softer[:n]))
            relaxed = greatest > SAME * self.greatest and missed <= slack
            if relaxed:
                thrusts, y = softer[:n], after
        return Solution(thrusts, self.coordinates.T @ y, residual <= tolerance, relaxed)

    def _solve(
        self, u: Array, tolerance: float, start: Array | None
    ) -> tuple[Array, Array, float]:
        """Return thrusts, multipliers of `basis` and the residual."""
        tolerance = 0.5 * tolerance
        basis, lower, upper = self.basis, self.lower, self.upper
        target = self.coordinates @ u
        y = target if start is None else start
        best, least = (lower, y), np.inf
        for _ in range(STEPS):
            thrusts, after, left, steps = self._steps(u, y, tolerance)
            residual = float(np.linalg.norm(left))
            if residual < least:
                best, least = (thrusts, after), residual
            if residual <= tolerance:
                break
            for step in steps:
                advance = _search(basis @ y, basis @ step, lower, upper, float(target @ step))
                if advance > 0.0:
                    y = y + advance * step
                    break
            else:
                break
        thrusts, y = best
        if least > tolerance:
            thrusts = self.settle(thrusts, u, tolerance)
            least = float(np.linalg.norm(u - self.matrix @ thrusts))
        return thrusts, y, least

    def _steps(
        self, u: Array, y: Array, tolerance: float
    ) -> tuple[Array, Array, Array, list[Array]]:
        """Return thrusts, their y, the residual of u, and the steps to try."""
        basis = self.basis
        unbounded = basis @ y
        free = (unbounded > self.lower) & (unbounded < self.upper)
        thrusts = self.clip(unbounded)
        left = u - self.matrix @ thrusts
        # Newton's system is basis_F^T basis_F step = gradient.  The singular values of basis_F
        # solve it without squaring its condition number.
        directions, singular, axes = np.linalg.svd(basis[free], full_matrices=True)
        sizes = np.zeros(len(y))
        sizes[: len(singular)] = singular
        slopes = axes @ (self.coordinates @ left)
        flat = sizes < SINGULAR_MIN
        shares = slopes[~flat] / sizes[~flat]
        step = (shares / sizes[~flat]) @ axes[~flat]
        # Along an axis that the free rotors do not span, the residual is either a rounding error,
        # which is ignored, or the step goes along this axis until the next rotor becomes free.
        away = slopes[flat] @ axes[flat]
        if float(np.linalg.norm(self._back @ away)) > 0.8 * tolerance:
            return thrusts, y, left, [away, step]
        change = np.zeros(len(thrusts))
        change[free] = directions[:, : len(shares)] @ shares
        # If the step does not change the active set, it ends at the solution.  Adding the step to
        # the thrusts loses fewer digits than adding it to y, which may be large.
        stepped = self.clip(thrusts + change)
        aimed = self.clip(unbounded + basis @ step)
        lost = 1e-10 * (1.0 + np.abs(stepped).max()) + IMAGE_ROUNDING * np.linalg.norm(y + step)
        if np.abs(aimed - stepped).max() <= lost:
            return stepped, y + step, u - self.matrix @ stepped, [step]
        return thrusts, y, left, [step]

    def unbounded(self, u: Array) -> Array:
        """Return the smallest thrusts (n,) for u (m,) without bounds, Eq. (12)."""
        thrusts: Array = self.basis.dot(self.coordinates.dot(u))
        return thrusts

    def settle(self, thrusts: Array, u: Array, tolerance: float) -> Array:
        """Remove the rounding error of u by the rotors between their bounds.

        Parameters
        ----------
        thrusts : (n,) array
            Within their bounds.
        u : (m,) array
        tolerance : float
            Goal for |A f - u|.

        Returns
        -------
        (n,) array
            Of all iterates those with the least |A f - u|.
        """
        best, least = thrusts, np.inf
        for _ in range(len(thrusts)):
            left = u - self.matrix @ thrusts
            residual = float(np.linalg.norm(left))
            if residual < least:
                best, least = thrusts, residual
            free = (thrusts > self.lower) & (thrusts < self.upper)
            if residual <= tolerance or not free.any():
                break
            change = np.zeros(len(thrusts))
            goal = self.coordinates @ left
            change[free] = np.linalg.lstsq(self.basis[free].T, goal, rcond=SINGULAR_MIN)[0]
            thrusts = self.clip(thrusts + change)
        return best

    def clip(self, thrusts: Array) -> Array:
        """Return thrusts (..., n) within their bounds."""
        return np.minimum(np.maximum(thrusts, self.lower), self.upper)


def _search(start: Array, rate: Array, lower: Array, upper: Array, goal: float) -> float:
    """Return t >= 0 with ``rate @ clip(start + t rate) = goal``; the left side grows with t."""
    # The corner of a rotor that moves only by rounding would be far away.
    moving: BoolArray = np.abs(rate) > 1e-12 * np.abs(rate).max(initial=0.0)
    start, rate, lower, upper = start[moving], rate[moving], lower[moving], upper[moving]
    corners = np.concatenate([(lower - start) / rate, (upper - start) / rate])
    corners = np.sort(np.append(corners[corners > 0.0], 0.0))
    values = np.minimum(np.maximum(start + np.outer(corners, rate), lower), upper) @ rate - goal
    # On the boundary of the admissible set the goal is reached at a corner, and kept beyond it:
    # the search ends at the corner.
    rounding = 1e-14 * float(np.abs(rate) @ np.maximum(np.abs(lower), np.abs(upper)))
    after = int(np.searchsorted(values, -rounding))
    if after == 0:
        return 0.0
    if after == len(corners):
        # Unattainable, perhaps by a rounding error: move every rotor clearly to its bound.
        return float(2.0 * corners[-1])
    share = min(values[after - 1] / (values[after - 1] - values[after]), 1.0)
    return float(corners[after - 1] + share * (corners[after] - corners[after - 1]))
