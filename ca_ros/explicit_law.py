"""The explicit law of the exact allocator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ca_ros.affine_law import AffineLaw
from ca_ros.arrays import Array, BoolArray
from ca_ros.least_norm import LeastNorm

BORDER = 1e-9
"""A rotor so near to a bound, relative to its thrust, is as good as free."""


def explicit_law(least_norm: LeastNorm, multipliers: Array, tolerance: float) -> AffineLaw | None:
    """Return the law of the region around a solution of the quadratic program of `LeastNorm`.

    While the same rotors are at the same bounds, the multipliers y are affine in u, and with them
    ``z = A^T y`` and the thrusts ``clip(z)``: one step of Newton's method with the active set
    known beforehand.  As long as z leaves the active set as it is, the thrusts have the least
    norm.

    Parameters
    ----------
    least_norm : LeastNorm
    multipliers : (m,) array
        Of the solution.
    tolerance : float
        Residual, relative to max(1, |u|), up to which the law counts as proven.

    Returns
    -------
    AffineLaw or None
        None if the region has no interior.
    """
    matrix, low, high = least_norm.matrix, least_norm.lower, least_norm.upper
    unbounded = multipliers @ matrix
    thrusts = least_norm.clip(unbounded)
    free = (unbounded > low) & (unbounded < high)
    distance = np.minimum(np.abs(unbounded - low), np.abs(unbounded - high))
    border = (distance <= BORDER * (1.0 + np.abs(unbounded))) & (high > low)
    for guess in (free, free | border):
        inverse = _inverse(matrix[:, guess])
        if inverse is not None:
            slope = matrix.T @ inverse
            offset = -slope @ (matrix[:, ~guess] @ thrusts[~guess])
            law = AffineLaw.of(slope, offset, guess, thrusts, low, high)
            return replace(law, proven=_error(law, matrix, guess, thrusts) <= tolerance)
    return None


def _error(law: AffineLaw, matrix: Array, free: BoolArray, ends: Array) -> float:
    """Return a bound of |A f - u| / max(1, |u|) for all u in the law's region.

    ``A f - u`` is ``(A_free slope_free - 1) u + A_free offset_free + A_bound ends``, and what the
    rounding of z makes of it.
    """
    part, rest = matrix[:, free], matrix[:, ~free] @ ends[~free]
    slope, offset = law.slope[free], law.offset[free]
    left = np.column_stack([part @ slope - np.eye(len(matrix)), part @ offset + rest])
    terms = np.abs(part) @ np.abs(np.column_stack([slope, offset]))
    rounding = (len(matrix) + 1) * np.finfo(float).eps
    return float(np.sqrt(2.0) * (np.linalg.norm(left) + rounding * np.linalg.norm(terms)))


def _inverse(free: Array) -> Array | None:
    """Return the inverse of ``free @ free.T``, or None if it is nearly singular."""
    curvature: Array = free @ free.T
    scale = np.sqrt(np.diag(curvature))
    if not np.all(scale > 0.0) or np.linalg.cond(curvature / np.outer(scale, scale)) > 1e12:
        return None
    return np.asarray(np.linalg.inv(curvature), dtype=np.float64)
