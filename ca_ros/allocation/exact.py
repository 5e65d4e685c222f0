"""The exact allocator, the paper's proposal."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.exact_engines import NumpyEngine, Setting, kernel_for
from ca_ros.allocation.option_values import per_rotor, weights_per_rotor
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.kernel import INVALID, chosen
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.prioritization import ORDER, REVERSAL, REVERSALS, default_order, groups_of
from ca_ros.problem.problem import AllocationProblem
from ca_ros.schema import Parameter, check
from ca_ros.vehicle.vehicle import Vehicle

POLICIES = {
    'prioritize': Status.PRIORITIZED,
    'scale': Status.SCALED,
    'reject': Status.REJECTED,
}
"""The status of a wrench outside of the admissible set, by policy."""

EXACT = Status.EXACT

STATUSES = tuple(Status)
"""By number; to look one up in the enumeration takes ten times as long."""

PREFERRED_MAX = 100.0
"""Greatest preferred thrust, in units of the greatest bound."""

THREAD_MIN = 8192
"""Wrenches of a batch for each thread, at least."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    # macOS has no affinities.
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Exact(Allocator):
    """Allocate the wrench exactly, with the smallest thrusts, Eqs. (20)-(22).

    The allocator solves ``min |f|^2`` subject to ``Gamma f = u`` and the bounds of the thrusts.
    With weights or preferred thrusts the cost is ``|W (f - f_p)|^2``.
    The problem is feasible for every u in the admissible set.  For a u outside the set, the policy
    chooses an attainable wrench, which is then allocated exactly.  A batch uses all processors
    that the process may run on.

    Parameters
    ----------
    vehicle : Vehicle or AllocationProblem
    policy : 'prioritize', 'scale' or 'reject'
        What to allocate for a wrench outside the admissible set: the result of
        `AdmissibleSet.prioritize`, the result of `AdmissibleSet.scale`, or nothing.
    order : sequence of groups of axes, optional
        The priorities of 'prioritize'.
    about : (m,) array, optional
        The reference of 'scale' [N, N m].
    solver : 'newton' or 'osqp'
        Where the solver starts: at the pseudo-inverse or at the solution of OSQP.  Both end at the
        same thrusts, to rounding.  With 'osqp' the NumPy implementation solves the problem.
    reversal : 'prevent', 'avoid' or 'allow'
        An option of 'prioritize', see `AdmissibleSet.prioritize`.
    slack : float
        Greatest error of an attainable wrench u, as a share of max(1, |u|).  It is used only where
        facets of the admissible set are almost parallel, because the vehicle is symmetric except
        for the rounding of its file.  There it keeps the thrusts from jumping.
    weights : float or (n,) array
        The diagonal of W, positive, at most 1e4 times each other.  A rotor with a greater weight
        deviates less from its preferred thrust.
    preferred : float or (n,) array
        f_p, the preferred thrusts [N].

    Attributes
    ----------
    engine : str
        'C' if the kernel (`ca_ros.kernel`) solves the problem, or 'NumPy'.
    setting : Setting
        What the engine was given; `ca_ros.firmware` exports a kernel with the same setting.

    Raises
    ------
    ValueError
        If an option is wrong, the vehicle's admissible set has no volume, or OSQP is missing.
    """

    solves = 'quadratic program: min |f|^2 with Gamma f = u within the bounds'
    guarantees = 'the bounds, and Gamma f = u for every admissible u'
    parameters: ClassVar = {
        'policy': Parameter(
            'what exact allocates for an unattainable wrench. prioritize: the axes in the order '
            'of their priorities; scale: the wrench scaled towards hover; reject: nothing',
            str,
            default='prioritize',
            choices=tuple(POLICIES),
            mutable=True,
        ),
        'order': Parameter(
            'priorities of prioritize: groups of axes, the most important first',
            str,
            array=True,
            default=[' '.join(group) for group in ORDER],
            mutable=True,
        ),
        'reversal': Parameter(
            'how far thrust may deviate from its demand so that no axis after the first group is '
            'reversed. prevent: as far as necessary; avoid: no further than hover; allow: not '
            'at all',
            str,
            default=REVERSAL,
            choices=REVERSALS,
            mutable=True,
        ),
        'slack': Parameter(
            'greatest error of an attainable wrench u, as a share of max(1, |u|). It is used '
            'only for vehicles that are symmetric except for the rounding of their file',
            default=1e-9,
            minimum=0.0,
            maximum=1e-2,
            mutable=True,
        ),
        'weights': Parameter(
            'weight of each rotor in the cost: one number, or one for each rotor; a rotor with a '
            'greater weight deviates less from its preferred thrust',
            array=True,
            default=1.0,
            positive=True,
            mutable=True,
        ),
        'preferred': Parameter(
            'thrusts that the cost prefers: one number, or one for each rotor [N]',
            array=True,
            default=0.0,
            mutable=True,
        ),
        'solver': Parameter(
            'where the solver starts. newton: at the pseudo-inverse; osqp: at the solution of '
            'OSQP. Both end at the same thrusts',
            str,
            default='newton',
            choices=('newton', 'osqp'),
            mutable=True,
        ),
    }

    def __init__(
        self,
        vehicle: Vehicle | AllocationProblem,
        policy: str = 'prioritize',
        order: Sequence[Sequence[str]] | None = None,
        about: ArrayLike | None = None,
        solver: str = 'newton',
        reversal: str = REVERSAL,
        slack: float = 1e-9,
        weights: ArrayLike = 1.0,
        preferred: ArrayLike = 0.0,
    ) -> None:
        super().__init__(vehicle)
        for name, value in (
            ('policy', policy),
            ('solver', solver),
            ('slack', slack),
            ('reversal', reversal),
        ):
            check(name, value, self.parameters)
        self.policy, self.order, self.reversal, self.about = policy, order, reversal, about
        self.slack, self.solver = slack, solver
        problem = self.problem
        self._n = problem.n
        self.weights = weights_per_rotor('weights', weights, problem.n, self.parameters)
        self.preferred = per_rotor('preferred', preferred, problem.n, self.parameters)
        preference = None
        limit = PREFERRED_MAX * max(1.0, *np.abs([problem.lower, problem.upper]).ravel())
        if np.abs(self.preferred).max() > limit:
            raise ValueError(
                f'preferred: expected thrusts up to {limit:g}, got {self.preferred.tolist()}'
            )
        if np.any(self.weights != 1.0) or np.any(self.preferred != 0.0):
            preference = self.weights, self.preferred
        self._preference = preference
        axes = problem.axes
        groups = default_order(axes) if order is None else groups_of(order, axes)
        if about is not None:
            self.admissible.check_reference(about)
        kernel = chosen(problem.n, len(axes)) if solver == 'newton' else None
        status = POLICIES[policy]
        if policy == 'prioritize':
            reference, inside = problem.reference, False
        else:
            groups, reversal, inside = (axes,), 'allow', True
            reference = self.admissible.reference if about is None else problem.check(about)
        self.setting = Setting(
            groups, reversal, reference, inside, status, slack, *(preference or ())
        )
        self.engine = 'C' if kernel else 'NumPy'
        self._engine = (
            kernel_for(kernel, problem, self.setting)
            if kernel
            else NumpyEngine(problem, self.setting, solver == 'osqp')
        )

    def __reduce__(self) -> tuple[type[Exact], tuple[object, ...]]:
        # The kernel cannot be copied; its set-up takes microseconds.
        options = (self.policy, self.order, self.about, self.solver, self.reversal, self.slack)
        return type(self), (self.problem, *options, self.weights, self.preferred)

    @cached_property
    def admissible(self) -> AdmissibleSet:
        """The set of attainable wrenches."""
        return AdmissibleSet(self.problem)

    def allocate(self, u: ArrayLike) -> Allocation:
        """Allocate one wrench; see `Allocator.allocate`."""
        try:
            demand = np.array(u, float)
            thrusts = np.empty(self._n)
            answer = self._engine.allocate(demand, thrusts)
        except (TypeError, ValueError):
            # The check names what is wrong.
            self.problem.check(u)
            raise
        if answer is None:
            result = Allocation(self.problem, demand, thrusts, EXACT)
        else:
            if answer[0] == INVALID:
                self.problem.check(u)
            result = Allocation(self.problem, demand, thrusts, STATUSES[answer[0]], answer[1])
        if self._preference:
            result.__dict__['preference'] = self._preference
        return result

    def _allocate(self, u: Array) -> Allocation:
        return self.allocate(u)

    def _allocate_batch(self, demands: Array) -> Allocation:
        size = len(demands)
        demands = np.ascontiguousarray(demands)
        thrusts = np.empty((size, self._n))
        status, levels = np.empty(size, dtype=np.int8), np.empty(size)
        threads = max(1, min(processors(), size // THREAD_MIN))
        ends = [i * size // threads for i in range(threads + 1)]

        def work(first: int, last: int) -> None:
            part = slice(first, last)
            self._engine.allocate_batch(
                demands[part], thrusts[part], status[part], levels[part], None
            )

        if threads > 1:
            # Imported here: few programs allocate great batches.
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(work, ends[:-1], ends[1:]))
        elif size:
            work(0, size)
        result = self._batch(demands, thrusts, status, levels)
        result.__dict__['preference'] = self._preference
        return result
