"""OSQP's solution of the exact allocator's quadratic program, where Newton's method starts."""

from __future__ import annotations

import numpy as np

from ca_ros.allocation.osqp_program import osqp_program
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
    preference : tuple of two (n,) arrays, optional
        As for `osqp_program`.

    Raises
    ------
    ValueError
        If the package osqp is not installed.
    """

    def __init__(
        self, problem: AllocationProblem, preference: tuple[Array, Array] | None = None
    ) -> None:
        # The result must depend on the wrench alone; a bad start costs only time.
        settings = {'warm_starting': False, 'max_iter': 200, 'eps_abs': 1e-5, 'eps_rel': 1e-5}
        try:
            _, self._solve = osqp_program(problem, preference, **settings)
        except ImportError:
            raise ValueError(
                "solver: 'osqp' needs the package osqp (pip install osqp); "
                "'newton' gives the same answers without it"
            ) from None

    def multipliers(self, u: Array) -> Array | None:
        """Return OSQP's multipliers (m,) of Gamma f = u; None if they are not finite."""
        multipliers: Array = -self._solve(u).y[: len(u)]
        return multipliers if np.isfinite(multipliers).all() else None
