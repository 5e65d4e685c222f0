"""OSQP, set up for the quadratic program of the exact allocator."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem


def osqp_program(
    problem: AllocationProblem, preference: tuple[Array, Array] | None = None, **settings: Any
) -> tuple[Any, Callable[[Array], Any]]:
    """Set OSQP up for ``min |W (f - f_p)|^2 / 2`` with ``Gamma f = u`` and bounds, Eqs. (20)-(22).

    Parameters
    ----------
    problem : AllocationProblem
    preference : tuple of two (n,) arrays, optional
        The diagonal of W, and f_p; by default ones and zeros [1, N].
    **settings
        Settings of OSQP other than its defaults.

    Returns
    -------
    solver : osqp.OSQP
    solve : callable
        From a wrench (m,) [N, N m] to the result of OSQP.

    Raises
    ------
    ImportError
        If the package osqp or scipy is not installed.
    """
    osqp: Any = import_module('osqp')
    sparse: Any = import_module('scipy.sparse')
    m, n = problem.gamma.shape
    rows = sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n)]))
    low = np.concatenate([problem.center, problem.lower])
    high = np.concatenate([problem.center, problem.upper])
    solver = osqp.OSQP()
    weights, preferred = (np.ones(n), np.zeros(n)) if preference is None else preference
    squares = weights * weights
    hessian = sparse.diags(squares, format='csc')
    solver.setup(hessian, -squares * preferred, rows, low, high, verbose=False, **settings)

    def solve(u: Array) -> Any:
        low[:m] = high[:m] = u
        solver.update(l=low, u=high)
        return solver.solve(raise_error=False)

    return solver, solve
