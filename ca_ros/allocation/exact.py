"""The exact allocator, the paper's proposal."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from ca_ros.admissible_set import AdmissibleSet
from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.osqp_start import OsqpStart
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.least_norm import LeastNorm
from ca_ros.vehicle import Vehicle

POLICIES = ('prioritize', 'scale', 'reject')
SOLVERS = ('newton', 'osqp')


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
        problem = self.problem
        self.policy, self.order, self.about = policy, order, about
        self.admissible = AdmissibleSet(problem)
        self._least_norm = LeastNorm(problem.gamma, problem.lower, problem.upper, problem.image)
        self._osqp = OsqpStart(problem) if solver == 'osqp' else None
        # A wrong option is an error now, not at the first wrench that needs it.
        self.admissible.check_reference(about)
        self.admissible.check_order(order)

    def _allocate(self, u: Array) -> Allocation:
        if self.problem.image.margin(u) >= -0.5 * self.problem.tolerance(u):
            return self._serve(u, u, Status.EXACT, 1.0)
        if self.policy == 'reject':
            return Allocation(
                self.problem, u, self.problem.lower.copy(), Status.REJECTED, level=0.0
            )
        if self.policy == 'scale':
            served, level = self.admissible.scale_level(u, self.about)
            return self._serve(u, served, Status.SCALED, level)
        served, levels = self.admissible.prioritize_levels(u, self.order)
        return self._serve(u, served, Status.PRIORITIZED, float(levels.min()))

    def _serve(self, u: Array, served: Array, status: Status, level: float) -> Allocation:
        start = None if self._osqp is None else self._osqp.multipliers(served)
        tolerance = float(self.problem.tolerance(served))
        thrusts, multipliers = self._least_norm.solve(served, tolerance, start)
        if self._judge(u, thrusts):
            status, level = Status.EXACT, 1.0
        elif not self._judge(served, thrusts):
            status = Status.INEXACT
        return Allocation(self.problem, u, thrusts, status, level, multipliers=multipliers)
