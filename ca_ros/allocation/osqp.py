"""OSQP for the quadratic program of the exact allocator, as it is."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import ParameterError


class Osqp(Allocator):
    """The program of `Exact`, Eqs. (20)-(22), by the solver OSQP, clipped to the bounds.

    OSQP stops at its default tolerances, so the answers are seldom exact, least of all on the
    boundary of the admissible set, and its status does not show that.  The status here is that of
    the residual.  A wrench that OSQP finds infeasible is rejected.

    Raises a ParameterError if the package osqp is not installed.
    """

    solves = 'quadratic program of exact, by OSQP at its default tolerances'
    options: ClassVar[dict[str, Any]] = {}
    """Settings of OSQP other than its defaults."""

    def _set_up(self) -> None:
        try:
            self._solver, self._solve = osqp_program(
                self.problem, warm_starting=False, **self.options)
        except ImportError:
            raise ParameterError(
                'osqp: needs the package osqp (pip install osqp); exact solves the same program'
            ) from None
        self._rho = float(self._solver.settings.rho)

    def __reduce__(self) -> tuple[type[Osqp], tuple[object, ...]]:
        # OSQP's workspace cannot be copied.
        return type(self), (self.problem, self.settings)

    def _allocate(self, u: Array) -> Allocation:
        # OSQP adapts rho and keeps it: the answer would depend on the wrenches before this one.
        self._solver.update_settings(rho=self._rho)
        found = self._solve(u)
        # Of an infeasible program OSQP returns 0x7fc00000 as a number, where it means NaN.
        infeasible = 'infeasible' in found.info.status
        return self._clipped(u, np.where(infeasible, np.nan, np.asarray(found.x, dtype=float)))


def osqp_program(
    problem: AllocationProblem, **settings: Any
) -> tuple[Any, Callable[[Array], Any]]:
    """Set OSQP up for ``min |f|^2 / 2`` with ``Gamma f = u`` and bounds, Eqs. (20)-(22).

    Raises an ImportError if the package osqp or scipy is not installed.

    `**settings`: settings of OSQP other than its defaults.

    Returns `solver`; `solve`: from a wrench (m,) [N, N m] to the result of OSQP.
    """
    osqp: Any = import_module('osqp')
    sparse: Any = import_module('scipy.sparse')
    m, n = problem.gamma.shape
    rows = sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n)]))
    low = np.concatenate([problem.center, problem.lower])
    high = np.concatenate([problem.center, problem.upper])
    solver = osqp.OSQP()
    hessian = sparse.identity(n, format='csc')
    solver.setup(hessian, np.zeros(n), rows, low, high, verbose=False, **settings)

    def solve(u: Array) -> Any:
        low[:m] = high[:m] = u
        solver.update(l=low, u=high)
        return solver.solve(raise_error=False)

    return solver, solve
