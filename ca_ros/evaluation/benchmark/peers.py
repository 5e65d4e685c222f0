"""Contenders of a benchmark: our methods, and the solvers of others, each at its fastest.

The others solve the exact allocator's quadratic program,
``min |f|^2 / 2`` subject to ``Gamma f = u`` and ``low <= f <= high``, Eqs. (20)-(22).  What does
not depend on u is set up once, and each call changes u alone where the solver's interface allows
it.  A call answers with the thrusts (n,), which may be a view of the solver's memory, or with None
if the solver does not claim to have solved the problem: to look at that is part of the call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from operator import attrgetter
from time import perf_counter
from typing import Any

import numpy as np
from scipy import sparse

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.timing import Track
from ca_ros.evaluation.judge import Judge
from ca_ros.problem.problem import AllocationProblem

Call = Callable[[Array], Any]
"""From a wrench (m,) [N, N m] to what is answered."""

Settings = Mapping[str, Any]


@dataclass(frozen=True)
class Peer:
    """A solver and how it is used.

    Attributes
    ----------
    package : str
        Name of the package, and of its module.
    interface : str
        What a call does, in words.
    settings : mapping
        Those that are not the solver's defaults.
    build : callable
        Returns the call, from the module, the problem and the settings.
    """

    package: str
    interface: str
    settings: Settings
    build: Callable[[Any, AllocationProblem, Settings], Call]


def _set(options: Any, settings: Settings) -> Any:
    """Set the attributes of a solver's options; return them."""
    for name, value in settings.items():
        setattr(options, name, value)
    return options


def _osqp(osqp: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    low = np.concatenate([problem.image.center, problem.lower])
    high = np.concatenate([problem.image.center, problem.upper])
    rows = sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n)]))
    solver = osqp.OSQP()
    solver.setup(sparse.identity(n, format='csc'), np.zeros(n), rows, low, high, **settings)
    solved = int(osqp.SolverStatus.OSQP_SOLVED)

    def call(u: Array) -> Any:
        low[:m] = high[:m] = u
        solver.update(l=low, u=high)
        answer = solver.solve(raise_error=False)
        return answer.x if answer.info.status_val == solved else None

    return call


def _daqp(daqp: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    # The first n rows are bounds; 5 marks an equality.
    low = np.concatenate([problem.lower, problem.image.center])
    high = np.concatenate([problem.upper, problem.image.center])
    sense = np.array([0] * n + [5] * m, dtype=np.intc)
    # DAQP asks for arrays that can be written to.
    data = np.eye(n), np.zeros(n), problem.gamma.copy()

    def one_shot(u: Array) -> Any:
        low[n:] = high[n:] = u
        x, _, flag, _ = daqp.solve(*data, high, low, sense)
        return x if flag == 1 else None

    def reused(u: Array) -> Any:
        low[n:] = high[n:] = u
        model.update(bupper=high, blower=low)
        x, _, flag, _ = model.solve()
        return x if flag == 1 else None

    if not settings['workspace']:
        return one_shot
    model = daqp.Model()
    model.setup(*data, high.copy(), low.copy(), sense)
    return reused


def _quadprog(quadprog: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    # The identity is its own factor.  Fortran's order spares a copy.
    factor, cost = np.eye(n, order='F'), np.zeros(n)
    rows = np.asfortranarray(np.hstack([problem.gamma.T, np.eye(n), -np.eye(n)]))
    right = np.concatenate([problem.image.center, problem.lower, -problem.upper])

    def call(u: Array) -> Any:
        right[:m] = u
        try:
            return quadprog.solve_qp(factor, cost, rows, right, m, settings['factorized'])[0]
        except ValueError:
            # Its way to say that there is no solution.
            return None

    return call


def _piqp(piqp: Any, problem: AllocationProblem, settings: Settings) -> Call:
    n = problem.gamma.shape[1]
    solver = piqp.DenseSolver()
    _set(solver.settings, settings)
    solver.setup(
        np.eye(n, order='F'),
        np.zeros(n),
        np.asfortranarray(problem.gamma),
        problem.image.center,
        x_l=problem.lower,
        x_u=problem.upper,
    )
    solved = piqp.PIQP_SOLVED

    def call(u: Array) -> Any:
        solver.update(b=u)
        return solver.result.x if solver.solve() == solved else None

    return call


def _proxqp(proxsuite: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    proxqp = proxsuite.proxqp
    solver = proxqp.dense.QP(n, m, n, False, proxqp.dense.HessianType.Diagonal)
    _set(solver.settings, settings)
    bounds = np.eye(n), problem.lower, problem.upper
    solver.init(np.eye(n), np.zeros(n), problem.gamma, problem.image.center, *bounds)
    solved = proxqp.PROXQP_SOLVED

    def call(u: Array) -> Any:
        solver.update(b=u)
        solver.solve()
        return solver.results.x if solver.results.info.status == solved else None

    return call


def _clarabel(clarabel: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    options = _set(clarabel.DefaultSettings(), settings)
    rows = sparse.csc_matrix(np.vstack([problem.gamma, np.eye(n), -np.eye(n)]))
    right = np.concatenate([problem.image.center, problem.upper, -problem.lower])
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


def _highs(highspy: Any, problem: AllocationProblem, settings: Settings) -> Call:
    m, n = problem.gamma.shape
    rows = sparse.csc_matrix(problem.gamma)
    model = highspy.HighsModel()
    program, hessian = model.lp_, model.hessian_
    program.num_col_, program.num_row_, program.col_cost_ = n, m, np.zeros(n)
    program.col_lower_, program.col_upper_ = problem.lower, problem.upper
    program.row_lower_ = program.row_upper_ = problem.image.center
    matrix = program.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kColwise
    matrix.start_, matrix.index_, matrix.value_ = rows.indptr, rows.indices, rows.data
    hessian.dim_, hessian.format_ = n, highspy.HessianFormat.kTriangular
    hessian.start_, hessian.index_ = np.arange(n + 1), np.arange(n)
    hessian.value_ = np.ones(n)
    solver = highspy.Highs()
    for name, value in settings.items():
        solver.setOptionValue(name, value)
    solver.passModel(model)
    numbers, solved = np.arange(m, dtype=np.int32), highspy.HighsModelStatus.kOptimal

    def call(u: Array) -> Any:
        solver.changeRowsBounds(m, numbers, u, u)
        solver.run()
        return solver.getSolution().col_value if solver.getModelStatus() == solved else None

    return call


PEERS: dict[str, Peer] = {
    'osqp': Peer(
        'osqp',
        'update of l and u, then solve, warm-started; default tolerances',
        {'verbose': False, 'warm_starting': True},
        _osqp,
    ),
    'osqp_polished': Peer(
        'osqp',
        'update of l and u, then solve, warm-started; tolerances of 1e-5, then polishing',
        {
            'verbose': False,
            'warm_starting': True,
            'eps_abs': 1e-5,
            'eps_rel': 1e-5,
            'polishing': True,
        },
        _osqp,
    ),
    'daqp': Peer('daqp', 'one-shot daqp.solve', {'workspace': False}, _daqp),
    'daqp_reused': Peer(
        'daqp',
        'Model.update of both bounds, then solve in the same workspace',
        {'workspace': True},
        _daqp,
    ),
    'quadprog': Peer(
        'quadprog',
        'solve_qp with the factor of the Hessian given, arrays in Fortran order',
        {'factorized': True},
        _quadprog,
    ),
    'piqp': Peer(
        'piqp',
        'DenseSolver.update of b, then solve',
        {'preconditioner_reuse_on_update': True},
        _piqp,
    ),
    'proxqp': Peer(
        'proxsuite',
        'dense.QP.update of b, then solve from the equality-constrained guess',
        {'eps_abs': 1e-9, 'eps_rel': 0.0, 'max_iter': 100},
        _proxqp,
    ),
    'clarabel': Peer(
        'clarabel',
        'DefaultSolver.update of b, then solve',
        {'verbose': False, 'max_threads': 1, 'presolve_enable': False},
        _clarabel,
    ),
    'highs': Peer(
        'highspy',
        'changeRowsBounds, then run',
        {'output_flag': False, 'threads': 1},
        _highs,
    ),
}
"""The peers by name."""


BASELINE = 'clipped_pinv'
"""The clipped pseudo-inverse, in whose time all others are expressed."""


@dataclass(frozen=True, eq=False)
class Contender:
    """A way to answer a wrench.

    Attributes
    ----------
    call : callable
    kind : str
        'baseline', 'method' of this package, or 'peer'.
    about : mapping
        What a call does, with which version and settings, and how long the set-up took [s].
    """

    call: Call
    kind: str
    about: Mapping[str, Any]

    def track(self, judge: Judge) -> Track:
        """Return the contender with the wrenches that it is to allocate."""
        thrusts = attrgetter('thrusts') if self.kind == 'method' else lambda answer: answer
        return Track(self.call, thrusts, judge)


def baseline(problem: AllocationProblem) -> Contender:
    """Return the clipped pseudo-inverse in bare NumPy: no checks, no result object."""
    inverse, low, high = np.linalg.pinv(problem.gamma), problem.lower, problem.upper
    minimum, maximum = np.minimum, np.maximum

    def call(u: Array) -> Array:
        return minimum(maximum(inverse @ u, low), high)

    about = {'interface': 'np.minimum(np.maximum(inverse @ u, low), high)'}
    return Contender(call, 'baseline', about)


def method(make: Callable[[], Allocator]) -> Contender:
    """Return a method of this package, or of the user's own."""
    start = perf_counter()
    allocator = make()
    about = {'interface': 'allocate, checks and result included', 'setup': perf_counter() - start}
    return Contender(allocator.allocate, 'method', about)


def peer(name: str, problem: AllocationProblem) -> Contender:
    """Return a solver of `PEERS`; raise an ImportError if it is not installed."""
    found, start = PEERS[name], perf_counter()
    call = found.build(import_module(found.package), problem, found.settings)
    setup = perf_counter() - start
    try:
        installed = version(found.package)
    except PackageNotFoundError:
        installed = 'unknown'
    about = {'package': found.package, 'version': installed, 'interface': found.interface}
    return Contender(call, 'peer', {**about, 'settings': dict(found.settings), 'setup': setup})


def peers(problem: AllocationProblem) -> tuple[dict[str, Contender], dict[str, str]]:
    """Return the solvers that are installed, and of the others how to install them."""
    there: dict[str, Contender] = {}
    absent: dict[str, str] = {}
    for name, found in PEERS.items():
        try:
            there[name] = peer(name, problem)
        except ImportError:
            absent[name] = f'pip install {found.package}'
    return there, absent
