"""Least-norm thrusts within bounds: the quadratic program of the exact allocator."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.zonotope import Zonotope

STEPS = 50
"""Limit of Newton's iteration; the tests have not seen more than 20 steps."""


FLAT = 1e-8
"""Singular value of the free rotors' columns, of unit rows, below which an axis is not served."""


class LeastNorm:
    """Solve ``min |f|^2`` subject to ``A f = u`` and ``lower <= f <= upper``, Eqs. (20)-(22).

    The cost is separable, so for multipliers y of the equation the best thrusts are ``f(y) =
    clip(A^T y)``, and what is left is ``A f(y) = u``: piecewise linear, and the gradient of a
    concave function, the dual.  Newton's method starts at the pseudo-inverse, takes the rotors
    between their bounds for free, and searches exactly along each step, so that it ends after
    finitely many.  The bounds hold throughout.

    Parameters
    ----------
    matrix : (m, n) array
        A, of rank m.
    lower, upper : (n,) arrays
        Bounds.
    image : Zonotope
        The set of all u that can be attained.
    """

    def __init__(self, matrix: Array, lower: Array, upper: Array, image: Zonotope) -> None:
        self.matrix, self.lower, self.upper, self.image = matrix, lower, upper, image
        # In an orthonormal basis of A's rows the equation is basis^T f = coordinates u.
        left, singular, right = np.linalg.svd(matrix, full_matrices=False)
        self._basis = right.T
        self._coordinates = (left / singular).T
        self._back = left * singular

    def solve(self, u: Array, tolerance: float, start: Array | None = None) -> tuple[Array, Array]:
        """Find the least thrusts that give u.

        Parameters
        ----------
        u : (m,) array
            In the image, up to rounding.
        tolerance : float
            Goal for |A f - u|.
        start : (m,) array, optional
            Multipliers to start at.

        Returns
        -------
        thrusts : (n,) array
            Those with the least |A f - u| that were met.
        multipliers : (m,) array
            y with ``thrusts = clip(A^T y)``.
        """
        u, tolerance = self.image.pull(u), 0.5 * tolerance
        basis, lower, upper = self._basis, self.lower, self.upper
        target = self._coordinates @ u
        y = target if start is None else self._back.T @ start
        best, least = (lower, y), np.inf
        for _ in range(STEPS):
            thrusts, after, left, step = self._step(u, y, tolerance)
            residual = float(np.linalg.norm(left))
            if residual < least:
                best, least = (thrusts, after), residual
            if residual <= tolerance:
                break
            rate = basis @ step
            advance = _search(basis @ y, rate, lower, upper, float(target @ step))
            if advance == 0.0:
                break
            y = y + advance * step
        return best[0], self._coordinates.T @ best[1]

    def _step(self, u: Array, y: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        """Return thrusts, the y they belong to, what they leave of u, and Newton's step."""
        basis = self._basis
        unbounded = basis @ y
        free = (unbounded > self.lower) & (unbounded < self.upper)
        thrusts = self.clip(unbounded)
        left = u - self.matrix @ thrusts
        # Newton's system is basis_F^T basis_F step = gradient; by the singular values of basis_F
        # it is solved without squaring its condition.
        directions, singular, axes = np.linalg.svd(basis[free], full_matrices=True)
        sizes = np.zeros(len(y))
        sizes[: len(singular)] = singular
        slopes = axes @ (self._coordinates @ left)
        # Along an axis that no free rotor serves, what is left is either rounding, to be ignored,
        # or a reason to go that way alone: the search ends where the next rotor comes free.
        flat = sizes < FLAT
        unserved = self._back @ (slopes[flat] @ axes[flat])
        if float(np.linalg.norm(unserved)) > 0.8 * tolerance:
            return thrusts, y, left, slopes[flat] @ axes[flat]
        shares = slopes[~flat] / sizes[~flat]
        step = (shares / sizes[~flat]) @ axes[~flat]
        change = np.zeros(len(thrusts))
        change[free] = directions[:, : len(shares)] @ shares
        # If the step leaves the active set as it is, this is the answer.  The thrusts themselves
        # lose fewer digits in it than y, which may be large.
        stepped = self.clip(thrusts + change)
        aimed = self.clip(unbounded + basis @ step)
        if np.abs(aimed - stepped).max() <= 1e-10 * (1.0 + np.abs(stepped).max()):
            return stepped, y + step, u - self.matrix @ stepped, step
        return thrusts, y, left, step

    def clip(self, thrusts: Array) -> Array:
        """Return thrusts (..., n) within their bounds."""
        return np.minimum(np.maximum(thrusts, self.lower), self.upper)


def _search(start: Array, rate: Array, lower: Array, upper: Array, goal: float) -> float:
    """Return t >= 0 with ``rate @ clip(start + t rate) = goal``; the left side grows with t."""
    # A rotor that stands still up to rounding would have its corner nowhere near.
    moving: BoolArray = np.abs(rate) > 1e-12 * np.abs(rate).max(initial=0.0)
    start, rate, lower, upper = start[moving], rate[moving], lower[moving], upper[moving]
    corners = np.concatenate([(lower - start) / rate, (upper - start) / rate])
    corners = np.sort(np.append(corners[corners > 0.0], 0.0))
    values = np.minimum(np.maximum(start + np.outer(corners, rate), lower), upper) @ rate - goal
    # At the boundary of the admissible set the goal is reached for good at a corner: go there and
    # not beyond.
    rounding = 1e-14 * float(np.abs(rate) @ np.maximum(np.abs(lower), np.abs(upper)))
    after = int(np.searchsorted(values, -rounding))
    if after == 0:
        return 0.0
    if after == len(corners):
        # Not attainable, if only by a rounding error: all that can move is moved, and clearly so.
        return float(2.0 * corners[-1]) or 1.0
    share = min(values[after - 1] / (values[after - 1] - values[after]), 1.0)
    return float(corners[after - 1] + share * (corners[after] - corners[after - 1]))
