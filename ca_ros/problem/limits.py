"""What keeps axes from their demands: the bounds without which they would come nearer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.problem import AllocationProblem

BY_BOUND, BY_RATE, BY_HEALTH = 1, 2, 3  # what limits an effector: enum ca_limit of the kernel
BY_TILT, BY_TILT_RATE = 4, 5  # the same of the angle of a vector
ALONE, TOGETHER = 1, 2  # how a bound limits an axis: enum ca_blocking of the kernel

REACH_MIN = 1e-3  # least reach of an effector, as a share of half of its range
AT_BOUND = 1e-9  # distance from a bound that counts as none, as a share of half of the range


@dataclass(frozen=True, eq=False)
class Limits:
    """What limits the axes, as in `ca_explanation` of the kernel.

    A gain is by how much an axis comes nearer to its demand per unit by which a bound moves out,
    if the demand is served again; 0 if it depends on how far the bound moves.

    - `served` (m,): share of the way from the reference (hover) to its demand that each axis gets:
      1 less the size of its error over that of the way, at least 0.  So it is 1 only at the
      demand, 0 for an axis that misses a demand at the reference, and an axis beyond its demand is
      as far from it as one that stays behind
    - `blocks` (m, n): `ALONE` if the axis comes nearer to its demand when the bound of an effector
      alone moves out, `TOGETHER` if only all bounds with this entry together bring it nearer, and
      0 for no limit, even at a bound
    - `gain` (m, n): gains of the effectors that limit alone [N, N m per N]
    - `joint_gain` (m,): gain of the bounds that limit only together, if all move by the same
    - `airmode_blocks` (m,): as `blocks`, of the limit on airmode
    - `airmode` (m,): its gain, if it limits alone
    - `limit` (n,): `BY_BOUND`, `BY_RATE` or `BY_HEALTH`, negative at the lower bound; 0 for no
      limit

    If effectors are vectors, the bounds of the length have the first component of a vector.  The
    second has that of the tilt, with `BY_TILT` or `BY_TILT_RATE`; it moves by the angle that moves
    the end of the longest vector by 1 N.
    """

    served: Array
    blocks: NDArray[np.int32]
    gain: Array
    joint_gain: Array
    airmode_blocks: NDArray[np.int32]
    airmode: Array
    limit: NDArray[np.int32]

    @classmethod
    def of(cls, numbers: Array, names: NDArray[np.int32]) -> Limits:
        """Return what `Kernel.explain` wrote: numbers (m, 3 + n) and names (m + 1, 1 + n)."""
        served, joint, airmode = numbers[:, :3].T
        blocks, own, limit = names[:-1, 1:], names[:-1, 0], names[-1, 1:]
        return cls(served, blocks, numbers[:, 3:], joint, own, airmode, limit)

    @classmethod
    def none(cls, served: Array, n: int) -> Limits:
        """Return shares (m,) of which n effectors limit none."""
        m = len(served)
        numbers, names = np.zeros((m, 3 + n)), np.zeros((m + 1, 1 + n), np.int32)
        numbers[:, 0] = served
        return cls.of(numbers, names)


def shares(
    problem: AllocationProblem, u: Array, wrench: Array, rounding: float | None = None
) -> Array:
    """Return the shares (m,) of a demand u that a wrench serves, up to rounding.

    `rounding`: miss that counts as none, as a share of half of the range; by default that of the
    programs of the problem.
    """
    rounding = problem.program.served_rounding if rounding is None else rounding
    missed, way = np.abs(u - wrench), np.abs(u - problem.reference)
    share = 1.0 - np.divide(missed, way, out=np.ones_like(way), where=missed < way)
    return np.where(missed <= rounding * problem.extent, 1.0, share)


class Steps(NamedTuple):
    """How bounds are moved to find what limits.

    - `near`, `far`: how far they move out, as shares of their reach
    - `least`: least gain that counts, in units of the ranges
    - `same`: greatest relative difference of gains that are the same
    """

    near: float
    far: float
    least: float
    same: float


STEPS = Steps(near=1e-5, far=1e-3, least=1e-4, same=2e-3)
"""For bounds of numbers, where gains are piecewise constant."""


class Bound(NamedTuple):
    """A bound that may limit an answer.

    - `effector`: its number; -1 for the limit on airmode
    - `side`: 1 for an upper bound, -1 for a lower one, 0 for the limit on airmode
    - `reach`: what it moves by is a small share of this
    - `limit`: as in `Limits`
    """

    effector: int
    side: int
    reach: float
    limit: int = 0


def find_limits(
    u: Array, served: Array, misses: BoolArray, extent: Array, unit: float,
    bounds: Sequence[Bound], n: int, serve: Callable[[Sequence[Bound], float], Array],
    steps: Steps = STEPS,
) -> Limits:
    """Return what limits the axes of a demand u (m,) that miss it, for n effectors.

    Bounds are moved out and the demand is served again.  Multipliers would take one solution
    alone, but they are not unique where more effectors are at their bounds than decide, and do
    not say that a more important axis takes what a bound gives.  ``explanation.c`` does the same.

    - `served`, `misses`, `extent` (m,): the shares, which axes miss their demand, and half of the
      ranges of the axes
    - `unit`: half of the greatest range of an effector
    - `serve`: returns the wrench (m,) with some bounds moved out by a distance
    """
    found = Limits.none(served, n)
    missed = np.abs(u - serve([], 0.0))

    def gains(chosen: Sequence[Bound], share: float) -> Array:
        distance = share * min(bound.reach for bound in chosen)
        return np.asarray((missed - np.abs(u - serve(chosen, distance))) / distance)

    def counts(gain: Array) -> BoolArray:
        return np.asarray(gain * unit > steps.least * extent)

    def stated(near: float, far: float) -> float:
        # A gain that depends on the distance is not.
        return near if abs(near - far) <= steps.same * near else 0.0

    near = np.array([gains([bound], steps.near) for bound in bounds])
    far = np.array([gains([bound], steps.far) for bound in bounds])
    for k in np.flatnonzero(misses).tolist() if bounds else []:
        alone = [counts(near[b])[k] and counts(far[b])[k] for b in range(len(bounds))]
        for b in np.flatnonzero(alone).tolist():
            gain, effector = stated(near[b, k], far[b, k]), bounds[b].effector
            _name(found, k, bounds[b], ALONE)
            if effector < 0:
                found.airmode[k] = gain
            else:
                found.gain[k, effector] = gain
        if any(alone):
            continue
        # What takes from the axis is not to move with the others.
        chosen = [bound for b, bound in enumerate(bounds) if not counts(-near[b])[k]]
        together = gains(chosen, steps.near) if chosen else np.zeros(len(u))
        if not counts(together)[k]:
            continue
        for bound in list(chosen):
            rest = [each for each in chosen if each != bound]
            without = gains(rest, steps.near) if rest else np.zeros(len(u))
            if without[k] >= (1.0 - steps.same) * together[k]:
                chosen, together = rest, without
        beyond = gains(chosen, steps.far)
        if counts(beyond)[k]:
            found.joint_gain[k] = stated(together[k], beyond[k])
            for bound in chosen:
                _name(found, k, bound, TOGETHER)
    return found


def limits_within(
    problem: AllocationProblem, within: AllocationProblem, u: Array, served: Array,
    serve: Callable[..., tuple[Array, Array]], airmode: bool,
) -> tuple[Limits, BoolArray]:
    """Return what limits the axes, and which (m,) the priorities do not serve in full.

    - `within`: the problem with the bounds of this answer
    - `served` (m,): the shares that an answer serves
    - `serve`: see `Prioritization.moved`
    - `airmode`: whether there is a limit on it
    """
    wrench, thrusts = serve(u, within, *np.zeros((2, problem.n)))
    misses = (served < 1.0) & (shares(problem, u, wrench) < 1.0)
    bounds = bounds_of(problem, within, thrusts)
    if airmode:
        bounds.append(Bound(-1, 0, float(problem.extent[problem.axes.index('thrust')])))

    def served_beyond(chosen: Sequence[Bound], distance: float) -> Array:
        # Down, up, and beyond the limit on airmode.
        ways = np.zeros((3, problem.n))
        for bound in chosen:
            ways[{-1: 0, 1: 1, 0: 2}[bound.side], bound.effector] = distance
        return serve(u, within, ways[0], ways[1], float(ways[2].max()))[0]

    unit = float(problem.half_range.max())
    found = find_limits(u, served, misses, problem.extent, unit, bounds, problem.n, served_beyond)
    return found, misses


def _name(found: Limits, axis: int, bound: Bound, how: int) -> None:
    if bound.effector < 0:
        found.airmode_blocks[axis] = how
    else:
        found.blocks[axis, bound.effector] = how
        found.limit[bound.effector] = bound.limit


def bounds_of(
    problem: AllocationProblem, within: AllocationProblem, thrusts: Array
) -> list[Bound]:
    """Return the bounds of a problem that thrusts (n,) are at.

    `within`: the problem with the bounds of this answer.
    """
    half, longest = problem.half_range, float(problem.half_range.max())
    found = list[Bound]()
    for i, f in enumerate(thrusts.tolist()):
        ranged = bool(half[i] > 0.0)
        rounding = AT_BOUND * (float(half[i]) if ranged else longest)
        low, high = float(within.lower[i]), float(within.upper[i])
        reach = max((high - low) / 2.0, REACH_MIN * float(half[i])) if ranged else longest
        if f >= high - rounding:
            by_health = bool(problem.impaired[i]) or not ranged
            limit = BY_HEALTH if by_health else BY_BOUND
            found.append(Bound(i, 1, reach, BY_RATE if high < problem.upper[i] else limit))
        # An effector that is lost cannot give less.
        if f <= low + rounding and ranged:
            found.append(Bound(i, -1, reach, -BY_RATE if low > problem.lower[i] else -BY_BOUND))
    return found
