"""The explicit law of the exact allocator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.solver.critical_region import AffineLaw
from ca_ros.solver.dual_newton import FLAT, STEEP, DualNewton


def explicit_law(least_norm: DualNewton, multipliers: Array, tolerance: float) -> AffineLaw | None:
    """Return the law of the region around a solution of the quadratic program of `DualNewton`.

    While the same rotors are at the same bounds, the multipliers y are affine in u, and with them
    ``z = A^T y`` and the thrusts ``clip(z)``: one step of Newton's method with the active set
    known beforehand.  As long as z leaves the active set as it is, the thrusts have the least
    norm.

    Parameters
    ----------
    least_norm : DualNewton
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
    free = _free(least_norm, unbounded)
    if free is None:
        return None
    slopes = _slopes(least_norm.basis, free)
    if np.linalg.norm(slopes[free], 2) * np.sqrt(len(free)) > STEEP:
        # Somewhere in this region multipliers may be so large that solutions are relaxed.
        return None
    offset = -slopes @ (least_norm.basis[~free].T @ thrusts[~free])
    law = AffineLaw.of(slopes @ least_norm.coordinates, offset, free, thrusts, low, high)
    return replace(law, proven=_error(law, matrix, free, thrusts) <= tolerance)


def _free(least_norm: DualNewton, z: Array) -> BoolArray | None:
    """Return rotors that serve all axes: those that are free at z, and more where these do not.

    On the boundary of the admissible set the free rotors leave axes unserved, and along such an
    axis the multipliers may be anywhere beyond a certain point: where the next rotor comes free.
    """
    basis, low, high = least_norm.basis, least_norm.lower, least_norm.upper
    free = (z > low) & (z < high)
    bounds = np.where(z >= high, high, low)
    while True:
        _, singular, axes = np.linalg.svd(basis[free], full_matrices=True)
        if np.count_nonzero(singular >= FLAT) == len(axes):
            return free
        rates = basis @ axes[-1]
        ways = np.full(len(z), np.inf)
        movable = ~free & (high > low) & (np.abs(rates) >= FLAT)
        ways[movable] = (bounds - z)[movable] / rates[movable]
        nearest = int(np.argmin(np.abs(ways)))
        if not movable[nearest]:
            return None
        z = z + ways[nearest] * rates
        free[nearest] = True


def _error(law: AffineLaw, matrix: Array, free: BoolArray, ends: Array) -> float:
    """Return a bound of |A f - u| / max(1, |u|) for all u in the law's region.

    ``A f - u`` is ``(A_free slope_free - 1) u + A_free offset_free + A_bound ends``, and what the
    rounding of z makes of it, and clipping at the edge.
    """
    part, rest = matrix[:, free], matrix[:, ~free] @ ends[~free]
    slope, offset = law.slope[free], law.offset[free]
    left = np.column_stack([part @ slope - np.eye(len(matrix)), part @ offset + rest])
    terms = np.abs(part) @ np.abs(np.column_stack([slope, offset]))
    rounding = (len(matrix) + 1) * np.finfo(float).eps
    error = np.sqrt(2.0) * (np.linalg.norm(left) + rounding * np.linalg.norm(terms))
    return float(error + np.linalg.norm(part) * np.sqrt(part.shape[1]) * law.edge)


def _slopes(basis: Array, free: BoolArray) -> Array:
    """Return dz/dc for ``basis^T f = c``: ``basis (basis_F^T basis_F)^-1``.

    By the singular values of basis_F, so that for the free rotors its condition is not squared.
    """
    directions, singular, axes = np.linalg.svd(basis[free], full_matrices=False)
    slopes = np.empty_like(basis)
    slopes[free] = directions / singular @ axes
    slopes[~free] = basis[~free] @ axes.T / singular**2 @ axes
    return slopes
