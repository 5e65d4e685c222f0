"""Priorities against an independent sequence of linear programs."""

import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from ca_ros import AdmissibleSet, Exact, SlewLimited, Vehicle, control_allocation_matrix
from ca_ros.problem.prioritization import AXIS_REVERSALS, airmode_limits
from strategies import (
    FLEET,
    HEXAROTOR,
    PX4_ROWS,
    UNIT,
    UNIT_QUADROTOR,
    demands,
    length,
    random_vehicle,
    seeded,
    vehicles,
)
from strategies import (
    unaudited as make_allocator,
)

ORDERS = {
    'default': [['roll', 'pitch'], ['thrust'], ['yaw']],
    'thrust first': [['thrust'], ['roll', 'pitch'], ['yaw']],
    'one by one': [['yaw'], ['pitch'], ['thrust'], ['roll']],
}


SLACK = 1e-8
"""Share of an axis's range that the judge's limits leave beyond what its solver has found."""

ROUNDING = 1e-9
"""The same of the limits before, which its solver may exceed by its tolerance."""

LOST = 1e-5
"""Share of an axis's range away from its reference at hover that makes it a lost one; `SLACK` of
other axes moves it too, by 1.3e-7 in the vehicle `random 3`."""


def groups_of(vehicle, order):
    return [[vehicle.axes.index(axis) for axis in group] for group in order]


class Judge:
    """The rule as a sequence of linear programs over the thrusts, solved by HiGHS.

    `limits` are bounds of the components of the wrench: what has been served so far.
    """

    def __init__(self, vehicle):
        self.axes, self.gamma = vehicle.axes, control_allocation_matrix(vehicle)
        self.low, self.high = vehicle.thrust_min, vehicle.thrust_max
        self.hover = np.array([vehicle.weight * (axis == 'thrust') for axis in vehicle.axes])
        self.half = np.abs(self.gamma * (self.high - self.low)).sum(axis=1) / 2.0
        self.middle = (self.low + self.high) / 2.0
        self.limits = np.full((len(self.gamma), 2), [-np.inf, np.inf])

    def approach(self, rows, low, high, weights):
        """Bring rows between two values each, or as near as possible in units of their weights."""
        sides = np.concatenate([-self.limits[:, 0], self.limits[:, 1], -low, high])
        matrix = np.vstack([-self.gamma, self.gamma, -self.gamma[rows], self.gamma[rows]])
        column = np.concatenate([np.zeros(2 * len(self.gamma)), -weights, -weights])[:, None]
        scale = np.concatenate([self.half, self.half, self.half[rows], self.half[rows]])
        kept = np.isfinite(sides)
        answer = linprog(
            np.append(np.zeros(self.gamma.shape[1]), 1.0),
            A_ub=(np.hstack([matrix, column]) / scale[:, None])[kept],
            b_ub=(sides / scale)[kept],
            bounds=np.column_stack([np.append(self.low, 0.0), np.append(self.high, np.inf)]),
            method='highs-ds', options={'primal_feasibility_tolerance': ROUNDING})
        assert answer.status == 0, answer.message
        self.thrusts = answer.x[:-1]
        # The next program has to contain this answer.
        found, rounding = self.gamma @ answer.x[:-1], ROUNDING * self.half
        self.limits = np.column_stack([
            np.minimum(self.limits[:, 0], found - rounding),
            np.maximum(self.limits[:, 1], found + rounding)])
        reach = answer.x[-1] * weights + SLACK * self.half[rows]
        self.limits[rows] = np.column_stack([
            np.maximum(self.limits[rows, 0], low - reach),
            np.minimum(self.limits[rows, 1], high + reach)])

    def along(self, rows, start, way, free=None):
        """Return the greatest t <= 2 for which some rows can be ``start + t way + s free``.

        s may be anything from 0 to 1; without `free` it is 0.
        """
        free = np.zeros(len(rows)) if free is None else free
        cost = np.append(np.zeros(len(self.low)), [-1.0, 0.0])
        # The limits were found with rows within `SLACK` of where they begin.
        rounding = (SLACK + ROUNDING) * self.half[rows]
        ends = self.limits + ROUNDING * self.half[:, None] * [-1.0, 1.0]
        ends[rows] = [-np.inf, np.inf]
        line = np.column_stack([self.gamma[rows], -way, -free])
        rest = np.column_stack([self.gamma, np.zeros((len(self.gamma), 2))])
        sides = np.concatenate([rounding + start, rounding - start, ends[:, 1], -ends[:, 0]])
        scale = np.concatenate([self.half[rows], self.half[rows], self.half, self.half])
        kept = np.isfinite(sides)
        answer = linprog(
            cost, A_ub=(np.vstack([line, -line, rest, -rest]) / scale[:, None])[kept],
            b_ub=(sides / scale)[kept], bounds=np.column_stack([
                np.append(self.low, [0.0, 0.0]), np.append(self.high, [2.0, 1.0])]),
            method='highs-ds', options={'primal_feasibility_tolerance': ROUNDING}).x
        return answer[len(self.low)]

    def confine(self, low, high):
        """Limit thrust to a range, or to what is between the range and where it can be."""
        row = self.axes.index('thrust')
        low, high = np.clip([low, high], -1e3 * self.half[row], 1e3 * self.half[row])
        before, self.limits[row] = self.limits.copy(), [-np.inf, np.inf]
        self.approach([row], np.array([low]), np.array([high]), np.ones(1))
        missed = high - low - np.ptp(self.limits[row]) < -3.0 * SLACK * self.half[row]
        if missed:
            # On which side of the range it has to stay.
            reach, self.limits = self.limits[row], before.copy()
            self.limits[row] = [-np.inf, np.inf]
            self.approach([row], reach[[0]], np.array([low]), np.ones(1))
            above = np.ptp(self.limits[row]) > low - reach[0] + 3.0 * SLACK * self.half[row]
            reach = [low, reach[1]] if above else [reach[0], high]
        else:
            reach = [low, high]
        self.limits = before
        rounding = SLACK * self.half[row]
        self.limits[row] = [reach[0] - rounding, reach[1] + rounding]

    def line(self, first, u):
        """Return where the line of the first group begins, and its way."""
        before, self.limits = self.limits, np.full_like(self.limits, np.inf) * [-1.0, 1.0]
        center = self.gamma[first] @ (self.low + self.high) / 2.0
        begin = center + min(1.0, 0.99 * self.along(
            first, center, self.hover[first] - center)) * (self.hover[first] - center)
        self.limits = before
        return begin, u[first] - begin

    def rest(self, first, u):
        """Return where the first group is while a limit on airmode begins to hold."""
        return self.line(first, u)[0]

    def serve(self, u, groups, reversal, lost=(), airmode=(1.0, 1.0)):
        """Return the limits (m, 2) of what is served, without a sense of the lost rows.

        They are on both sides of each demand, as near to it as possible.
        """
        first, *later = groups
        thrust = self.axes.index('thrust')
        rises = np.array(airmode)
        rises = np.where(rises < 1.0, 2.0 * self.half[thrust] * rises, np.inf)
        limited = min(airmode) < 1.0 and thrust not in first
        center = self.gamma[thrust] @ self.middle
        demand = center + np.clip(u[thrust] - center, -self.half[thrust], self.half[thrust])
        if limited:
            if len(first) > 1:
                rest, rounding = self.rest(first, u), SLACK * self.half[first]
                self.limits[first] = np.column_stack([rest - rounding, rest + rounding])
            self.confine(-np.inf, demand + rises[0])
            self.limits[first] = [-np.inf, np.inf]
        if len(first) == 1:
            self.approach(first, u[first], u[first], np.ones(1))
        else:
            begin, way = self.line(first, u)
            end = begin + min(1.0, self.along(first, begin, way)) * way
            rounding = 2.0 * SLACK * self.half[first]
            self.limits[first] = np.column_stack([end - rounding, end + rounding])
        if limited:
            self.confine(demand, demand)
            high = self.limits[thrust][1]
            self.limits[thrust] = [-np.inf, max(high, demand + rises[1])]
        rows = [row for group in later for row in group if row not in lost]
        senses = [row for row in rows if self.axes[row] != 'thrust']
        for row in senses if reversal == 'prevent' else []:
            ends = np.sort([[u[row], self.hover[row]]])
            self.approach([row], ends[:, 0], ends[:, 1], np.ones(1))
        for group in later:
            if len(group) > 1:
                ways = np.abs(u[group] - self.hover[group]) / self.half[group]
                weights = np.maximum(ways, 1e-3)
                weights = np.maximum(weights / weights.max(), 1e-6) * self.half[group]
                self.approach(group, u[group], u[group], weights)
            for row in group:
                self.approach([row], u[[row]], u[[row]], np.ones(1))
        return self.limits


def infeasible(vehicle, admissible, rng, size):
    """Draw commands outside of the set, up to three times as far from its middle."""
    columns = control_allocation_matrix(vehicle) * (vehicle.thrust_max - vehicle.thrust_min)
    extent = 1.5 * np.abs(columns).sum(axis=1)
    wrenches = rng.uniform(admissible.center - extent, admissible.center + extent,
                           (20 * size, len(extent)))
    return wrenches[~admissible.contains(wrenches)][:size]


def compare(vehicle, order, rng, size, limits_on_airmode=(1.0,)):
    admissible = AdmissibleSet(vehicle)
    groups = groups_of(vehicle, order)
    scale = 1.0 + np.linalg.norm(admissible.center)
    # At hover these rows cannot be where they should be at rest.
    judge = Judge(vehicle)
    rest = judge.serve(judge.hover, groups, 'allow')
    lost = np.flatnonzero(rest[:, 1] - judge.hover > LOST * judge.half)
    for i, u in enumerate(infeasible(vehicle, admissible, rng, size)):
        reversal = AXIS_REVERSALS[i % 2]
        judge = Judge(vehicle)
        airmode = limits_on_airmode[i // 2 % len(limits_on_airmode)]
        limits = judge.serve(u, groups, reversal, lost, airmode_limits(airmode))
        served = admissible.prioritize(u, order, reversal, airmode)
        # The kernel serves the same.
        exact = make_allocator(
            'exact', vehicle, order=order, axis_reversal=reversal, airmode_limit=airmode)
        np.testing.assert_allclose(
            exact.allocate(u).wrench, served, rtol=0.0, atol=1e-9 * judge.half.max())
        assert admissible.contains(served, tolerance=1e-12 * scale)
        beyond = np.abs(served - np.clip(served, *limits.T))
        assert np.all(beyond <= 1e-4 * judge.half), (u, served, limits)


@pytest.mark.parametrize('order', ORDERS)
def test_the_hexarotor_serves_as_the_linear_programs_do(order):
    compare(HEXAROTOR, ORDERS[order], seeded(0), length(15, 150))


@pytest.mark.parametrize('order', ORDERS)
@pytest.mark.parametrize('seed', length([1, 2], range(10)))
def test_random_vehicles_serve_as_the_linear_programs_do(seed, order):
    rng = seeded(seed)
    vehicle = random_vehicle(rng, 4 + seed % 5)
    lateral = [[axis for axis in vehicle.axes if axis.startswith('force')]]
    compare(vehicle, ORDERS[order] + lateral * bool(lateral[0]), rng, 12)


def test_without_airmode_the_rows_of_px4_get_at_least_as_much_roll_and_pitch():
    admissible = AdmissibleSet(UNIT_QUADROTOR)
    demands = np.column_stack([4.0 * PX4_ROWS[:, 3], PX4_ROWS[:, :3]])
    served = admissible.prioritize(demands, airmode_limit=0.0)
    theirs = PX4_ROWS[:, 4:8] @ control_allocation_matrix(UNIT_QUADROTOR).T
    for wrenches in (served, theirs):
        assert np.all(wrenches[:, 0] <= demands[:, 0] + 1e-9)
    shares = [np.einsum('ij,ij->i', wrenches[:, 1:3], demands[:, 1:3])
              for wrenches in (served, theirs)]
    assert np.all(shares[0] >= shares[1] - 1e-9)


AIRMODES = [0.0, 0.1, 0.5, 1.0, [1.0, 0.0], [0.5, 0.1]]


@pytest.mark.slow
@pytest.mark.parametrize('order', ['default', 'one by one'])
@pytest.mark.parametrize('name', length(
    ['hexarotor', 'tilted_hexarotor'], [*FLEET, *(f'random {i}' for i in range(11))]))
def test_a_limit_on_airmode_serves_as_the_linear_programs_do(name, order):
    rng = seeded(4)
    vehicle = FLEET.get(name) or random_vehicle(seeded(int(name[7:])), 6)
    lateral = [[axis for axis in vehicle.axes if axis.startswith('force')]]
    size = int(os.environ.get('CA_ROS_AIRMODE', length(8, 18)))
    compare(vehicle, ORDERS[order] + lateral * bool(lateral[0]), rng, size, AIRMODES)


@pytest.mark.parametrize('name', ['hexarotor', 'asymmetric', 'x8'])
def test_the_share_of_roll_and_pitch_never_falls_as_the_limit_on_airmode_rises(name):
    admissible, rng = AdmissibleSet(FLEET[name]), seeded(5)
    center, extent = admissible.problem.center, admissible.problem.extent
    for u in rng.uniform(center - 1.2 * extent, center + 1.2 * extent, (20, 4)):
        shares = [admissible.prioritize_levels(u, airmode_limit=limit)[1][1]
                  for limit in np.linspace(0.0, 1.0, 11)]
        assert np.all(np.diff(shares) >= -1e-9)


def test_with_rates_a_greater_limit_on_airmode_never_leads_off_the_demanded_direction():
    vehicle, rng = FLEET['quadrotor'], seeded(7)
    problem, levels = AdmissibleSet(vehicle).problem, slice(1, 3)
    methods = [SlewLimited(Exact(vehicle, airmode_limit=limit), rates=3000.0)
               for limit in (0.0, 0.1, 0.3, 1.0)]
    fell = 0
    for _ in range(60):
        last = rng.uniform(vehicle.speed_min, vehicle.speed_max)
        u = rng.uniform(-1.3, 1.3, 4) * problem.extent + problem.center
        way = ((u - problem.reference) / problem.extent)[levels]
        served = [(problem.gamma @ method.allocate(u, last, 0.01).thrusts - problem.reference)
                  / problem.extent for method in methods]
        shares = [each[levels] @ way / (way @ way) for each in served]
        off = [np.linalg.norm(each[levels] - share * way)
               for each, share in zip(served, shares, strict=True)]
        assert np.all(np.diff(off) <= 1e-7)
        on = np.array(off[:-1]) <= 1e-9
        assert np.all(np.diff(shares)[on] >= -1e-7)
        fell += np.any(np.diff(shares)[~on] < -1e-7)
    assert fell


def test_a_limit_on_airmode_by_hand():
    # Full roll of 1 at a thrust of 2 s, from 0 to 1 N each: without airmode, two rotors at
    # s + r / 4 and two at s - r / 4 give |r| = 4 s up to 2.
    unit = AdmissibleSet(UNIT_QUADROTOR)
    for limit, served in ((0.0, [0.4, 0.4, 0.0, 0.0]), (0.1, [0.8, 0.8, 0.0, 0.0]),
                          (0.5, [1.5, 1.5, 0.0, 0.0]), (1.0, [1.5, 1.5, 0.0, 0.0])):
        np.testing.assert_allclose(
            unit.prioritize([0.4, 1.5, 0.0, 0.0], airmode_limit=limit), served, atol=1e-12)
    with pytest.raises(ValueError, match='airmode_limit: expected one limit, or that of roll'):
        unit.prioritize([4.0, 0.0, 0.0, 1.0], airmode_limit=[1.0, 1.0, 0.0, 0.0])


def test_priorities_worked_out_by_hand():
    # Without roll and pitch the mean thrusts f_P of rotors 1, 3, 5 and f_N of 2, 4, 6 may be any
    # from 0.04 to 4 N: all rotors of a kind alike do it.  Thrust is 3 (f_P + f_N), yaw
    # 0.06 (f_P - f_N).
    admissible = AdmissibleSet(HEXAROTOR)
    # Thrust before yaw: 21 N are 7 N for f_P + f_N, thus f_P = 4, f_N = 3 and 0.06 N m at most.
    np.testing.assert_allclose(
        admissible.prioritize([21.0, 0.0, 0.0, 1.0]), [21.0, 0.0, 0.0, 0.06], atol=1e-12)
    # Yaw before thrust: f_P = 4, f_N = 0.04 give 0.2376 N m and 12.12 N.
    yaw_first = [['roll', 'pitch'], ['yaw'], ['thrust']]
    np.testing.assert_allclose(
        admissible.prioritize([21.0, 0.0, 0.0, 1.0], yaw_first), [12.12, 0.0, 0.0, 0.2376],
        atol=1e-12)
    # All the thrust there is, 24 N, and nothing else.
    thrust_first = [['thrust'], ['roll', 'pitch', 'yaw']]
    np.testing.assert_allclose(
        admissible.prioritize([99.0, 1.0, 1.0, 1.0], thrust_first), [24.0, 0.0, 0.0, 0.0],
        atol=1e-12)


def test_lateral_forces_come_last_by_default():
    admissible = AdmissibleSet(FLEET['tilted_hexarotor'])
    axes = admissible.problem.axes
    u = np.array([50.0, 0.0, 9.81, 0.5, 0.0, 0.1])
    order = [['roll', 'pitch'], ['thrust'], ['yaw'], ['force_x', 'force_y']]
    served = admissible.prioritize(u)
    np.testing.assert_array_equal(served, admissible.prioritize(u, order))
    kept = [axes.index(axis) for axis in ('thrust', 'roll', 'pitch', 'yaw')]
    np.testing.assert_allclose(served[kept], u[kept], atol=1e-12)
    assert 0.0 < served[axes.index('force_x')] < 50.0


@given(st.data())
def test_what_is_served_is_in_the_set_and_what_is_in_the_set_is_served(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    order = [[axis] for axis in data.draw(st.permutations(vehicle.axes))]
    if data.draw(st.booleans()):
        order = [order[0], order[1] + order[2], order[3]]
    admissible = AdmissibleSet(vehicle)
    served = admissible.prioritize(u, order)
    assert admissible.contains(served, tolerance=1e-12 * (1.0 + np.linalg.norm(admissible.center)))
    if admissible.contains(u):
        np.testing.assert_array_equal(served, u)


def test_an_order_may_be_of_words_and_name_axes_that_the_vehicle_does_not_command():
    u = [9.81, 3.0, 0.0, 1.0]
    admissible = AdmissibleSet(HEXAROTOR)
    served = admissible.prioritize(u, [['roll', 'pitch'], ['thrust'], ['yaw']])
    for order in (None, ['roll pitch', 'thrust', 'yaw'], [['roll', 'pitch'], 'thrust', 'yaw'],
                  ['roll pitch', 'force_x force_y', 'thrust', ['yaw']]):
        np.testing.assert_array_equal(admissible.prioritize(u, order), served)


@pytest.mark.parametrize('order', [
    ['roll', 'pitch', 'thrust'], ['roll pitch', 'thrust', 'yaw', ''], 'roll pitch thrust',
    [['roll', 'pitch'], ['thrust']], [['roll'], ['roll', 'pitch'], ['thrust'], ['yaw']],
    [['roll', 'pitch'], ['thrust'], ['yaw'], ['lift']], [['roll', 'pitch', 'thrust', 'yaw'], []],
    []])
def test_an_order_names_each_axis_once(order):
    with pytest.raises(ValueError, match='order'):
        AdmissibleSet(HEXAROTOR).prioritize([30.0, 0.0, 0.0, 0.0], order)


# Continuity

POLICIES = [{'policy': 'scale'}] + [
    {'policy': 'prioritize', 'order': order} for order in ORDERS.values()]


@given(st.data())
def test_near_demands_get_near_thrusts(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    direction = np.array(data.draw(st.lists(
        st.floats(-1.0, 1.0), min_size=len(u), max_size=len(u))))
    allocator = make_allocator('exact', vehicle, **data.draw(st.sampled_from(POLICIES)))
    a, b = (allocator.allocate(u + step * direction) for step in (0.0, 1e-9))
    assert np.abs(a.thrusts - b.thrusts).max() < 1e-4


@pytest.mark.parametrize(('options', 'words'), [
    ({'policy': 'hope'}, 'prioritize, scale, reject'),
    ({'order': [['thrust']]}, 'order'),
    ({'policy': 'scale', 'scale_reference': [99.0, 0.0, 0.0, 0.0]}, 'scale_reference'),
    ({'policy': 'scale', 'scale_reference': [9.81, 0.0]}, 'scale_reference'),
])
def test_a_wrong_option_is_refused_at_once(options, words):
    with pytest.raises(ValueError, match=words):
        make_allocator('exact', HEXAROTOR, **options)


@pytest.mark.parametrize('order', [
    ['roll pitch', 'thrust yaw'], ['thrust', 'roll pitch yaw'], ['yaw', 'roll pitch thrust']])
@pytest.mark.parametrize('name', ['quadrotor', 'hexarotor'])
def test_near_hover_the_axes_of_a_later_group_share_without_a_jump(name, order):
    # There the direction of the demand of a group is of no account: it may be any.
    allocator = make_allocator('exact', FLEET[name], order=order)
    hover, extent = allocator.problem.hover, allocator.problem.extent
    rng, first = seeded(0), order[0].split()
    rows = [allocator.problem.axes.index(axis) for axis in first]
    for _ in range(10):
        u = hover.copy()
        u[rows] += rng.uniform(-2.0, 2.0, len(rows)) * extent[rows]
        near = u + 1e-9 * rng.normal(size=(8, len(u)))
        thrusts = np.array([allocator.allocate(each).thrusts for each in [u, *near]])
        assert np.ptp(thrusts, axis=0).max() < 1e-4


def test_levels_of_scaling_are_the_share_of_the_line():
    # One component of the way is next to nothing, and its quotient would be rounding.
    vehicle = replace(Vehicle.load('hexarotor_tilted'), mass=10.0)
    allocator = make_allocator('exact', vehicle, policy='scale')
    u = np.array([-0.0039885, 0.0, 98.1, 0.0875, -0.3255988, -0.617299])
    level = allocator.allocate(u).level
    np.testing.assert_allclose(allocator.allocate_batch(np.tile(u, (20, 1))).level, level)
    start = AdmissibleSet(vehicle).reference
    np.testing.assert_allclose(
        allocator.allocate(u).wrench, start + level * (u - start), rtol=0.0, atol=1e-9)


# No axis is reversed where a lesser quantity can pay

ROUNDING = 1e-9


def off_sense(served, demand, reference):
    """Return how far values are outside of the range between reference and demand."""
    low, high = np.minimum(reference, demand), np.maximum(reference, demand)
    return np.maximum(np.maximum(low - served, served - high), 0.0)


def test_yaw_is_not_reversed_worked_out_by_hand():
    # Roll and pitch of 1 leave f4 - f2 = 1, so f4 = 1 and f2 = 0, and the same f1 = f3 = g: thrust
    # is 1 + 2 g and yaw is 2 g - 1.  With the most thrust, g = 1, yaw would be +1 where -1 was
    # asked for.  Thrust may pay down to hover, 2: then yaw is 0.
    demand = [3.6, 1.0, 1.0, -1.0]
    expected = {
        'allow': [3.0, 1.0, 1.0, 1.0],
        'prevent': [2.0, 1.0, 1.0, 0.0]}
    for reversal, wrench in expected.items():
        allocation = make_allocator(
            'exact', UNIT_QUADROTOR, axis_reversal=reversal).allocate(demand)
        np.testing.assert_allclose(allocation.wrench, wrench, atol=1e-12)
    # Thrust gives way below a weight of 2.4, too.
    heavier = AdmissibleSet(Vehicle.from_parameters(UNIT | {'vehicle.mass': 2.4 / 9.81}))
    np.testing.assert_allclose(heavier.prioritize(demand), [2.0, 1.0, 1.0, 0.0], atol=1e-12)


# PX4

def test_the_rows_of_px4():
    admissible = AdmissibleSet(UNIT_QUADROTOR)
    demands = np.column_stack([4.0 * PX4_ROWS[:, 3], PX4_ROWS[:, :3]])
    saturated = ~admissible.contains(demands, tolerance=ROUNDING)
    demands = demands[saturated]
    assert len(demands) == 39
    off, sacrificed = {}, {}
    for reversal in ('allow', 'prevent'):
        served = admissible.prioritize(demands, axis_reversal=reversal)
        np.testing.assert_allclose(served[:, 1:3], demands[:, 1:3], atol=ROUNDING)
        off[reversal] = np.count_nonzero(off_sense(served[:, 3], demands[:, 3], 0.0) > ROUNDING)
        sacrificed[reversal] = np.abs(demands - served)[:, 0].sum() / 4.0
    assert off == {'allow': 16, 'prevent': 0}
    # PX4's airmode of roll and pitch gives up 7.04.
    assert sacrificed['prevent'] < 6.4
    # With yaw before thrust it is PX4's full airmode.
    served = admissible.prioritize(demands, ['roll pitch', 'yaw', 'thrust'])
    full = PX4_ROWS[saturated, 12:] @ control_allocation_matrix(UNIT_QUADROTOR).T
    np.testing.assert_allclose(served, full, rtol=0.0, atol=1e-6)
