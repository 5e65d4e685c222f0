"""The exact allocator, the paper's proposal."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from ca_ros.admissible_set import AdmissibleSet
from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.least_norm import LeastNorm
from ca_ros.vehicle import Vehicle

POLICIES = ('prioritize', 'scale', 'reject')


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

    Raises
    ------
    ValueError
        If an option is wrong, or the vehicle's admissible set has no volume.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        policy: str = 'prioritize',
        order: Sequence[Sequence[str]] | None = None,
        about: ArrayLike | None = None,
    ) -> None:
        super().__init__(vehicle)
        if policy not in POLICIES:
            raise ValueError(f'policy: expected one of {", ".join(POLICIES)}, got {policy!r}')
        self.policy, self.order, self.about = policy, order, about
        self.admissible = AdmissibleSet(self.problem)
        self._least_norm = LeastNorm(self.problem.gamma, self.problem.lower, self.problem.upper)
        self.admissible.scale(self.admissible.center, about)
        self.admissible.prioritize(self.admissible.center, order)

    def _allocate(self, u: Array) -> Allocation:
        tolerance = float(self.problem.tolerance(u))
        if self.admissible.zonotope.margin(u) >= -0.5 * tolerance:
            return self._serve(u, u, tolerance, Status.EXACT, 1.0)
        if self.policy == 'reject':
            return Allocation(
                self.problem, u, self.problem.lower.copy(), Status.REJECTED, level=0.0
            )
        if self.policy == 'scale':
            served, level = self.admissible.scale_level(u, self.about)
            return self._serve(u, served, tolerance, Status.SCALED, level)
        served, levels = self.admissible.prioritize_levels(u, self.order)
        return self._serve(u, served, tolerance, Status.PRIORITIZED, float(levels.min()))

    def _serve(
        self, u: Array, served: Array, tolerance: float, status: Status, level: float
    ) -> Allocation:
        thrusts = self._least_norm.solve(served, tolerance)
        if self._judge(u, thrusts):
            return Allocation(self.problem, u, thrusts, Status.EXACT)
        if not self._judge(served, thrusts):
            status = Status.INEXACT
        return Allocation(self.problem, u, thrusts, status, level=level)
