"""Why an axis gets less than its demand: the rotors and limits that the multipliers name."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.simplex import ZERO

BY_BOUND, BY_RATE, BY_HEALTH = 1, 2, 3  # what limits an effector: enum ca_limit of the kernel


@dataclass(frozen=True, eq=False)
class Limits:
    """What limits the axes, as in `ca_explanation` of the kernel.

    - `served` (m,): share of its demand that each axis gets, counted from the reference
      (hover): 1 is all
    - `gain` (m, n): multipliers: by how much an axis would come nearer to its demand per unit by
      which the bound of an effector moved out; zero if the effector does not limit the axis, even
      at a bound
    - `airmode` (m,): the same per N of the limit on airmode; zero if it does not limit the axis
    - `limit` (n,): `BY_BOUND`, `BY_RATE` or `BY_HEALTH`, negative at the lower bound; 0 for no
      limit
    """

    served: Array
    gain: Array
    airmode: Array
    limit: NDArray[np.int32]


def shares(problem: AllocationProblem, u: Array, wrench: Array, rounding: float) -> Array:
    """Return the shares (m,) of a demand u that a wrench serves, up to rounding."""
    missed, way = u - wrench, u - problem.reference
    share = np.clip(1.0 - np.divide(missed, way, out=np.ones_like(way), where=way != 0.0), 0, 1)
    return np.where(np.abs(missed) <= rounding * np.maximum(problem.extent, 1.0), 1.0, share)


def limits_of(
    problem: AllocationProblem, within: AllocationProblem, served: Array, prices: Array
) -> Limits:
    """Return what limits the axes that are not served in full.

    `within` is the problem with the bounds of this answer; `served` (m,) are the shares, and
    `prices` (m, m + 1) those of `Prioritization.prices`.
    """
    ranged = problem.half_range > 0.0
    ranges = np.where(ranged, problem.half_range, problem.half_range.max())
    prices = np.where(served[:, None] < 1.0, prices, 0.0)
    slopes = prices[:, :-1] / problem.extent @ problem.gamma
    slopes[(np.abs(slopes) * ranges <= ZERO) | ((slopes < 0.0) & ~ranged)] = 0.0
    limit: NDArray[np.int32] = np.zeros(problem.n, dtype=np.int32)
    above = np.where(problem.impaired.astype(bool) | ~ranged, BY_HEALTH, BY_BOUND)
    above = np.where(within.upper < problem.upper, BY_RATE, above)
    below = np.where(within.lower > problem.lower, -BY_RATE, -BY_BOUND)
    for row in slopes:
        limit = np.where(row > 0.0, above, np.where(row < 0.0, below, limit)).astype(np.int32)
    airmode = np.zeros(len(served))
    if 'thrust' in problem.axes:
        range_ = problem.extent[problem.axes.index('thrust')]
        firm = np.where(np.abs(prices[:, -1]) > ZERO, prices[:, -1], 0.0)
        airmode = firm * problem.extent / range_
    return Limits(served, np.abs(slopes) * problem.extent[:, None], airmode, limit)
