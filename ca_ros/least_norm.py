"""Least-norm thrusts within bounds: the quadratic program of the exact allocator."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.zonotope import Zonotope

STEPS = 100
"""Limit of Newton's iteration; the tests have not seen more than 20 steps."""


class LeastNorm:
    """Solve ``min |f|^2`` subject to ``A f = u`` and ``lower <= f <= upper``, Eqs. (20)-(22).

    Parameters
    ----------
    matrix : (m, n) array
        A, of rank m.
    lower, upper : (n,) arrays
        Bounds.

    Attributes
    ----------
    image : Zonotope
        The set of all u that can be attained.
    """

    def __init__(self, matrix: Array, lower: Array, upper: Array) -> None:
        self.matrix, self.lower, self.upper = matrix, lower, upper
        self.image = Zonotope(matrix @ (lower + upper) / 2.0, matrix * (upper - lower) / 2.0)
        self._space = _RowSpace(matrix)

    def solve(self, u: Array, tolerance: float) -> Array:
        """Return the least thrusts (n,) that give u.

        Parameters
        ----------
        u : (m,) array
            In the image, up to rounding.
        tolerance : float
            Goal for |A f - u|.
        """
        return newton(self._space, self.lower, self.upper, self.image.pull(u), 0.5 * tolerance)


class _RowSpace:
    """An orthonormal row space: ``A f = u`` becomes ``basis^T f = coordinates u``."""

    def __init__(self, matrix: Array) -> None:
        self.matrix = matrix
        left, singular, right = np.linalg.svd(matrix, full_matrices=False)
        rank = int((singular > 1e-10 * singular.max(initial=0.0)).sum())
        self.basis = right[:rank].T
        self.back = left[:, :rank] * singular[:rank]
        self.coordinates = (left[:, :rank] / singular[:rank]).T


def newton(space: _RowSpace, lower: Array, upper: Array, u: Array, tolerance: float) -> Array:
    """Maximise the dual of the quadratic program.

    The cost is separable, so for multipliers y of the equation the best thrusts are ``f(y) =
    clip(A^T y)``, and what is left is ``A f(y) = u``: piecewise linear, and the gradient of a
    concave function.  Newton's method starts at the pseudo-inverse, takes the rotors between their
    bounds for free, and searches exactly along each step, so that it ends after finitely many.
    The bounds hold throughout.

    Returns
    -------
    (n,) array
        The thrusts with the least |A f - u| that were met.
    """
    basis, target = space.basis, space.coordinates @ u
    y, best, least = target, lower, np.inf
    for _ in range(STEPS):
        unbounded = basis @ y
        free = (unbounded > lower) & (unbounded < upper)
        thrusts = np.minimum(np.maximum(unbounded, lower), upper)
        left = u - space.matrix @ thrusts
        curvatures, axes = np.linalg.eigh(basis[free].T @ basis[free])
        slopes = axes.T @ (space.coordinates @ left)
        # Along an axis that no free rotor serves, what is left is either rounding, to be ignored,
        # or a reason to go that way alone: the search ends where the next rotor comes free.
        flat = curvatures < 1e-12
        if (
            flat.any()
            and float(np.linalg.norm(space.back @ (axes[:, flat] @ slopes[flat])))
            > 0.8 * tolerance
        ):
            step = axes[:, flat] @ slopes[flat]
        else:
            step = axes[:, ~flat] @ (slopes[~flat] / curvatures[~flat])
            # If the step leaves the active set as it is, this is the answer.  The thrusts
            # themselves lose fewer digits in it than y, which may be large.
            stepped = np.where(
                free, np.minimum(np.maximum(thrusts + basis @ step, lower), upper), thrusts
            )
            aimed = np.minimum(np.maximum(unbounded + basis @ step, lower), upper)
            if np.abs(aimed - stepped).max() <= 1e-10 * (1.0 + np.abs(stepped).max()):
                thrusts, left = stepped, u - space.matrix @ stepped
        residual = float(np.linalg.norm(left))
        if residual < least:
            best, least = thrusts, residual
        if residual <= tolerance:
            break
        y = y + _search(unbounded, basis @ step, lower, upper, float(target @ step)) * step
    return best


def _search(start: Array, rate: Array, lower: Array, upper: Array, goal: float) -> float:
    """Return t >= 0 with ``rate @ clip(start + t rate) = goal``; the left side grows with t."""
    moving: BoolArray = rate != 0.0
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
