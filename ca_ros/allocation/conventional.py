"""The conventional optimal allocator."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import lsq_linear

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array
from ca_ros.vehicle import Vehicle


class Conventional(Allocator):
    """A compromise between the wrench and reference thrusts, Eqs. (18)-(19).

    ``min |f - f_ref|_Q^2 + |Gamma f - u|^2`` subject to the bounds.  Where the cost leaves f
    undetermined, as with Q = q 1 1^T, the least norm decides.

    Parameters
    ----------
    vehicle : Vehicle
    weight : float, (n,) or (n * n,) or (n, n) array
        Q: q of q I, its diagonal, or the matrix; symmetric, positive semidefinite.
    reference : 'hover', 'zero' or (n,) array
        f_ref [N]; 'hover' is m g / n on each rotor.

    Raises
    ------
    ValueError
        If an option has the wrong shape, or Q is not symmetric and positive semidefinite.
    """

    def __init__(
        self, vehicle: Vehicle, weight: ArrayLike = 1e-4, reference: str | ArrayLike = 'hover'
    ) -> None:
        super().__init__(vehicle)
        n = vehicle.n
        self.weight = _weight(weight, n)
        self.reference = _reference(reference, vehicle)
        self.hessian = self.weight + self.problem.gamma.T @ self.problem.gamma
        curvatures = np.linalg.eigvalsh(self.hessian)
        if curvatures[0] < 1e-9 * curvatures[-1]:
            self.hessian += 1e-9 * curvatures[-1] / n * np.eye(n)
        self._pull = self.weight @ self.reference

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self._solve(self._pull + self.problem.gamma.T @ u)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))

    def _solve(self, linear: Array) -> Array:
        """Minimise f H f / 2 - linear f by guessing the active set until it proves right."""
        low, high = self.problem.lower, self.problem.upper
        hessian, curvature = self.hessian, np.diag(self.hessian)
        thrusts = np.linalg.solve(hessian, linear)
        slopes = np.zeros_like(thrusts)
        for _ in range(4 * len(low)):
            target = thrusts - slopes / curvature
            at_low, at_high = target <= low, target >= high
            free = ~(at_low | at_high)
            guess = np.where(at_low, low, high)
            guess[free] = np.linalg.solve(
                hessian[np.ix_(free, free)],
                linear[free] - hessian[np.ix_(free, ~free)] @ guess[~free],
            )
            slopes = hessian @ guess - linear
            slopes[free] = 0.0
            proved = (
                np.all(guess >= low)
                and np.all(guess <= high)
                and np.all(slopes[at_low] >= 0.0)
                and np.all(slopes[at_high] <= 0.0)
            )
            if proved:
                return guess
            thrusts = guess
        return self._solve_slowly(linear)

    def _solve_slowly(self, linear: Array) -> Array:
        """Let the active-set method of SciPy decide where the guesses go in circles."""
        factor = np.linalg.cholesky(self.hessian)
        low, high = self.problem.lower, self.problem.upper
        movable = high > low
        thrusts = low.copy()
        target = np.linalg.solve(factor, linear) - factor.T[:, ~movable] @ low[~movable]
        solution = lsq_linear(
            factor.T[:, movable], target, (low[movable], high[movable]), method='bvls', tol=1e-14
        )
        thrusts[movable] = solution.x
        return self.problem.clip(thrusts)


def _weight(weight: ArrayLike, n: int) -> Array:
    matrix = np.asarray(weight, dtype=float)
    if matrix.size == 1:
        matrix = float(matrix.reshape(())) * np.eye(n)
    elif matrix.shape == (n,):
        matrix = np.diag(matrix)
    elif matrix.shape == (n * n,):
        matrix = matrix.reshape(n, n)
    if matrix.shape != (n, n):
        raise ValueError(
            f'weight: expected 1, {n} or {n} x {n} numbers, got shape {np.shape(weight)}'
        )
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ValueError('weight: expected a symmetric matrix of finite numbers')
    curvatures = np.linalg.eigvalsh(matrix)
    if curvatures[0] < -1e-9 * max(abs(curvatures[-1]), np.finfo(float).tiny):
        raise ValueError(
            f'weight: expected a positive semidefinite matrix, got '
            f'an eigenvalue of {curvatures[0]:g}'
        )
    return matrix


def _reference(reference: str | ArrayLike, vehicle: Vehicle) -> Array:
    if isinstance(reference, str):
        if reference not in ('hover', 'zero'):
            raise ValueError(
                f"reference: expected 'hover', 'zero' or {vehicle.n} thrusts, got {reference!r}"
            )
        return np.full(vehicle.n, vehicle.weight / vehicle.n if reference == 'hover' else 0.0)
    thrusts = np.asarray(reference, dtype=float)
    if thrusts.shape != (vehicle.n,) or not np.isfinite(thrusts).all():
        raise ValueError(
            f"reference: expected 'hover', 'zero' or {vehicle.n} finite thrusts, got {reference!r}"
        )
    return thrusts
