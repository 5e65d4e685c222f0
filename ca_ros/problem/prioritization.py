"""Priorities: which axes to serve first when a wrench is not attainable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import ParameterError, Settings, setting
from ca_ros.solver.dual_newton import AIM, sum_rounding
from ca_ros.solver.simplex import Simplex
from ca_ros.vehicle.settings import AXES, AxesSettings

INSIDE = 0.99
"""Greatest share of the way from the middle of the set to its boundary where a line may begin."""

ORDER = (('roll', 'pitch'), ('thrust',), ('yaw',), ('force_x', 'force_y'))
"""The default order: groups of axes, the most important first."""

DEFAULT_ORDER = tuple(' '.join(group) for group in ORDER)
"""The same in words."""

THRUST_DEVIATIONS = ('prevent', 'avoid', 'allow')
THRUST_DEVIATION = 'prevent'
"""The default."""

REST = 1e-9
"""Distance from the reference, as a share of an axis's range, that counts as none."""

LAG = 1e-3
"""Least weight of an axis in its group, as a share of its range."""

LAG_RATIO = 1e-6
"""Least weight of an axis in its group, relative to the greatest."""

DOUBT = 10.0
"""A demand counts as served within DOUBT times the error estimate of the simplex method."""


@dataclass(frozen=True, kw_only=True)
class PrioritiesSettings(Settings):
    """The priorities of the axes."""

    order: Annotated[Sequence[Sequence[str]], str] = setting(
        DEFAULT_ORDER, 'priorities of prioritize: groups of axes, the most important first',
        mutable=True)
    thrust_deviation: Literal['prevent', 'avoid', 'allow'] = setting(
        THRUST_DEVIATION,
        'how far thrust may deviate from its demand so that no axis after the first group is '
        'reversed. prevent: as far as necessary; avoid: no further than hover; allow: not at all',
        mutable=True)

    def groups(self, axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Return the groups of the axes that are commanded; see `groups_of`.

        Axes that a vehicle cannot have are one more group of the default order, the last.

        Raises
        ------
        ParameterError
            If an axis is missing, repeated or unknown, or a group is empty.
        """
        if self.order == DEFAULT_ORDER:
            return default_order(axes)
        try:
            return groups_of(self.order, axes)
        except ValueError as error:
            raise ParameterError(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class PrioritizedAxesSettings(AxesSettings):
    """The axes of a vehicle and their priorities, which are those of the method exact."""

    exact: PrioritiesSettings


class Served(NamedTuple):
    """What `Prioritization` makes of demands.

    Attributes
    ----------
    wrenches : (..., m) array
        Attainable wrenches [N, N m].
    levels : (..., m) array
        Share of the way from the reference to the demand that each axis went: 0 if it is
        reversed, 1 at the demand and beyond it.
    reached : (...) array of bool
        Whether the demand itself is served, up to rounding errors.
    thrusts : (..., n) array
        Some that produce the wrenches, not those of least norm [N].
    """

    wrenches: Array
    levels: Array
    reached: BoolArray
    thrusts: Array


def groups_of(order: Sequence[Sequence[str]], axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of an order without the axes that are not commanded.

    Parameters
    ----------
    order : sequence of groups of axes
        The most important group first, as words or sequences: ``['roll pitch', 'thrust', 'yaw']``.
        Each of `axes` is named once; a vehicle's other axes may be named.
    axes : sequence of str
        The axes that are commanded.

    Raises
    ------
    ValueError
        If an axis is missing, repeated or unknown, or a group is empty.
    """
    listed = [order] if isinstance(order, str) else order
    groups = [tuple(group.split() if isinstance(group, str) else group) for group in listed]
    flat = [axis for group in groups for axis in group]
    if len(set(flat)) < len(flat) or () in groups or not set(axes) <= set(flat) <= {*AXES, *axes}:
        raise ValueError(
            f'order: expected groups that name each of {", ".join(axes)} once, got {order}'
        )
    kept = (tuple(axis for axis in group if axis in axes) for group in groups)
    return tuple(group for group in kept if group)


def default_order(axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of `ORDER`; axes that a vehicle cannot have are one more group, the last.

    Parameters
    ----------
    axes : sequence of str
        The axes that are commanded.
    """
    others = tuple(axis for axis in axes if axis not in AXES)
    return groups_of((*ORDER, others) if others else ORDER, axes)


def sensed(groups: Sequence[Sequence[str]], thrust_deviation: str) -> list[str]:
    """Return the axes whose sense has priority over the amounts of less important axes.

    Parameters
    ----------
    groups : sequence of sequences of str
        The axes of each group.
    thrust_deviation : 'prevent', 'avoid' or 'allow'
    """
    later = [axis for group in groups[1:] for axis in group]
    return {
        'prevent': [axis for axis in later if axis != 'thrust'],
        'avoid': later,
        'allow': [],
    }[thrust_deviation]


class Prioritization:
    """Serve groups of axes in the order of their priority.

    Three steps serve the axes one after the other, each as far as the steps before it allow:

    1. The first group moves on the straight line from the reference to its demand, as far as
       possible.
    2. Each other axis is brought between its reference and its demand, or as near to that range
       as possible, in the order of the axes.  Thus it is not reversed, not exceeded, and not moved
       without a demand.  `thrust_deviation` chooses the axes of this step.
    3. Each other group comes as near to its demand as possible.

    An axis is lost if it cannot be at its reference while the more important axes are at theirs,
    such as the yaw of a hexarotor without one rotor.  Step 2 omits lost axes.

    Every step is a linear program over the thrusts.  The result is continuous in the demand.  In
    step 3 all axes of a group first get the same share of their demands, as large as possible.
    Then each axis gets what remains possible, in their order.

    Parameters
    ----------
    problem : AllocationProblem
    groups : sequence of sequences of int
        Rows of Gamma, the most important group first.
    reference : (m,) array, optional
        By default that of the problem: hover for a vehicle [N, N m].
    thrust_deviation : 'prevent', 'avoid' or 'allow'
        The axes of step 2.  'prevent': all but thrust, so that thrust deviates from its demand as
        far as the others need.  'avoid': thrust too, so that it deviates no further than to its
        reference.  'allow': none.
    begin : (m,) array, optional
        Attainable wrench where the line of step 1 begins.  By default it is the reference, moved
        towards the middle of the set if that is outside the set or near its boundary.
    """

    def __init__(
        self,
        problem: AllocationProblem,
        groups: Sequence[Sequence[int]],
        reference: Array | None = None,
        thrust_deviation: str = THRUST_DEVIATION,
        begin: Array | None = None,
    ) -> None:
        self._problem = problem
        self._first, *self._later = (list(group) for group in groups)
        self._wrench = problem.reference if reference is None else reference
        self._reference = problem.scaled(self._wrench).tolist()
        named = [[problem.axes[row] for row in group] for group in groups]
        keeps = [problem.axes.index(axis) for axis in sensed(named, thrust_deviation)]
        self._senses: list[int] = []
        # In the simplex the thrusts come before the rows of Gamma.
        self._offset = len(problem.lower)
        self._start, self._begin = problem.simplex.copy(), [0.0]
        if len(self._first) > 1:
            self._begin = (
                self._inside() if begin is None else problem.scaled(begin)[self._first].tolist()
            )
            for row, value in zip(self._first, self._begin, strict=True):
                self._start.push(self._offset + row, value)
                self._start.release(self._offset + row)
        rest = self._serve(self._reference)[0].value[self._offset :]
        self._senses = [row for row in keeps if abs(rest[row] - self._reference[row]) <= REST]

    def _inside(self) -> list[float]:
        """Return where the line of the first group begins, inside its attainable part."""
        line, way = self._problem.simplex.copy(), [self._reference[row] for row in self._first]
        for row in self._first:
            line.release(self._offset + row)
        size = max(map(abs, way)) or 1.0
        length = line.add_ray(
            [self._offset + row for row in self._first], [component / size for component in way]
        )
        line.push(length, size / INSIDE)
        return [min(1.0, INSIDE * line.value[length] / size) * component for component in way]

    def __call__(self, u: Array) -> Served:
        """Return the served wrenches for demands (..., m) [N, N m]."""
        problem, n = self._problem, self._offset
        demands = u.reshape(-1, u.shape[-1])
        ends = [self._serve(goals) for goals in problem.scaled(demands).tolist()]
        reaches = np.array([end.value[: n + demands.shape[1]] for end, _ in ends])
        reaches = reaches.reshape(len(demands), n + demands.shape[1])
        thrusts = problem.clip(problem.middle + problem.half_range * reaches[:, :n])
        served = thrusts @ problem.gamma.T
        # Pivots of almost symmetric vehicles are small and cost digits.
        goals = problem.center + problem.extent * reaches[:, n:]
        for i in np.flatnonzero(~problem.is_exact(goals, thrusts, AIM)):
            tolerance = float(problem.tolerance(goals[i]))
            thrusts[i] = problem.least_norm.settle(thrusts[i], goals[i], tolerance)
            served[i] = problem.gamma @ thrusts[i]
        ways = demands - self._wrench
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            levels = np.clip(np.where(ways != 0.0, (served - self._wrench) / ways, 0.0), 0.0, 1.0)
        if len(self._first) > 1 and self._begin == [self._reference[row] for row in self._first]:
            levels[:, self._first] = np.array([share for _, share in ends])[:, None]
        doubts = np.array([end.doubt for end, _ in ends]).reshape(-1, 1)
        rounding = sum_rounding(problem.gamma, thrusts)[:, None]
        near = np.abs(served - demands) <= np.maximum(DOUBT * doubts * problem.extent, rounding)
        levels[near] = 1.0
        reached = np.asarray(near.all(axis=-1)).reshape(u.shape[:-1])
        thrusts = thrusts.reshape(*u.shape[:-1], n)
        return Served(served.reshape(u.shape), levels.reshape(u.shape), reached, thrusts)

    def _serve(self, goals: list[float]) -> tuple[Simplex, float]:
        """Serve a demand (m,) in the units of the simplex.

        Return the simplex, with the thrusts before the wrench, and the share of its line that the
        first group went.
        """
        simplex, offset, length, share = self._start.copy(), self._offset, -1, 1.0
        if len(self._first) == 1:
            simplex.push(offset + self._first[0], goals[self._first[0]])
        else:
            ways = [goals[row] - at for row, at in zip(self._first, self._begin, strict=True)]
            size = max(map(abs, ways)) or 1.0
            length = simplex.add_ray(
                [offset + row for row in self._first], [way / size for way in ways]
            )
            simplex.push(length, size)
        for row in self._senses:
            v, value = offset + row, simplex.value[offset + row]
            low, high = sorted((goals[row], self._reference[row]))
            if low <= value <= high or simplex.push(v, low if value < low else high):
                simplex.lower[v], simplex.upper[v] = low, high
        for group in self._later:
            if len(group) > 1:
                distances = [abs(goals[row] - self._reference[row]) for row in group]
                longest = max(*distances, LAG)
                lag = simplex.add_lag(
                    [offset + row for row in group],
                    [goals[row] for row in group],
                    [max(max(each, LAG) / longest, LAG_RATIO) for each in distances],
                )
                simplex.push(lag, 0.0)
            for row in group:
                simplex.push(offset + row, goals[row])
        if length >= 0:
            share = simplex.value[length] / size
            for row, at, way in zip(self._first, self._begin, ways, strict=True):
                simplex.value[offset + row] = goals[row] if share == 1.0 else at + share * way
        return simplex, share
