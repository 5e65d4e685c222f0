"""OSQP, set up for the quadratic program of the exact allocator; where Newton's method starts."""

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

    Raises an ImportError if the package osqp or scipy is not installed.

    `preference` (n,): the diagonal of W, and f_p; by default ones and zeros [1, N].  `**settings`:
    settings of OSQP other than its defaults.

    Returns `solver`; `solve`: from a wrench (m,) [N, N m] to the result of OSQP.
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


def osqp_start(
    problem: AllocationProblem, preference: tuple[Array, Array] | None
) -> Callable[[Array], Array | None]:
    """Return a function from a wrench (m,) to the multipliers (m,) that OSQP finds for it.

    OSQP's thrusts have errors of the size of its tolerance, and much larger ones on the boundary
    of the admissible set.  OSQP's status does not show that.  Therefore only its multipliers are
    used, as the start of Newton's method; they are None if they are not finite.  Raises a
    ValueError if the package osqp is not installed.
    """
    # The result must depend on the wrench alone; a bad start costs only time.
    settings = {'warm_starting': False, 'max_iter': 200, 'eps_abs': 1e-5, 'eps_rel': 1e-5}
    try:
        _, solve = osqp_program(problem, preference, **settings)
    except ImportError:
        raise ValueError(
            "solver: 'osqp' needs the package osqp (pip install osqp); "
            "'newton' gives the same answers without it"
        ) from None

    def multipliers(u: Array) -> Array | None:
        found: Array = -solve(u).y[: len(u)]
        return found if np.isfinite(found).all() else None

    return multipliers
