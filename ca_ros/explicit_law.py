"""The explicit law: least-norm thrusts as an affine function of the wrench, region by region."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.least_norm import LeastNorm

REGIONS_MAX = 512
"""How many regions are kept; the hexarotor of the paper has 37."""

BORDER = 1e-9
"""A rotor so near to a bound, relative to its thrust, is as good as free."""

CHUNK = 16384
"""Wrenches that are worked on at once: they fit into a processor's cache."""


class ExplicitLaw:
    """The solution of the quadratic program of `LeastNorm`, remembered by its active sets.

    While the same rotors are at the same bounds the multipliers, and with them the thrusts, are
    affine in u: ``f = clip(P u + q)``, which is one step of Newton's method with the active set
    known beforehand.  Whatever P and q it comes from, such an f is of the form clip(Gamma^T y), so
    that Gamma f = u alone proves it to be the solution.  Regions are learned as they are met.

    Parameters
    ----------
    least_norm : LeastNorm
    """

    def __init__(self, least_norm: LeastNorm) -> None:
        self._least_norm = least_norm
        self._regions: list[_Region] = []

    def solve(self, u: Array, tolerance: float, start: Array | None = None) -> tuple[Array, Array]:
        """Like `LeastNorm.solve`, at once where u is in a region that is known."""
        for i, region in enumerate(self._regions):
            thrusts = self._least_norm.clip(region.slope @ u + region.offset)
            if np.linalg.norm(u - self._least_norm.matrix @ thrusts) <= 0.5 * tolerance:
                # The next command is likely to be in the same region: look there first.
                self._regions.insert(0, self._regions.pop(i))
                return thrusts, region.multipliers(u)
        thrusts, multipliers = self._least_norm.solve(u, tolerance, start)
        learned = self._learn(multipliers)
        if learned is not None:
            affine = self._least_norm.clip(learned.slope @ u + learned.offset)
            # The same numbers now as when the region is met again.
            if np.linalg.norm(u - self._least_norm.matrix @ affine) <= 0.5 * tolerance:
                self._regions.insert(0, learned)
                del self._regions[REGIONS_MAX:]
                return affine, learned.multipliers(u)
        return thrusts, multipliers

    def solve_batch(self, wrenches: Array, tolerances: Array) -> tuple[Array, Array]:
        """Return thrusts (N, n) and multipliers (N, m) for wrenches (N, m), tolerances (N,)."""
        matrix = self._least_norm.matrix
        thrusts = np.empty((len(wrenches), matrix.shape[1]))
        multipliers = np.empty(wrenches.shape)
        for first in range(0, len(wrenches), CHUNK):
            chunk = slice(first, first + CHUNK)
            self._solve_chunk(
                wrenches[chunk], tolerances[chunk], thrusts[chunk], multipliers[chunk]
            )
        return thrusts, multipliers

    def _solve_chunk(
        self, wrenches: Array, tolerances: Array, thrusts: Array, multipliers: Array
    ) -> None:
        matrix, clip = self._least_norm.matrix, self._least_norm.clip
        left = np.arange(len(wrenches))
        known = 0
        while len(left):
            if known == len(self._regions):
                one = left[0]
                thrusts[one], multipliers[one] = self.solve(wrenches[one], float(tolerances[one]))
                left = left[1:]
                known = 0 if known < len(self._regions) else known
                continue
            region = self._regions[known]
            u = wrenches[left]
            f = clip(u @ region.slope.T + region.offset)
            error = u - f @ matrix.T
            good = np.einsum('ij,ij->i', error, error) <= (0.5 * tolerances[left]) ** 2
            thrusts[left[good]] = f[good]
            multipliers[left[good]] = region.multipliers(u[good])
            left = left[~good]
            known += 1

    def _learn(self, multipliers: Array) -> _Region | None:
        """Return the region of some multipliers, if it has one of full dimension."""
        matrix, low, high = (
            self._least_norm.matrix,
            self._least_norm.lower,
            self._least_norm.upper,
        )
        unbounded = multipliers @ matrix
        free = (unbounded > low) & (unbounded < high)
        slack = np.minimum(np.abs(unbounded - low), np.abs(unbounded - high))
        border = slack <= BORDER * (1.0 + np.abs(unbounded))
        for guess in (free, free | border):
            region = _region(matrix, guess & (high > low), self._least_norm.clip(unbounded))
            if region is not None:
                return region
        return None


class _Region:
    """An affine law: ``multipliers = inverse (u - saturated)``, ``f = clip(slope u + offset)``."""

    def __init__(self, matrix: Array, inverse: Array, saturated: Array) -> None:
        self.inverse, self.saturated = inverse, saturated
        self.slope = matrix.T @ inverse
        self.offset = -self.slope @ saturated

    def multipliers(self, u: Array) -> Array:
        """Return the multipliers (..., m) of wrenches (..., m)."""
        return (u - self.saturated) @ self.inverse.T


def _region(matrix: Array, free: BoolArray, thrusts: Array) -> _Region | None:
    curvature: Array = matrix[:, free] @ matrix[:, free].T
    scale = np.sqrt(np.diag(curvature))
    if not np.all(scale > 0.0) or np.linalg.cond(curvature / np.outer(scale, scale)) > 1e12:
        return None
    saturated: Array = matrix[:, ~free] @ thrusts[~free]
    inverse: Array = np.linalg.solve(curvature, np.eye(len(curvature)))
    return _Region(matrix, inverse, saturated)
