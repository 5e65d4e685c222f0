"""The exact allocator, the paper's proposal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.admissible_set import AdmissibleSet
from ca_ros.affine_law import AffineLaw
from ca_ros.affine_laws import AffineLaws
from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.osqp_start import OsqpStart
from ca_ros.allocation.result import Allocation, Status
from ca_ros.allocation_problem import EXACT_TOLERANCE
from ca_ros.arrays import Array, IntArray
from ca_ros.explicit_law import explicit_law
from ca_ros.vehicle import Vehicle

POLICIES = {
    'prioritize': Status.PRIORITIZED,
    'scale': Status.SCALED,
    'reject': Status.REJECTED,
}
"""What a policy makes of a wrench outside of the admissible set."""

SOLVERS = ('newton', 'osqp')

EXACT = Status.EXACT

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
    about : (m,) array, optional
        Reference of 'scale' [N, N m].
    solver : 'newton' or 'osqp'
        Where the solution begins: at the pseudo-inverse, or at OSQP's answer.  It ends at the same
        thrusts, to rounding.

    Raises
    ------
    ValueError
        If an option is wrong, the vehicle's admissible set has no volume, or OSQP is not there.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        policy: str = 'prioritize',
        order: Sequence[Sequence[str]] | None = None,
        about: ArrayLike | None = None,
        solver: str = 'newton',
    ) -> None:
        super().__init__(vehicle)
        for name, value, choices in (('policy', policy, POLICIES), ('solver', solver, SOLVERS)):
            if value not in choices:
                raise ValueError(f'{name}: expected one of {", ".join(choices)}, got {value!r}')
        self.policy, self.order, self.about = policy, order, about
        self.admissible = AdmissibleSet(self.problem)
        self._least_norm = self.problem.least_norm
        self._laws = AffineLaws(vehicle.n, self._learn)
        self._osqp = OsqpStart(self.problem) if solver == 'osqp' else None
        # A wrong option is an error now, not at the first wrench that needs it.
        self.admissible.check_reference(about)
        self.admissible.check_order(order)

    def _allocate(self, u: Array) -> Allocation:
        laws = self._laws
        thrusts = laws.find(u)
        if thrusts is not None and (laws.proven or self._judge(u, thrusts, LAW_SHARE)):
            return Allocation(self.problem, u, thrusts, EXACT)
        served, level, status = self._within(u)
        thrusts = self._solve(served)
        if status == Status.REJECTED:
            thrusts = self.problem.lower.copy()
        elif self._judge(u, thrusts):
            return Allocation(self.problem, u, thrusts, Status.EXACT)
        elif not self._judge(served, thrusts):
            status = Status.INEXACT
        return Allocation(self.problem, u, thrusts, status, level)

    def _solve(self, u: Array) -> Array:
        """Return the least thrusts for a wrench in the set."""
        if self._osqp is not None:
            return self._least_norm.solve(u, self._tolerance(u), self._osqp.multipliers(u))[0]
        thrusts = self._laws.find_or_learn(u)
        if self._laws.proven or self._judge(u, thrusts, LAW_SHARE):
            return thrusts
        return self._least_norm.solve(u, self._tolerance(u))[0]

    def _learn(self, u: Array) -> tuple[Array, AffineLaw | None]:
        thrusts, multipliers = self._least_norm.solve(u, self._tolerance(u))
        return thrusts, explicit_law(self._least_norm, multipliers, LAW_SHARE * EXACT_TOLERANCE)

    def _tolerance(self, u: Array) -> float:
        return float(self.problem.tolerance(u))

    def _within(self, u: Array) -> tuple[Array, float, Status]:
        """Return what is served, its share of u, and the status."""
        if self.problem.image.margin(u) >= -0.5 * self.problem.tolerance(u):
            return u, 1.0, Status.EXACT
        served, levels = self._by_policy(u)
        return served, float(levels), POLICIES[self.policy]

    def _by_policy(self, u: Array) -> tuple[Array, Array]:
        """Return the wrenches (..., m) served for those (..., m) outside, and their shares."""
        if self.policy == 'scale':
            return self.admissible.scale_levels(u, self.about)
        if self.policy == 'prioritize':
            served, levels = self.admissible.check_order(self.order)(u)
            return served, levels.min(axis=-1)
        nothing = self.problem.gamma @ self.problem.lower
        return np.broadcast_to(nothing, u.shape), np.zeros(u.shape[:-1])

    def _allocate_batch(self, demands: Array) -> Allocation:
        if self._osqp is not None:
            return super()._allocate_batch(demands)
        status, levels = np.zeros(len(demands), dtype=np.int8), np.ones(len(demands))
        thrusts = self._laws.find_batch(demands)
        left = np.flatnonzero(~self._judge(demands, thrusts, LAW_SHARE))
        if len(left):
            thrusts[left], status[left], levels[left] = self._allocate_left(demands[left])
        return self._batch(demands, thrusts, status, levels)

    def _allocate_left(self, demands: Array) -> tuple[Array, IntArray, Array]:
        """Return thrusts, statuses and levels for demands whose laws are not known, if any."""
        served, levels = demands.copy(), np.ones(len(demands))
        status = np.full(len(demands), Status.EXACT, dtype=np.int8)
        margins = self.problem.image.margin(demands)
        outside = margins < -0.5 * self.problem.tolerance(demands)
        served[outside], levels[outside] = self._by_policy(demands[outside])
        status[outside] = POLICIES[self.policy]
        rejected = status == Status.REJECTED
        thrusts = np.tile(self.problem.lower, (len(demands), 1))
        thrusts[~rejected] = self._laws.find_or_learn_batch(served[~rejected])
        for i in np.flatnonzero(~self._judge(served, thrusts, LAW_SHARE) & ~rejected):
            thrusts[i] = self._solve(served[i])
        status[~self._judge(served, thrusts) & ~rejected] = Status.INEXACT
        exact = self._judge(demands, thrusts) & ~rejected
        status[exact], levels[exact] = Status.EXACT, 1.0
        return thrusts, status, levels
