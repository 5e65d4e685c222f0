"""The solvers of others, each with its fastest interface.

Each function sets up the exact allocator's quadratic program,
``min |f|^2 / 2`` subject to ``Gamma f = u`` and ``low <= f <= high``, Eqs. (20)-(22), and returns
the call that solves it for a wrench u.  What does not depend on u is set up once; a call changes u
alone where the interface allows it.  It returns the thrusts (n,), which may be a view of the
solver's memory, or None if the solver does not claim to have solved the problem; reading that
status is part of the call.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
from scipy import sparse

from ca_ros.allocation.osqp import osqp_program
from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.studies.comparison import hierarchical

Call = Callable[[Array], Any]  # from a wrench (m,) [N, N m] to an answer


def osqp(problem: AllocationProblem, **settings: Any) -> Call:
    _, solve = osqp_program(problem, warm_starting=True, **settings)
    solved = int(import_module('osqp').SolverStatus.OSQP_SOLVED)

    def call(u: Array) -> Any:
        answer = solve(u)
        return answer.x if answer.info.status_val == solved else None

    return call


def daqp(problem: AllocationProblem) -> Call:
    daqp: Any = import_module('daqp')
    n, (cost, high, low, sense) = problem.n, _daqp_data(problem)

    def call(u: Array) -> Any:
        low[n:] = high[n:] = u
        x, _, flag, _ = daqp.solve(*cost, high, low, sense)
        return x if flag == 1 else None

    return call


def daqp_reused(problem: AllocationProblem) -> Call:
    n, (cost, high, low, sense) = problem.n, _daqp_data(problem)
    model = import_module('daqp').Model()
    model.setup(*cost, high.copy(), low.copy(), sense)

    def call(u: Array) -> Any:
        low[n:] = high[n:] = u
        model.update(bupper=high, blower=low)
        x, _, flag, _ = model.solve()
        return x if flag == 1 else None

    return call


def daqp_hierarchical(problem: AllocationProblem) -> Call:
    solve = hierarchical(problem)

    def call(u: Array) -> Any:
        x, _, flag, _ = solve(u)
        return x if flag > 0 else None

    return call


def _daqp_data(problem: AllocationProblem) -> Any:
    m, n = problem.gamma.shape
    # The first n rows are bounds; 5 marks an equality.
    low = np.concatenate([problem.lower, problem.center])
    high = np.concatenate([problem.upper, problem.center])
    sense = np.array([0] * n + [5] * m, dtype=np.intc)
    # DAQP asks for writable arrays.
    return (np.eye(n), np.zeros(n), problem.gamma.copy()), high, low, sense


def quadprog(problem: AllocationProblem) -> Call:
    quadprog: Any = import_module('quadprog')
    m, n = problem.gamma.shape
    # The identity is its own factor.  Fortran order avoids a copy.
    factor, cost = np.eye(n, order='F'), np.zeros(n)
    rows = np.asfortranarray(np.hstack([problem.gamma.T, np.eye(n), -np.eye(n)]))
    right = np.concatenate([problem.center, problem.lower, -problem.upper])

    def call(u: Array) -> Any:
        right[:m] = u
        try:
            return quadprog.solve_qp(factor, cost, rows, right, m, True)[0]
        except ValueError:
            # quadprog's way to report that there is no solution.
            return None

    return call


def piqp(problem: AllocationProblem) -> Call:
    piqp: Any = import_module('piqp')
    n, gamma = problem.n, np.asfortranarray(problem.gamma)
    solver = piqp.DenseSolver()
    solver.settings.preconditioner_reuse_on_update = True
    program = np.eye(n, order='F'), np.zeros(n), gamma, problem.center
    solver.setup(*program, x_l=problem.lower, x_u=problem.upper)
    solved = piqp.PIQP_SOLVED

    def call(u: Array) -> Any:
        solver.update(b=u)
        return solver.result.x if solver.solve() == solved else None

    return call


def proxqp(problem: AllocationProblem, **settings: Any) -> Call:
    proxqp: Any = import_module('proxsuite').proxqp
    m, n = problem.gamma.shape
    solver = proxqp.dense.QP(n, m, n, False, proxqp.dense.HessianType.Diagonal)
    _set(solver.settings, settings)
    bounds = np.eye(n), problem.lower, problem.upper
    solver.init(np.eye(n), np.zeros(n), problem.gamma, problem.center, *bounds)
    solved = proxqp.PROXQP_SOLVED

    def call(u: Array) -> Any:
        solver.update(b=u)
        solver.solve()
        return solver.results.x if solver.results.info.status == solved else None

    return call


def clarabel(problem: AllocationProblem, **settings: Any) -> Call:
    clarabel: Any = import_module('clarabel')
    m, n = problem.gamma.shape
    options = _set(clarabel.DefaultSettings(), {'verbose': False, **settings})
    rows = sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n), -np.eye(n)]))
    right = np.concatenate([problem.center, problem.upper, -problem.lower])
    cones = [clarabel.ZeroConeT(m), clarabel.NonnegativeConeT(2 * n)]
    hessian = sparse.identity(n, format='csc')
    solver = clarabel.DefaultSolver(hessian, np.zeros(n), rows, right, cones, options)
    solved = clarabel.SolverStatus.Solved

    def call(u: Array) -> Any:
        right[:m] = u
        solver.update(b=right)
        answer = solver.solve()
        return answer.x if answer.status == solved else None

    return call


def highs(problem: AllocationProblem, **settings: Any) -> Call:
    highspy: Any = import_module('highspy')
    m, n = problem.gamma.shape
    rows, center = sparse.csc_matrix(problem.gamma), problem.center
    model = highspy.HighsModel()
    columns = {'num_col_': n, 'col_cost_': np.zeros(n)}
    bounds = {'col_lower_': problem.lower, 'col_upper_': problem.upper}
    limits = {'num_row_': m, 'row_lower_': center, 'row_upper_': center}
    _set(model.lp_, {**columns, **bounds, **limits})
    matrix = {'start_': rows.indptr, 'index_': rows.indices, 'value_': rows.data}
    _set(model.lp_.a_matrix_, {'format_': highspy.MatrixFormat.kColwise, **matrix})
    identity = {'start_': np.arange(n + 1), 'index_': np.arange(n), 'value_': np.ones(n)}
    _set(model.hessian_, {'dim_': n, 'format_': highspy.HessianFormat.kTriangular, **identity})
    solver = highspy.Highs()
    for name, value in {'output_flag': False, **settings}.items():
        solver.setOptionValue(name, value)
    solver.passModel(model)
    numbers, solved = np.arange(m, dtype=np.int32), highspy.HighsModelStatus.kOptimal

    def call(u: Array) -> Any:
        solver.changeRowsBounds(m, numbers, u, u)
        solver.run()
        return solver.getSolution().col_value if solver.getModelStatus() == solved else None

    return call


def _set(options: Any, values: Mapping[str, Any]) -> Any:
    for name, value in values.items():
        setattr(options, name, value)
    return options
