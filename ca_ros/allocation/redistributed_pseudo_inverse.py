"""The redistributed pseudo-inverse, also called cascaded generalised inverse."""

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.allocation.weighted_pseudo_inverse import (
    WeightedPseudoInverseSettings,
    weighted_inverse,
)
from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.programs import EXACT_TOLERANCE
from ca_ros.vehicle.validation import repeated


class RedistributedPseudoInverse(Allocator):
    """The pseudo-inverse, repeated for the rotors that are not saturated.

    Thrusts beyond a bound are set to the bound and stay there.  The pseudo-inverse of the columns
    of the other rotors distributes what is left of the wrench, until no thrust is beyond its
    bounds or no rotor is left [1]_ [2]_.  A thrust that was set to a bound is never released, so
    attainable wrenches may be missed.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    weights : float or (n,) array, default 1
        Weight of each rotor in the norm of the thrusts, positive, at most 1e4 times each other.

    References
    ----------
    .. [1] J. C. Virnig and D. S. Bodden, "Multivariable control allocation and control law
       conditioning when control effectors limit", AIAA Guidance, Navigation, and Control
       Conference, AIAA-94-3609-CP, 1994.
    .. [2] K. A. Bordignon, Constrained Control Allocation for Systems with Redundant Control
       Effectors, PhD thesis, Virginia Polytechnic Institute and State University, 1996.
    """

    solves = (
        'f = sat(Gamma^+ u), repeated for the rotors that are not saturated (cascaded '
        'generalised inverse)'
    )

    settings_type = WeightedPseudoInverseSettings
    settings: WeightedPseudoInverseSettings

    def _set_up(self) -> None:
        self.weights = repeated('weights', self.settings.weights, self.problem.n)
        # Rotors that cannot change their thrust are saturated from the start.
        self._movable = self.problem.half_range > 0.0
        self._rounding = EXACT_TOLERANCE * np.maximum(1.0, np.abs(self.problem.upper))
        self._inverse = self._inverse_of(self._movable)

    def _inverse_of(self, free: BoolArray) -> Array:
        return weighted_inverse(self.problem.gamma[:, free], self.weights[free])

    def _allocate(self, u: Array) -> Allocation:
        problem, gamma = self.problem, self.problem.gamma
        free, inverse = self._movable.copy(), self._inverse
        thrusts = problem.middle.copy()
        violation = 0.0
        for _ in range(self.problem.n):
            wanted = inverse @ (u - gamma[:, ~free] @ thrusts[~free])
            thrusts[free] = wanted
            thrusts = problem.clip(thrusts)
            beyond = np.abs(wanted - thrusts[free])
            violation = max(violation, float(beyond.max(initial=0.0)))
            before, free[free] = free.sum(), beyond <= self._rounding[free]
            if free.sum() in (0, before):
                break
            inverse = self._inverse_of(free)
        return Allocation(problem, u, thrusts, self._status(u, thrusts), violation=violation)
