"""OSQP's solution of the exact allocator's quadratic program, where Newton's method starts."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem


class OsqpStart:
    """The multipliers that OSQP finds for Eqs. (20)-(22).

    OSQP's thrusts have errors of the size of its tolerance, and much larger ones on the boundary
    of the admissible set.  OSQP's status does not show that.  Therefore only its multipliers are
    used, as the start of Newton's method.

    Parameters
    ----------
    problem : AllocationProblem

    Raises
    ------
    ValueError
        If the package osqp is not installed.
    """

    def __init__(self, problem: AllocationProblem) -> None:
        try:
            import osqp
            import scipy.sparse
        except ImportError:
            raise ValueError(
                "solver: 'osqp' needs the package osqp (pip install osqp); "
                "'newton' gives the same answers without it"
            ) from None
        import scipy.sparse

        m, n = problem.gamma.shape
        self._lower, self._upper = problem.lower, problem.upper
        self._size = m
        self._solver = osqp.OSQP()
        self._solver.setup(
            scipy.sparse.identity(n, format='csc'),
            np.zeros(n),
            scipy.sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n)])),
            *self._bounds(np.zeros(m)),
            verbose=False,
            # The result must depend on the wrench alone; a bad start costs only time.
            warm_starting=False,
            max_iter=200,
            eps_abs=1e-5,
            eps_rel=1e-5,
        )

    def _bounds(self, u: Array) -> tuple[Array, Array]:
        return np.concatenate([u, self._lower]), np.concatenate([u, self._upper])

    def multipliers(self, u: Array) -> Array | None:
        """Return OSQP's multipliers (m,) of Gamma f = u; None if they are not finite."""
        lower, upper = self._bounds(u)
        self._solver.update(l=lower, u=upper)
        multipliers: Array = -self._solver.solve(raise_error=False).y[: self._size]
        return multipliers if np.isfinite(multipliers).all() else None
