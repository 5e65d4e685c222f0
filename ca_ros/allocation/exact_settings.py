"""The settings of the exact allocator, and what its engines make of them for a problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ca_ros.allocation.result import Status
from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.prioritization import AIRMODE, PrioritiesSettings, airmode_limits
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import Numbers, ParameterError, setting
from ca_ros.vehicle.validation import check_ratio

POLICIES = {'prioritize': Status.PRIORITIZED, 'scale': Status.SCALED, 'reject': Status.REJECTED}
"""The status of a wrench outside of the admissible set, by policy."""

PREFERRED_MAX = 100.0  # greatest preferred thrust, in units of the greatest bound


class Serving(NamedTuple):
    """How wrenches that are not attainable are served: the arguments of `Prioritization`.

    For the policies other than 'prioritize', all axes are one group, and `begin` is the reference.
    """

    groups: Sequence[Sequence[int]]
    reference: Array
    axis_reversal: str
    begin: Array | None = None
    airmode_limit: Sequence[float] = AIRMODE


@dataclass(frozen=True, kw_only=True)
class ExactSettings(PrioritiesSettings):
    """The settings of `Exact`."""

    policy: Literal['prioritize', 'scale', 'reject'] = setting(
        'prioritize',
        'what exact allocates for an unattainable wrench. prioritize: the axes in the order of '
        'their priorities; scale: the wrench scaled towards hover; reject: nothing', mutable=True)
    scale_reference: Numbers | None = setting(
        None, 'the reference of scale', unit='N, N m', python_only=True)
    residual_slack: float = setting(
        1e-9,
        'greatest error of an attainable wrench u, as a share of max(1, |u|). It is used only for '
        'vehicles that are symmetric except for the rounding of their file', minimum=0.0,
        maximum=1e-2, mutable=True)
    weights: Numbers = setting(
        1.0,
        'weight of each rotor in the cost: one number, or one for each rotor, at most 1e4 times '
        'each other; a rotor with a greater weight deviates less from its preferred thrust',
        positive=True, mutable=True)
    preferred: Numbers = setting(
        0.0, 'thrusts that the cost prefers: one number, or one for each rotor', unit='N',
        mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ratio('weights', self.weights)

    @property
    def status(self) -> Status:
        """The status of a wrench that is not attainable."""
        return POLICIES[self.policy]

    def preference(self, problem: AllocationProblem) -> tuple[Array, Array] | None:
        """Return the diagonal of W and f_p (n,) [1, N]; None if they are ones and zeros.

        Raises a ParameterError if there is not one number for each effector, or a preferred thrust
        is too great.
        """
        if self.weights == 1.0 and self.preferred == 0.0:
            return None
        weights = problem.spread('weights', self.weights)
        preferred = problem.spread('preferred', self.preferred, along=True)
        limit = PREFERRED_MAX * max(1.0, *np.abs([problem.lower, problem.upper]).ravel())
        if np.abs(preferred).max() > limit:
            found = preferred.tolist()
            raise ParameterError(f'preferred: expected thrusts up to {limit:g}, got {found}')
        plain = np.all(weights == 1.0) and np.all(preferred == 0.0)
        return None if plain else (weights, preferred)

    def serving(self, problem: AllocationProblem) -> Serving:
        """Return how wrenches that are not attainable are served.

        Raises a ParameterError if the order does not suit the axes, or the reference of scale is
        not attainable, or a ValueError if the problem's admissible set has no volume.
        """
        axes, admissible, given = problem.axes, AdmissibleSet(problem), self.scale_reference
        groups = [[axes.index(axis) for axis in group] for group in self.groups(axes)]
        start = None if given is None else admissible.check_reference(given)
        if self.policy == 'prioritize':
            limits = airmode_limits(self.airmode_limit)
            return Serving(groups, problem.reference, self.axis_reversal, None, limits)
        start = admissible.reference if start is None else start
        return Serving([range(len(axes))], start, 'allow', start)
