"""The exact allocator, the paper's proposal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.osqp_start import OsqpStart
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.prioritization import ORDER, REVERSAL, REVERSALS
from ca_ros.problem.problem import EXACT_TOLERANCE, lengths
from ca_ros.schema import Parameter, check
from ca_ros.solver.critical_region import AffineLaw
from ca_ros.solver.dual_newton import Solution
from ca_ros.solver.region_memory import AffineLaws
from ca_ros.solver.region_proof import explicit_law
from ca_ros.vehicle.vehicle import Vehicle

POLICIES = {
    'prioritize': Status.PRIORITIZED,
    'scale': Status.SCALED,
    'reject': Status.REJECTED,
}
"""The status of a wrench outside of the admissible set, by policy."""

EXACT = Status.EXACT

BATCH_MIN = 16
"""From so many wrenches on a batch is faster than one wrench after the other."""

LAW_SHARE = 0.5
"""Of the tolerance, that a law may use up; the rest is for those who sum up in another order."""


class Exact(Allocator):
    """The least thrusts that give the wrench exactly, Eqs. (20)-(22).

    ``min |f|^2`` subject to ``Gamma f = u`` and the bounds.  It is feasible for every u in the
    admissible set; outside, the policy names a wrench in the set, which is then allocated exactly.

    Parameters
    ----------
    vehicle : Vehicle
    policy : 'prioritize', 'scale' or 'reject'
        What to serve for a wrench outside the admissible set: `AdmissibleSet.prioritize`,
        `AdmissibleSet.scale` or nothing.
    order : sequence of groups of axes, optional
        Of 'prioritize'.
    reversal : 'prevent', 'avoid' or 'allow'
        Of 'prioritize', see `AdmissibleSet.prioritize`.
    about : (m,) array, optional
        Reference of 'scale' [N, N m].
    solver : 'newton' or 'osqp'
        Where the solution begins: at the pseudo-inverse, or at OSQP's answer.  It ends at the same
        thrusts, to rounding.
    slack : float
        Where facets of the admissible set are almost parallel, because the vehicle is symmetric
        but for the digits of its file, an attainable wrench u may be missed by up to
        ``slack max(1, |u|)``, so that the thrusts do not jump [N, N m].

    Raises
    ------
    ValueError
        If an option is wrong, the vehicle's admissible set has no volume, or OSQP is not there.
    """

    parameters: ClassVar = {
        'policy': Parameter(
            'what the exact allocator serves for a wrench that is not attainable',
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
            'what thrust gives up so that no axis after the first group is reversed. '
            'prevent: as much as that takes; avoid: no more than down or up to hover; allow: '
            'nothing',
            str,
            default=REVERSAL,
            choices=REVERSALS,
            mutable=True,
        ),
        'slack': Parameter(
            'share of a wrench, or of 1 N or 1 N m, by which it may be missed where the vehicle '
            'is symmetric but for the digits of its file',
            default=1e-9,
            minimum=0.0,
            maximum=1e-2,
            mutable=True,
        ),
        'solver': Parameter(
            'where the solution begins: at the pseudo-inverse, or at the answer of OSQP',
            str,
            default='newton',
            choices=('newton', 'osqp'),
            mutable=True,
        ),
    }

    def __init__(
        self,
        vehicle: Vehicle,
        policy: str = 'prioritize',
        order: Sequence[Sequence[str]] | None = None,
        about: ArrayLike | None = None,
        solver: str = 'newton',
        reversal: str = REVERSAL,
        slack: float = 1e-9,
    ) -> None:
        super().__init__(vehicle)
        for name, value in (('policy', policy), ('solver', solver), ('slack', slack)):
            check(name, value, self.parameters)
        self.slack = slack
        self.policy, self.order, self.reversal, self.about = policy, order, reversal, about
        self.admissible = AdmissibleSet(self.problem)
        self._least_norm = self.problem.least_norm
        self._laws = AffineLaws(vehicle.n, self._learn)
        self._osqp = OsqpStart(self.problem) if solver == 'osqp' else None
        # A wrong option is an error now, not at the first wrench that needs it.
        scaling = self.admissible.check_reference(about)
        priorities = self.admissible.check_order(order, reversal)
        self._attainable = priorities if policy == 'prioritize' else scaling

    def _allocate(self, u: Array) -> Allocation:
        laws = self._laws
        thrusts = laws.find(u)
        if thrusts is not None and (laws.proven or self._judge(u, thrusts, LAW_SHARE)):
            return Allocation(self.problem, u, thrusts, EXACT)
        served, levels, reached = self._attainable(u)
        if reached:
            thrusts, attained = self._solve(u)
            if attained or self._within_slack(u, served, thrusts):
                return Allocation(self.problem, u, thrusts, EXACT)
        status = POLICIES[self.policy]
        if status is Status.REJECTED:
            return Allocation(self.problem, u, self.problem.lower.copy(), status, 0.0)
        thrusts, attained = self._solve(served)
        if not attained:
            status = Status.INEXACT
        return Allocation(self.problem, u, thrusts, status, float(levels.min()))

    def _within_slack(self, u: Array, served: Array, thrusts: Array) -> bool:
        """Tell whether u is attainable, as `served` proves, and missed by no more than `slack`."""
        tolerance = self.problem.tolerance(u)
        slack = tolerance / EXACT_TOLERANCE * self.slack
        missed = lengths(u - self.problem.gamma @ thrusts)
        return bool(lengths(served - u) <= tolerance and missed <= slack)

    def _solve(self, u: Array) -> tuple[Array, bool]:
        """Return the least thrusts for a wrench, and whether it is attainable."""
        start = None
        if self._osqp is not None:
            start = self._osqp.multipliers(u)
        else:
            thrusts = self._laws.find_or_learn(u)
            if self._laws.proven or self._judge(u, thrusts, LAW_SHARE):
                return thrusts, True
        solution = self._least(u, start)
        return solution.thrusts, solution.attained

    def _learn(self, u: Array) -> tuple[Array, AffineLaw | None]:
        solution = self._least(u)
        law = explicit_law(self._least_norm, solution.multipliers, LAW_SHARE * EXACT_TOLERANCE)
        return solution.thrusts, None if solution.relaxed else law

    def _least(self, u: Array, start: Array | None = None) -> Solution:
        tolerance = float(self.problem.tolerance(u))
        slack = tolerance / EXACT_TOLERANCE * self.slack
        return self._least_norm.solve(u, tolerance, start, slack)

    def _allocate_batch(self, demands: Array) -> Allocation:
        if self._osqp is not None or len(demands) < BATCH_MIN:
            return super()._allocate_batch(demands)
        problem = self.problem
        status, levels = np.zeros(len(demands), dtype=np.int8), np.ones(len(demands))
        thrusts = self._laws.find_batch(demands)
        left = np.flatnonzero(~self._judge(demands, thrusts, LAW_SHARE))
        beyond = problem.image.margin(demands[left]) < 0.0
        inside, outside = left[~beyond], left[beyond]
        thrusts[inside] = self._laws.find_or_learn_batch(demands[inside])
        if self.policy != 'reject':
            served, shares, reached = self._attainable(demands[outside])
            levels[outside], status[outside] = shares.min(axis=-1), POLICIES[self.policy]
            thrusts[outside] = self._laws.find_or_learn_batch(served)
            outside = outside[~self._judge(served, thrusts[outside], LAW_SHARE) | reached]
        inside = inside[~self._judge(demands[inside], thrusts[inside], LAW_SHARE)]
        # What is not clear, as on the boundary, is looked at one by one.
        for i in [*inside, *outside]:
            answer = self._allocate(demands[i])
            thrusts[i], status[i], levels[i] = answer.thrusts, answer.status, answer.level
        return self._batch(demands, thrusts, status, levels)
