"""The dual Newton method of the exact allocator for effectors in convex sets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.solver.convex_sets import ConvexSets
from ca_ros.solver.dual_newton import AIM, sum_rounding

STEPS = 60
"""Limit of Newton's iteration."""

TRIALS = 60
"""Limit of the evaluations in one line search."""

FLAT = 1e-9
"""Curvature of the dual, relative to its greatest, that counts as none."""

ACCEPTED = 0.5
"""Share of the slope at the begin of a line that may remain at its end."""


class SetsSolution(NamedTuple):
    """The result of `SetsNewton.solve`; every field has a leading K.

    Attributes
    ----------
    points : (K, n) array
        In the sets; of all iterates those with the least |A x - u|.
    multipliers : (K, m) array
        y with ``points = P(x_p + W^-2 A^T y)``, to rounding.
    attained : (K,) array of bool
        Whether |A x - u| is within the tolerance, or the rounding error of A x.
    unattainable : (K,) array of bool
        Whether a plane proves that |A x - u| exceeds the tolerance for all x in the sets.
    steps : (K,) array of int
        Newton steps.
    """

    points: Array
    multipliers: Array
    attained: BoolArray
    unattainable: BoolArray
    steps: Array


class SetsNewton:
    """Solve ``min |W (x - x_p)|^2`` with ``A x = u`` and x in a product of convex sets.

    For given multipliers y the optimal x is ``P(x_p + W^-2 A^T y)``, where P is the projection on
    the sets.  Boxes have the clip in its place: see `ca_ros.solver.dual_newton`.  The remaining
    equation ``A x(y) = u`` is the gradient of a concave function, the dual.  Newton's method with
    a generalized derivative of P solves it, from the pseudo-inverse on, with a line search on the
    slope of the dual.  It solves many wrenches side by side.

    Parameters
    ----------
    matrix : (m, n) array
        A, with rank m.
    sets : ConvexSets
    weights : (n,) array, optional
        The diagonal of W, positive and the same for all components of a set; by default ones.
    preferred : (n,) array, optional
        x_p, by default zeros.
    """

    def __init__(
        self,
        matrix: Array,
        sets: ConvexSets,
        weights: Array | None = None,
        preferred: Array | None = None,
    ) -> None:
        self.matrix, self.sets = matrix, sets
        self.weights = np.ones(sets.n) if weights is None else weights
        self.preferred = np.zeros(sets.n) if preferred is None else preferred
        basis, triangle = np.linalg.qr((matrix / self.weights).T)
        self._basis, self._back = basis, triangle.T
        self._coordinates = np.linalg.inv(triangle.T)
        self._rates = basis / self.weights[:, None]

    def least_norm(self, multipliers: Array) -> Array:
        """Return the points (..., n) with the least cost for multipliers (..., m)."""
        return self.sets.project(
            self.preferred + multipliers @ self.matrix / self.weights**2
        )

    def cost(self, points: Array) -> Array:
        """Return half of |W (x - x_p)|^2 (...) of points (..., n)."""
        deviations = self.weights * (points - self.preferred)
        return np.asarray(0.5 * np.einsum('...i,...i->...', deviations, deviations), float)

    def gap(self, u: Array, points: Array, multipliers: Array) -> Array:
        """Return the duality gap (...): points cost at most this more than any others for u."""
        least = self.least_norm(multipliers)
        missed = u - least @ self.matrix.T
        dual = self.cost(least) + np.einsum('...i,...i->...', multipliers, missed)
        return np.asarray(self.cost(points) - dual, float)

    def within(self, left: Array, tolerance: Array, points: Array, share: float) -> BoolArray:
        """Tell (K,) whether residuals (K, m) are within a share of the tolerance or rounding."""
        size = np.sqrt(np.einsum('ki,ki->k', left, left))
        return np.asarray(
            size <= share * np.maximum(tolerance, sum_rounding(self.matrix, points))
        )

    def solve(self, wrenches: Array, tolerance: Array) -> SetsSolution:
        """Find the points of least cost that produce wrenches.

        Parameters
        ----------
        wrenches : (K, m) array
        tolerance : (K,) array
            Goal for |A x - u|.
        """
        count = len(wrenches)
        y = (wrenches - self.matrix @ self.preferred) @ self._coordinates.T
        best_y, best = y.copy(), np.full(count, np.inf)
        proven, steps = np.zeros(count, bool), np.zeros(count, int)
        running = np.arange(count)
        for step in range(STEPS):
            u, now = wrenches[running], y[running]
            points, rate = self.sets.project_with_derivative(self.preferred + now @ self._rates.T)
            left = u - points @ self.matrix.T
            size = np.sqrt(np.einsum('ki,ki->k', left, left))
            better = size < best[running]
            best[running[better]], best_y[running[better]] = size[better], now[better]
            steps[running] = step
            done = self.within(left, tolerance[running], points, AIM)
            proven[running] = ~done & self._beyond(u, now, tolerance[running])
            going = ~(done | proven[running])
            running, now, left = running[going], now[going], left[going]
            if not len(running):
                break
            curvature = np.einsum('im,kij,jl->kml', self._basis, rate[going], self._basis,
                                  optimize=True)
            slopes = left @ self._coordinates.T
            values, axes = np.linalg.eigh(curvature)
            shares = np.einsum('kml,km->kl', axes, slopes)
            floor = np.maximum(values, FLAT * np.maximum(values[:, -1:], FLAT))
            way = np.einsum('kml,kl->km', axes, shares / floor)
            y[running] = self._search(wrenches[running], now, way, slopes)
        points = self.sets.project(self.preferred + best_y @ self._rates.T)
        left = wrenches - points @ self.matrix.T
        attained = self.within(left, tolerance, points, 1.0)
        return SetsSolution(
            points, best_y @ self._coordinates, attained, proven & ~attained, steps
        )

    def _search(self, u: Array, y: Array, way: Array, slopes: Array) -> Array:
        """Return y (K, m) moved along a way until the slope of the dual has fallen enough."""
        first = np.einsum('km,km->k', slopes, way)
        length = np.ones(len(y))
        low, high = np.zeros(len(y)), np.full(len(y), np.inf)
        open_ = np.arange(len(y))
        for _ in range(TRIALS):
            at = y[open_] + length[open_, None] * way[open_]
            points = self.sets.project(self.preferred + at @ self._rates.T)
            left = (u[open_] - points @ self.matrix.T) @ self._coordinates.T
            slope = np.einsum('km,km->k', left, way[open_])
            limit = ACCEPTED * first[open_]
            up, down = slope > limit, slope < -limit
            low[open_[up]], high[open_[down]] = length[open_[up]], length[open_[down]]
            open_ = open_[up | down]
            if not len(open_):
                break
            middle = 0.5 * (low[open_] + high[open_])
            length[open_] = np.where(np.isfinite(middle), middle, 4.0 * low[open_])
        return y + length[:, None] * way

    def _beyond(self, u: Array, y: Array, tolerance: Array) -> BoolArray:
        """Tell (K,) whether a plane normal to the multipliers y of `_basis` excludes wrenches."""
        normals = y @ self._coordinates
        heights = np.einsum('km,km->k', normals, u)
        most = self.sets.support(normals @ self.matrix)
        size = np.sqrt(np.einsum('km,km->k', normals, normals))
        rounding = 1e-14 * (np.abs(heights) + np.abs(most))
        return np.asarray(heights - most > tolerance * size + rounding)
