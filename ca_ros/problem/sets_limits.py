"""What limits the axes where effectors are vectors in convex sets."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.limits import (
    ALONE,
    BY_BOUND,
    BY_HEALTH,
    BY_RATE,
    BY_TILT,
    BY_TILT_RATE,
    TOGETHER,
    Bound,
    Limits,
    Steps,
    find_limits,
    shares,
)
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.convex_sets import ConvexSet, ConvexSets, Interval, Sector

AT_BOUND = 1e-5  # distance from a bound that counts as none, as a share of the greatest length
ARC_MIN = 0.05  # least angle of which a tilt moves by a share [rad]

STEPS = Steps(near=1e-3, far=4e-3, least=5e-3, same=1e-2)
"""Steps of the priorities may move the axes before them by 1e-7 of their range."""


def limits_of_vectors(
    problem: AllocationProblem, demand: Array, thrusts: Array, served: Array,
    serve: Callable[[ConvexSets], Array], by_rate: BoolArray,
) -> tuple[Limits, BoolArray]:
    """Return what limits the axes, and which (m,) the priorities do not serve in full.

    - `thrusts` (n,): vectors that give what the priorities serve
    - `served` (m,): the shares that an answer serves
    - `serve`: returns the wrench (m,) that the priorities serve with other sets
    - `by_rate` (n,): whether rates limit the length, or the tilt, of the components' vectors
    """
    sets = problem.sets
    wrench = serve(sets)
    misses = (served < 1.0) & (shares(problem, demand, wrench) < 1.0)

    def served_beyond(chosen: Sequence[Bound], distance: float) -> Array:
        if not chosen:
            return wrench
        moved = list(sets.sets)
        for bound in chosen:
            i = int(np.searchsorted(sets.first, bound.effector, 'right')) - 1
            moved[i] = _moved(moved[i], bound, bound.effector > sets.first[i], distance)
        return serve(ConvexSets(moved))

    unit = float(sets.length_limits[1].max())
    found = find_limits(
        demand, served, misses, problem.extent, unit, bounds_of_vectors(problem, thrusts, by_rate),
        problem.n, served_beyond, STEPS)
    for k in np.flatnonzero(misses & ~found.blocks.any(axis=1)).tolist():
        for i, how in _held_in_direction(problem, demand, thrusts, k, serve).items():
            tilt = sets.first[i] + 1
            found.blocks[k, tilt] = how
            found.limit[tilt] = BY_TILT_RATE if by_rate[tilt] else BY_TILT
    return found, misses


def _held_in_direction(
    problem: AllocationProblem, demand: Array, thrusts: Array, axis: int,
    serve: Callable[[ConvexSets], Array],
) -> dict[int, int]:
    """Return the sets of length zero that bring an axis nearer if they have any direction.

    They do alone or together; a small change of their angles does not help.
    """
    sets, lengths = problem.sets, problem.sets.lengths(thrusts)
    slack = AT_BOUND * float(sets.length_limits[1].max())
    chosen = [
        i for i, each in enumerate(sets.sets)
        if isinstance(each, Sector) and each.half_angle < pi and lengths[i] <= slack
    ]

    def missed(free: Sequence[int]) -> float:
        moved = list(sets.sets)
        for i in free:
            each = moved[i]
            assert isinstance(each, Sector)
            moved[i] = replace(each, half_angle=pi, least=0.0)
        return float(np.abs(demand - serve(ConvexSets(moved)))[axis])

    whole, least = missed([]), STEPS.least * problem.extent[axis]
    if alone := [i for i in chosen if whole - missed([i]) > least]:
        return dict.fromkeys(alone, ALONE)
    best = missed(chosen)
    if whole - best <= least:
        return {}
    for i in list(chosen):
        rest = [each for each in chosen if each != i]
        if missed(rest) <= best + STEPS.same * (whole - best):
            chosen = rest
    return dict.fromkeys(chosen, TOGETHER)


def bounds_of_vectors(
    problem: AllocationProblem, thrusts: Array, by_rate: BoolArray
) -> list[Bound]:
    """Return the bounds of the sets that vectors (n,) are at.

    Those of the length have the first component of a set, that of the tilt the second.  The tilt
    moves by an angle that moves the end of the longest vector by the distance.
    """
    found, longest = list[Bound](), float(problem.sets.length_limits[1].max())
    slack = AT_BOUND * longest
    for each, k in zip(problem.sets.sets, problem.sets.first, strict=True):
        vector = thrusts[k : k + each.size]
        limited, tilt_limited = by_rate[[k, k + (each.size > 1)]].tolist()
        if isinstance(each, Interval):
            half = (each.upper - each.lower) / 2.0
            above = BY_HEALTH if each.lower == each.upper and not limited else BY_BOUND
            if vector[0] >= each.upper - slack:
                found.append(Bound(k, 1, half or longest, BY_RATE if limited else above))
            if vector[0] <= each.lower + slack and half:
                found.append(Bound(k, -1, half, -BY_RATE if limited else -BY_BOUND))
            continue
        length, across = float(np.linalg.norm(vector)), float(np.linalg.norm(vector[1:]))
        if length >= each.radius - slack:
            found.append(Bound(k, 1, each.radius / 2.0, BY_RATE if limited else BY_BOUND))
        if each.least and vector[0] <= each.least + slack:
            found.append(Bound(k, -1, each.radius / 2.0, -BY_RATE if limited else -BY_BOUND))
        side = np.arctan2(across, float(vector[0])) if length > slack else pi
        arc = max(each.half_angle, ARC_MIN)
        if side >= each.half_angle - AT_BOUND and each.half_angle + STEPS.far * arc <= pi / 2:
            limit = BY_TILT_RATE if tilt_limited else BY_TILT
            found.append(Bound(k + 1, 1, each.radius * arc, limit))
    return found


def _moved(each: ConvexSet, bound: Bound, tilts: bool, distance: float) -> ConvexSet:
    """Return a set with one of its bounds moved out."""
    if isinstance(each, Interval):
        end = {'upper': each.upper + distance} if bound.side > 0 else {
            'lower': each.lower - distance}
        return replace(each, **end)
    assert isinstance(each, Sector)
    if tilts:
        return replace(each, half_angle=each.half_angle + distance / each.radius)
    if bound.side > 0:
        return replace(each, radius=each.radius + distance)
    return replace(each, least=max(0.0, each.least - distance))
