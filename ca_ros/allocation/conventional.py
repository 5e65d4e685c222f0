"""The conventional optimal allocator."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import Numbers, ParameterError, Settings, setting

STEPS_PER_ROTOR = 10  # limit of the active-set method, in case rounding makes it cycle


@dataclass(frozen=True, kw_only=True)
class ConventionalSettings(Settings):
    """The settings of `Conventional`."""

    weight: Numbers = setting(
        1e-4,
        'Q of the conventional allocator, Eq. (18): q for Q = q I, the diagonal, or the matrix '
        'row by row', mutable=True)
    reference: Literal['hover', 'zero'] | Numbers = setting(
        'hover',
        'f_ref of the conventional allocator, Eq. (18): hover thrusts, zero, or the thrusts [N]',
        mutable=True)


class Conventional(Allocator):
    """Weighted compromise between wrench and reference thrusts, Eqs. (18)-(19).

    The thrusts minimise ``|f - f_ref|_Q^2 + |Gamma f - u|^2`` subject to the bounds.  If several
    thrusts have the same cost, as with Q = q 1 1^T, the result is the one of least norm.  The
    reference 'hover' is m g / n on each rotor, or without a vehicle the smallest f that gives the
    reference of the problem.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    weight : float, (n,) array or (n * n,) array, default 1e-4
        Q: q for Q = q I, the diagonal, or the matrix row by row.
    reference : {'hover', 'zero'} or (n,) array, default 'hover'
        f_ref: hover thrusts, zero, or the thrusts [N].

    Raises
    ------
    ParameterError
        If Q is not symmetric and positive semidefinite.
    """

    solves = 'quadratic program: min |f - f_ref|^2_Q + |Gamma f - u|^2 within the bounds'

    settings_type = ConventionalSettings
    settings: ConventionalSettings

    def _set_up(self) -> None:
        n = self.problem.n
        self.weight = _weight(self.settings.weight, n)
        self.reference = _reference(self.settings.reference, self.problem)
        self.hessian = self.weight + self.problem.gamma.T @ self.problem.gamma
        curvatures = np.linalg.eigvalsh(self.hessian)
        if curvatures[0] < 1e-9 * curvatures[-1]:
            self.hessian += 1e-9 * curvatures[-1] / n * np.eye(n)
        self._pull = self.weight @ self.reference

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self._solve(u)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))

    def _solve(self, u: Array) -> Array:
        """Minimise the cost by the primal active-set method, whose steps are finitely many."""
        low, high, hessian = self.problem.lower, self.problem.upper, self.hessian
        linear = self._pull + self.problem.gamma.T @ u
        thrusts = self.problem.clip(np.asarray(np.linalg.solve(hessian, linear), dtype=np.float64))
        free = (thrusts > low) & (thrusts < high)
        for _ in range(STEPS_PER_ROTOR * len(low)):
            goal = thrusts.copy()
            rest = linear - hessian[:, ~free] @ thrusts[~free]
            goal[free] = np.linalg.solve(hessian[np.ix_(free, free)], rest[free])
            way = goal - thrusts
            with np.errstate(divide='ignore', invalid='ignore'):
                shares = np.where(way > 0.0, high - thrusts, low - thrusts) / way
            # The free thrusts go to their minimum, or to the first bound in the way.
            shares[~free | (way == 0.0)] = np.inf
            first = int(shares.argmin())
            if shares[first] < 1.0:
                thrusts = self.problem.clip(thrusts + shares[first] * way)
                thrusts[first] = high[first] if way[first] > 0.0 else low[first]
                free[first] = False
                continue
            thrusts = goal
            # The bound with the greatest wrong multiplier is released.
            slopes = hessian @ thrusts - linear
            descent = np.where(thrusts <= low, -slopes, slopes)
            descent[free | (high == low)] = 0.0
            steepest = int(descent.argmax())
            if descent[steepest] <= 1e-13 * (1.0 + np.abs(linear).max()):
                break
            free[steepest] = True
        return thrusts


def _weight(weight: Numbers, n: int) -> Array:
    matrix = np.asarray(weight, dtype=float)
    if matrix.size == 1:
        matrix = float(matrix.reshape(())) * np.eye(n)
    elif matrix.shape == (n,):
        matrix = np.diag(matrix)
    elif matrix.shape == (n * n,):
        matrix = matrix.reshape(n, n)
    if matrix.shape != (n, n):
        found = np.shape(weight)
        raise ParameterError(f'weight: expected 1, {n} or {n} x {n} numbers, got shape {found}')
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ParameterError('weight: expected a symmetric matrix')
    curvatures = np.linalg.eigvalsh(matrix)
    if curvatures[0] < -1e-9 * max(abs(curvatures[-1]), np.finfo(float).tiny):
        raise ParameterError(
            f'weight: expected a positive semidefinite matrix, got '
            f'an eigenvalue of {curvatures[0]:g}'
        )
    return matrix


def _reference(reference: str | Numbers, problem: AllocationProblem) -> Array:
    if reference == 'hover':
        return problem.shared
    if reference == 'zero':
        return np.zeros(problem.n)
    thrusts = np.asarray(reference, dtype=float)
    if thrusts.shape != (problem.n,):
        raise ParameterError(
            f"reference: expected 'hover', 'zero' or {problem.n} thrusts, got {reference!r}"
        )
    return thrusts
