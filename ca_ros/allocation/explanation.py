"""Why an answer is what it is: what was served of each axis, and what limits the rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.limits import (
    BY_HEALTH,
    BY_RATE,
    BY_TILT,
    BY_TILT_RATE,
    TOGETHER,
    Limits,
    shares,
)
from ca_ros.problem.problem import AllocationProblem

SHARE_ROUNDING = 1e-9  # of a miss, as a share of the way, beyond which it is more than the way
BY_ORDER = 'axes that come first'
"""What limits an axis that no bound limits: other axes take what the bounds would give."""
BY_METHOD = 'the method'
"""What limits an axis that the priorities would serve in full."""
BY_POLICY = "the policy 'reject'"
HOW = {
    BY_RATE: 'at its rate', BY_HEALTH: 'by its health', BY_TILT: 'at its greatest tilt',
    BY_TILT_RATE: 'at its tilt rate',
}


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Limits):
    """Why thrusts produce another wrench than the demand: its `Limits`, and more.

    - `problem`, `demand` (m,) [N, N m]
    - `margin`: signed distance of the demand to the boundary of the attainable set of this
      answer, positive inside [N, N m]; minus infinity if the set has no volume
    - `missed` (m,): demand minus wrench where `served` is below 1, else zero [N, N m]
    - `others` (m,): what limits each axis if no bound does
    """

    problem: AllocationProblem
    demand: Array
    margin: float
    missed: Array
    others: Sequence[str]

    @property
    def limits(self) -> dict[str, str]:
        """What limits each axis that is not served in full, in words by the name of the axis."""
        return {
            axis: self._words(k) for k, axis in enumerate(self.problem.axes)
            if self.served[k] < 1.0
        }

    def _words(self, axis: int) -> str:
        kind = self.problem.effector_kind.removesuffix('s')
        groups: dict[str, list[str]] = {}
        for i in np.flatnonzero(self.blocks[axis]).tolist():
            limit = int(self.limit[i])
            how = HOW.get(abs(limit)) or ('at its maximum' if limit > 0 else 'at its minimum')
            if limit == BY_HEALTH and not self.problem.half_range[i]:
                how = 'which is lost'
            groups.setdefault(how, []).append(self.problem.bound_names[i])
        parts = [
            f'{kind if len(names) == 1 else self.problem.effector_kind} {", ".join(names)} '
            + (how if len(names) == 1 else how.replace('its', 'their').replace(' is ', ' are '))
            for how, names in groups.items()
        ]
        if self.airmode_blocks[axis]:
            parts.append('the limit on airmode')
        words = ' and '.join(parts) or self.others[axis]
        together = (self.blocks[axis] == TOGETHER).any()
        return f'{words}, together' if together else words

    def __str__(self) -> str:
        """Return a sentence for each axis that is not served in full.

        An axis between the reference and its demand is served by a share; of others the error is
        said.
        """
        axes = self.problem.axes
        lost = [axis for axis, share in zip(axes, self.served, strict=True) if share != share]
        parts = [
            f'{axis} {self._share(axes.index(axis))} {words}'
            for axis, words in self.limits.items()
        ]
        rest = 'all other axes are served' if lost else 'all axes are served'
        margin = f'; margin {self.margin:.3g}' if self.margin >= 0.0 else ''
        if len(lost) < len(axes):
            parts = parts or [f'{rest}{margin}']
        return '; '.join([*parts, *(f'{axis} is lost' for axis in lost)])

    def _share(self, axis: int) -> str:
        missed, way = float(self.missed[axis]), (self.demand - self.problem.reference)[axis]
        if missed * way > 0.0 and abs(missed) <= (1.0 + SHARE_ROUNDING) * abs(way):
            return f'{100.0 * self.served[axis]:.0f} % served, limited by'
        size = f'{abs(missed):.3g} {self.problem.axis_units[axis]}'.rstrip()
        above = missed < 0.0
        return f'{size} {"above" if above else "below"} its demand, ' + (
            'forced by' if above else 'limited by')

    def __repr__(self) -> str:
        """Return the same sentences, with the class."""
        return f'{type(self).__name__}: {self}'


def explain(
    problem: AllocationProblem, within: AllocationProblem, demand: Array, thrusts: Array,
    exact: bool = False,
) -> Explanation:
    """Return why thrusts are the answer of a method without priorities.

    What limits an axis is what limits it by the default priorities.

    `within`: the problem with the bounds of this answer.  `exact`: whether the demand is served.
    """
    served = shares(problem, demand, problem.gamma @ thrusts)
    found = Limits.none(np.ones_like(served) if exact else served, problem.n)
    margin, others = within.margin(demand), [BY_METHOD] * len(served)
    if not problem.interior.has_volume:
        margin = float('nan')
    elif margin < 0.0 and (found.served < 1.0).any():
        serve = AdmissibleSet(problem).check_order(None)
        found, misses = serve.limits(demand, served, within, np.zeros(problem.n, bool))
        others = [BY_ORDER if each else BY_METHOD for each in misses]
    return explained(problem, demand, thrusts, found, margin, others)


def explained(
    problem: AllocationProblem, demand: Array, thrusts: Array, found: Limits, margin: float,
    others: Sequence[str],
) -> Explanation:
    """Return the explanation of thrusts from its parts."""
    missed = np.where(found.served < 1.0, demand - problem.gamma @ thrusts, 0.0)
    return Explanation(
        **vars(found), problem=problem, demand=demand, margin=margin, missed=missed, others=others)
