"""Why an answer is what it is: what was served of each axis, and what limits the rest."""

from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.limits import BY_HEALTH, BY_RATE, Limits, limits_of, shares
from ca_ros.problem.prioritization import Prioritization
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import TiltingVehicleProblem

SERVED = 1e-9  # residual, as a share of the range of an axis, that counts as none


@dataclass(frozen=True, eq=False)
class Explanation(Limits):
    """Why thrusts produce another wrench than the demand: its `Limits`, and the margin.

    `margin`: signed distance of the demand to the boundary of the attainable set of this answer,
    positive inside [N, N m].
    """

    problem: AllocationProblem
    margin: float

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
        for i in np.flatnonzero(self.gain[axis]):
            limit = int(self.limit[i])
            end = 'maximum' if limit > 0 else 'minimum'
            how = {BY_RATE: 'at its rate', BY_HEALTH: 'by its health'}.get(abs(limit))
            if limit == BY_HEALTH and not self.problem.half_range[i]:
                how = 'which is lost'
            groups.setdefault(how or f'at its {end}', []).append(self.problem.effector_names[i])
        parts = [
            f'{kind if len(names) == 1 else self.problem.effector_kind} {", ".join(names)} '
            + (how if len(names) == 1 else how.replace('its', 'their').replace(' is ', ' are '))
            for how, names in groups.items()
        ]
        if self.airmode[axis]:
            parts.append('the limit on airmode')
        if isinstance(self.problem, TiltingVehicleProblem):
            parts += self.problem.rate_limited or ['thrusts and tilts'] * (self.margin < 0.0)
        return ' and '.join(parts) or 'the method'

    def __str__(self) -> str:
        """Return a sentence an axis that is not served in full."""
        if not (limits := self.limits):
            return f'all axes are served; margin {self.margin:.3g}'
        shares = dict(zip(self.problem.axes, self.served, strict=True))
        return '; '.join(
            f'{axis} {100.0 * shares[axis]:.0f} % served, limited by {words}'
            for axis, words in limits.items()
        )


def explain(
    problem: AllocationProblem, within: AllocationProblem, demand: Array, thrusts: Array,
    serve: Prioritization | None = None,
) -> Explanation:
    """Return why thrusts are the answer of a method.

    `within`: the problem with the bounds of this answer.  `serve`: the priorities that limit the
    answer; by default the default ones, which say what keeps the demand from being served.
    """
    served = shares(problem, demand, problem.gamma @ thrusts, SERVED)
    m, n = problem.gamma.shape
    found = Limits(served, np.zeros((m, n)), np.zeros(m), np.zeros(n, dtype=np.int32))
    margin = float(within.attainable_set.margin(demand)) if within.has_volume else -np.inf
    if not problem.has_volume:
        margin = float('nan')
    elif serve is None and margin < 0.0 and (served < 1.0).any():
        default = AdmissibleSet(problem).check_order(None)
        serve = default if isinstance(default, Prioritization) else None
    if serve is not None:
        prices = serve.prices(demand, None if within is problem else within)
        for k in np.flatnonzero(served < 1.0):
            way = np.sign((demand - problem.gamma @ thrusts)[k])
            gains = way * problem.gamma[k]
            room = gains @ (np.where(gains > 0.0, within.upper, within.lower) - thrusts)
            if room <= SERVED * max(problem.extent[k], 1.0):
                # The multipliers are not unique if too many rotors are at bounds.
                prices[k] = way * (np.arange(prices.shape[1]) == k)
        found = limits_of(problem, within, served, prices)
    return Explanation(**vars(found), problem=problem, margin=margin)
