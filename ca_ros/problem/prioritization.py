"""Priorities: which axes to serve first when a wrench is not attainable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import inf
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.interior import INSIDE
from ca_ros.problem.limits import Limits, limits_within
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import Numbers, ParameterError, Settings, setting
from ca_ros.solver.least_norm_qp import AIM, sum_rounding
from ca_ros.solver.lexicographic_lp import ZERO, Simplex
from ca_ros.vehicle.settings import AXES, AxesSettings

ORDER = (('roll', 'pitch'), ('thrust',), ('yaw',), ('force_x', 'force_y'))
"""The default order: groups of axes, the most important first."""

DEFAULT_ORDER = tuple(' '.join(group) for group in ORDER)  # the same in words

AXIS_REVERSALS = ('prevent', 'allow')
AXIS_REVERSAL = 'prevent'  # the default
AIRMODE = (1.0, 1.0)  # without limits on airmode: thrust may rise by its whole range
REST = 1e-9  # distance from the reference, as a share of an axis's range, that counts as none
LAG = 1e-3  # least weight of an axis in its group, as a share of its range
LAG_RATIO = 1e-6  # least weight of an axis in its group, relative to the greatest

ERROR_FACTOR = 10.0  # error estimates of the simplex method within which a demand is served


@dataclass(frozen=True, kw_only=True)
class PrioritiesSettings(Settings):
    """The priorities of the axes."""

    order: Annotated[Sequence[Sequence[str]], str] = setting(
        DEFAULT_ORDER, 'priorities of prioritize: groups of axes, the most important first',
        mutable=True)
    axis_reversal: Literal['prevent', 'allow'] = setting(
        AXIS_REVERSAL,
        'whether an axis after the first group may get the opposite of its demand. prevent: '
        'thrust deviates from its demand as far as prevents it; allow: thrust does not deviate',
        mutable=True)
    airmode_limit: Numbers = setting(
        1.0,
        'how far thrust may rise above its demand for roll and pitch, and for yaw, as shares of '
        'its range: one number for both, or two. 0: no airmode; 1: no limit', minimum=0.0,
        maximum=1.0, sizes=[1, 2],
        mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        airmode_limits(self.airmode_limit)

    def groups(self, axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Return the groups of the axes that are commanded; see `groups_of`.

        Axes that a vehicle cannot have are one more group of the default order, the last.  Raises
        a ParameterError if an axis is missing, repeated or unknown, or a group is empty.
        """
        if self.order == DEFAULT_ORDER:
            return default_order(tuple(axes))
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

    - `wrenches` (..., m): attainable wrenches [N, N m]
    - `levels` (..., m): share of the way from the reference to the demand that each axis went: 0
      if it is reversed, 1 at the demand and beyond it
    - `reached` (...): whether the demand itself is served, up to rounding errors
    - `thrusts` (..., n): some that produce the wrenches, not those of least norm [N]
    - `held` (..., n): which thrusts are at a bound in all solutions, and limit what is served
    """

    wrenches: Array
    levels: Array
    reached: BoolArray
    thrusts: Array
    held: BoolArray = np.zeros(0, dtype=bool)


def groups_of(order: Sequence[Sequence[str]], axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of an order without the axes that are not commanded.

    Raises a ValueError if an axis is missing, repeated or unknown, or a group is empty.

    `order`: the most important group first, as words or sequences: ``['roll pitch', 'thrust',
    'yaw']``. Each of `axes` is named once; a vehicle's other axes may be named.  `axes`: the axes
    that are commanded.
    """
    listed = [order] if isinstance(order, str) else order
    groups = [tuple(group.split() if isinstance(group, str) else group) for group in listed]
    flat = [axis for group in groups for axis in group]
    if len(set(flat)) < len(flat) or () in groups or not set(axes) <= set(flat) <= {*AXES, *axes}:
        known = ', '.join(axes)
        raise ValueError(f'order: expected groups that name each of {known} once, got {order}')
    kept = (tuple(axis for axis in group if axis in axes) for group in groups)
    return tuple(group for group in kept if group)


@cache
def default_order(axes: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of `ORDER`; axes that a vehicle cannot have are one more group, the last.

    `axes`: the axes that are commanded.
    """
    others = tuple(axis for axis in axes if axis not in AXES)
    return groups_of((*ORDER, others) if others else ORDER, axes)


def airmode_limits(given: Numbers) -> tuple[float, float]:
    """Return the limits of `airmode_limit`, for the first group and for the others.

    Raises a ParameterError if there are more than two, or thrust may rise further for the others.
    """
    if isinstance(given, float):
        return given, given
    numbers = [float(number) for number in np.ravel(given)]
    if len(numbers) not in (1, 2) or numbers[-1] > numbers[0]:
        raise ParameterError(
            'airmode_limit: expected one limit, or that of roll and pitch and one up to it for '
            f'yaw, got {numbers}'
        )
    return numbers[0], numbers[-1]


def sensed(groups: Sequence[Sequence[str]], axis_reversal: str) -> list[str]:
    """Return the axes whose sense has priority over the amounts of less important axes.

    `groups`: the axes of each group.  `axis_reversal` ('prevent' or 'allow').
    """
    if axis_reversal == 'allow':
        return []
    return [axis for group in groups[1:] for axis in group if axis != 'thrust']


class Prioritization:
    """Serve groups of axes in the order of their priority.

    Three steps serve the axes one after the other, each as far as the steps before it allow:

    1. The first group moves on the straight line from the reference to its demand, as far as
       possible.
    2. Each other axis is brought between its reference and its demand, or as near to that range
       as possible, in the order of the axes.  Thus it is not reversed, not exceeded, and not moved
       without a demand.  `axis_reversal` chooses the axes of this step.
    3. Each other group comes as near to its demand as possible.

    An axis is lost if it cannot be at its reference while the more important axes are at theirs,
    such as the yaw of a hexarotor without one rotor.  Step 2 omits lost axes.

    Every step is a linear program over the thrusts.  The result is continuous in the demand.  In
    step 3 all axes of a group first get the same share of their demands, as large as possible.
    Then each axis gets what remains possible, in their order.

    - `groups`: rows of Gamma, the most important group first
    - `reference` (m,): by default that of the problem: hover for a vehicle [N, N m]
    - `axis_reversal` ('prevent' or 'allow'): the axes of step 2.  'prevent': all but thrust, so
      that thrust deviates from its demand as far as the others need.  'allow': none
    - `begin` (m,): attainable wrench where the line of step 1 begins.  By default it is the
      reference, moved towards the middle of the set if that is outside the set or near its
      boundary
    - `airmode_limit`: see `airmode_limits`.  In step 1, thrust rises no further than the first
      limit above its demand, or above what the first group needs where its line begins.  In steps
      2 and 3 it rises no further than the other above its demand, or above what the first group
      needs now
    """

    def __init__(
        self, problem: AllocationProblem, groups: Sequence[Sequence[int]],
        reference: Array | None = None, axis_reversal: str = AXIS_REVERSAL,
        begin: Array | None = None, airmode_limit: Sequence[float] = AIRMODE,
    ) -> None:
        problem.check_volume()
        self.problem = problem
        self._first, *self._later = (list(group) for group in groups)
        self._wrench = problem.reference if reference is None else reference
        self._reference = problem.scaled(self._wrench).tolist()
        named = [[problem.axes[row] for row in group] for group in groups]
        keeps = [problem.axes.index(axis) for axis in sensed(named, axis_reversal)]
        self._senses: list[int] = []
        self._airmode: list[float] | None = None
        # In the simplex the thrusts come before the rows of Gamma.
        self._offset = len(problem.lower)
        self._start, self._begin = problem.box.simplex.copy(), [0.0]
        if len(self._first) > 1:
            self._begin = (
                self._inside() if begin is None else problem.scaled(begin)[self._first].tolist()
            )
            self._start.hold([self._offset + row for row in self._first], self._begin)
        rest = self._serve(self._reference).simplex.value[self._offset :]
        self._senses = [row for row in keeps if abs(rest[row] - self._reference[row]) <= REST]
        # In the first group thrust does not give way to others.
        rows = [row for row, axis in enumerate(problem.axes) if axis == 'thrust']
        if min(airmode_limit) < 1.0 and rows and rows[0] not in self._first:
            self._thrust = rows[0]
            self._airmode = [inf if limit >= 1.0 else 2.0 * limit for limit in airmode_limit]

    def _inside(self) -> list[float]:
        """Return where the line of the first group begins, inside its attainable part."""
        line, way = self.problem.box.simplex.copy(), [self._reference[row] for row in self._first]
        for row in self._first:
            line.release(self._offset + row)
        size = max(map(abs, way)) or 1.0
        length = line.add_ray(
            [self._offset + row for row in self._first], [component / size for component in way]
        )
        line.push(length, size / INSIDE)
        return [min(1.0, INSIDE * line.value[length] / size) * component for component in way]

    def __call__(self, u: Array, within: AllocationProblem | None = None) -> Served:
        """Return the served wrenches for demands (..., m) [N, N m].

        `within` is the same problem with narrower bounds, which then hold.  If they keep the first
        group away from its line, it gets as near to the line as possible, and then goes along it.
        """
        scaled, n = self.problem.scaled(u), self._offset
        problem = self.problem if within is None else within
        demands = u.reshape(-1, u.shape[-1])
        runs = [
            self._serve(
                goals, None if within is None else self._between(within.lower, within.upper))
            for goals in scaled.reshape(demands.shape).tolist()
        ]
        ends = [run.simplex for run in runs]
        reaches = np.array([end.value[: n + demands.shape[1]] for end in ends])
        reaches = reaches.reshape(len(demands), n + demands.shape[1])
        static = self.problem
        thrusts = problem.clip(static.middle + static.half_range * reaches[:, :n])
        served = thrusts @ problem.gamma.T
        # Pivots of almost symmetric vehicles are small and cost digits.
        goals = static.center + static.extent * reaches[:, n:]
        for i in np.flatnonzero(~problem.is_exact(goals, thrusts, AIM)):
            tolerance = float(problem.tolerance(goals[i]))
            thrusts[i] = problem.box.least_norm.settle(thrusts[i], goals[i], tolerance)
            served[i] = problem.gamma @ thrusts[i]
        ways = demands - self._wrench
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            levels = np.clip(np.where(ways != 0.0, (served - self._wrench) / ways, 0.0), 0.0, 1.0)
        if len(self._first) > 1 and self._begin == [self._reference[row] for row in self._first]:
            shares = np.array([run.share for run in runs])[:, None]
            levels[:, self._first] = np.where(shares < 0.0, levels[:, self._first], shares)
        doubts = np.array([end.doubt for end in ends]).reshape(-1, 1)
        rounding = sum_rounding(problem.gamma, thrusts)[:, None]
        errors = ERROR_FACTOR * doubts * static.extent
        met = np.abs(served - demands) <= np.maximum(errors, rounding)
        levels[met] = 1.0
        reached = np.asarray(met.all(axis=-1)).reshape(u.shape[:-1])
        thrusts = thrusts.reshape(*u.shape[:-1], n)
        held = np.array([[i in run.held for i in range(n)] for run in runs], dtype=bool)
        held = held.reshape(thrusts.shape)
        return Served(served.reshape(u.shape), levels.reshape(u.shape), reached, thrusts, held)

    def moved(
        self, u: Array, within: AllocationProblem, lowered: Array, raised: Array, rise: float = 0.0
    ) -> tuple[Array, Array]:
        """Return the wrench (m,) that is served for u with bounds moved out, and thrusts (n,).

        Nothing else moves: the line of step 1, the weights in a group and the range of thrust are
        the same.

        - `within`: the problem with the bounds that are moved
        - `lowered`, `raised` (n,): by how much the bounds are moved [N]
        - `rise`: by how much the limits on airmode are moved [N]
        """
        problem, n, limits = self.problem, self._offset, self._airmode
        if limits is not None:
            limits = [limit + rise / problem.extent[self._thrust] for limit in limits]
        simplex = self._between(within.lower - lowered, within.upper + raised)
        narrowed = (within.lower > problem.lower) | (within.upper < problem.upper)
        run = self._serve(problem.scaled(u).tolist(), simplex, limits, not narrowed.any())
        value = np.array(run.simplex.value[: n + len(u)])
        thrusts = problem.middle + self._units * value[:n]
        return problem.center + problem.extent * value[n:], thrusts

    def limits(
        self, u: Array, served: Array, within: AllocationProblem, by_rate: BoolArray | None = None
    ) -> tuple[Limits, BoolArray]:
        """Return what limits the axes; see `limits_within`.

        `by_rate` is not used: the bounds of `within` show what rates limit.
        """
        airmode = self._airmode is not None and self._airmode[1] < inf
        return limits_within(self.problem, within, u, served, self.moved, airmode)

    @cached_property
    def _units(self) -> Array:
        """The units of the thrusts (n,) in `_between` [N]; lost ones may move there, too."""
        half = self.problem.half_range
        return np.where(half > 0.0, half, half.max())

    @cached_property
    def _wide(self) -> Simplex:
        problem = self.problem
        return Simplex(problem.gamma * self._units / problem.extent[:, None])

    def _between(self, lower: Array, upper: Array) -> Simplex:
        """Return the simplex method within other bounds."""
        middle = self.problem.middle
        ends = ((end - middle) / self._units for end in (lower, upper))
        return self._wide.between(*(end.tolist() for end in ends))

    def _serve(
        self, goals: list[float], within: Simplex | None = None,
        limits: list[float] | None = None, wider: bool = False,
    ) -> _Run:
        """Serve a demand (m,) in the units of the simplex, perhaps with other bounds of thrusts.

        `limits`: those on airmode, if they are others.  `wider`: whether all bounds are at least
        as wide as those of the problem.
        """
        offset = self._offset
        simplex = self._start.copy() if within is None else within
        run, narrowed = _Run(simplex), within is not None and not wider
        first = [offset + row for row in self._first]
        if wider and len(first) > 1:
            simplex.hold(first, self._begin)
        elif narrowed and len(first) > 1:
            for v in first:
                simplex.release(v)
        limits = self._airmode if limits is None else limits
        if limits is not None:
            rise, later_rise = limits
            v, demand = offset + self._thrust, min(max(goals[self._thrust], -1.0), 1.0)
            simplex.confine(v, -inf, demand + rise)
        if len(first) == 1:
            run.push(first[0], goals[self._first[0]])
        else:
            ways = [goals[row] - at for row, at in zip(self._first, self._begin, strict=True)]
            backs = [at - simplex.value[v] for v, at in zip(first, self._begin, strict=True)]
            back, distance = run.ray(first, backs) if narrowed else (-1, 0.0)
            length, size = run.ray(first, ways)
            left = 0.0
            if narrowed:
                # The bounds may keep the first group away from the line: go there first.
                simplex.upper[length] = size
                run.push(back, distance)
                left = 1.0 - min(max(simplex.value[back] / distance, 0.0), 1.0)
            run.push(length, size)
            share = simplex.value[length] / size
            run.share = share if left == 0.0 else -1.0
        if limits is not None:
            if later_rise < inf:
                # Thrust rises for the others above its demand, or above what the first need.
                simplex.approach(v, demand)
                simplex.confine(v, -inf, demand + later_rise)
            else:
                simplex.lower[v], simplex.upper[v] = -inf, inf
        self._serve_later(run, goals)
        if len(first) > 1:
            for i, (row, at) in enumerate(zip(self._first, self._begin, strict=True)):
                on_line = goals[row] if share == 1.0 else at + share * ways[i]
                simplex.value[offset + row] = on_line - left * backs[i] if left else on_line
        return run

    def _serve_later(self, run: _Run, goals: list[float]) -> None:
        """Serve the signs of the axes after the first group, and then their values."""
        offset, simplex = self._offset, run.simplex
        for row in self._senses:
            v, value = offset + row, simplex.value[offset + row]
            low, high = sorted((goals[row], self._reference[row]))
            ends = simplex.lower[v], simplex.upper[v]
            if low <= value <= high or run.push(v, low if value < low else high):
                simplex.lower[v], simplex.upper[v] = max(low, ends[0]), min(high, ends[1])
        for group in self._later:
            if len(group) > 1:
                distances = [abs(goals[row] - self._reference[row]) for row in group]
                longest = max(*distances, LAG)
                lag = simplex.add_lag(
                    [offset + row for row in group], [goals[row] for row in group],
                    [max(max(each, LAG) / longest, LAG_RATIO) for each in distances],
                )
                run.push(lag, 0.0)
                simplex.normalize(lag)
            for row in group:
                run.push(offset + row, goals[row])


class _Run:
    """A demand that is being served: the simplex, and the variables that limit an axis.

    `share` is the share of its line that the first group went, -1 away from it.
    """

    def __init__(self, simplex: Simplex) -> None:
        self.simplex, self.share, self.held = simplex, 1.0, set[int]()

    def ray(self, rows: Sequence[int], ways: Sequence[float]) -> tuple[int, float]:
        """Return a new ray along a way, and how far the way goes on it."""
        size = max(map(abs, ways)) or 1.0
        return self.simplex.add_ray(rows, [way / size for way in ways]), size

    def push(self, v: int, goal: float) -> bool:
        """Push a variable, and note what limits it."""
        reached = self.simplex.push(v, goal)
        zero = self.simplex.above_noise(ZERO)
        self.held |= {x for x, rate in self.simplex.proof.items() if abs(rate) > zero}
        return reached
