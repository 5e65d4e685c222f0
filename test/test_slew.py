"""Slew limits: bounds that move with the last command."""

import os

import numpy as np
import pytest

from ca_ros import (
    ALLOCATORS,
    AllocationProblem,
    Allocator,
    SlewLimited,
    Status,
    Vehicle,
    make_allocator,
)
from ca_ros.allocation.slew import reached
from ca_ros.problem.vehicle_problem import VehicleProblem
from strategies import (
    FLEET,
    HEXAROTOR,
    by_quadprog,
    file_values,
    length,
    need_kernel,
    random_vehicle,
    seeded,
)

HOVER = make_allocator('exact', HEXAROTOR).allocate([9.81, 0.0, 0.0, 0.0]).speeds
ROLL = [9.81, 0.8, 0.0, 0.0]


@pytest.mark.parametrize('method', ALLOCATORS)
def test_the_speeds_stay_within_reach_of_the_last_ones(method):
    slow = SlewLimited(make_allocator(method, HEXAROTOR), rates=3000.0)
    rng, last = seeded(1), HOVER
    for _ in range(25):
        answer = slow.allocate(ROLL + rng.normal(0.0, [3.0, 0.5, 0.5, 0.05]), last, period=0.01)
        assert np.all(np.abs(answer.speeds - last) <= 30.0 * (1.0 + 1e-12))
        assert np.all((HEXAROTOR.speed_min <= answer.speeds)
                      & (answer.speeds <= HEXAROTOR.speed_max))
        low, high = answer.bounds
        assert np.all((low <= answer.thrusts) & (answer.thrusts <= high))
        last = answer.speeds


def test_a_held_demand_is_reached_after_some_commands():
    free = make_allocator('exact', HEXAROTOR).allocate(ROLL)
    slow, last, statuses = SlewLimited(make_allocator('exact', HEXAROTOR), rates=3000.0), HOVER, []
    needed = int(np.ceil(np.abs(free.speeds - HOVER).max() / 30.0))
    for _ in range(needed + 1):
        answer = slow.allocate(ROLL, last, period=0.01)
        statuses.append(answer.status)
        last = answer.speeds
    assert needed > 1
    assert statuses[0] is Status.RATE_LIMITED
    assert statuses[-1] is Status.EXACT
    np.testing.assert_allclose(answer.residual, 0.0, atol=1e-12)
    # Without a limit that holds, the answer is that of the method alone.
    np.testing.assert_allclose(
        slow.allocate(ROLL, free.speeds, 10.0).thrusts, free.thrusts, atol=1e-12)


def test_effectors_by_hand():
    problem = AllocationProblem([[1.0, 1.0]], -1.0, 1.0)
    slow = SlewLimited(make_allocator('exact', problem), rates=[1.0, 2.0])
    # In 0.1 s the first can change by 0.1 and the second by 0.2.
    answer = slow.allocate([1.0], last=[0.0, 0.5], period=0.1)
    np.testing.assert_allclose(answer.thrusts, [0.1, 0.7], atol=1e-15)
    assert answer.status is Status.RATE_LIMITED
    answer = slow.allocate([0.5], last=[0.0, 0.5], period=0.1)
    np.testing.assert_allclose(answer.thrusts, [0.1, 0.4], atol=1e-15)
    assert answer.status is Status.EXACT
    # A last command beyond the bounds counts as the bound.
    answer = slow.allocate([-2.0], last=[9.0, 9.0], period=0.1)
    np.testing.assert_allclose(answer.thrusts, [0.9, 0.8], atol=1e-15)


@pytest.mark.parametrize('period', [0.0, 1e-300, 1e-17])
def test_without_time_the_last_command_is_held(period):
    slow = SlewLimited(make_allocator('exact', HEXAROTOR), rates=100.0)
    answer = slow.allocate(ROLL, HOVER, period)
    np.testing.assert_allclose(answer.speeds, HOVER, rtol=1e-12)
    assert answer.status is Status.RATE_LIMITED
    assert slow.allocate(answer.wrench, HOVER, period).status is Status.EXACT


def test_rotors_reverse_through_zero():
    rov = Vehicle.load('rov')
    slow, last = SlewLimited(make_allocator('exact', rov), rates=1000.0), np.zeros(8)
    for _ in range(40):
        last = slow.allocate([-60.0, 0.0, rov.weight, 0.0, 0.0, 0.0], last, 0.01).speeds
    free = make_allocator('exact', rov).allocate([-60.0, 0.0, rov.weight, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(last, free.speeds, atol=1e-9)
    assert last.min() < -200.0


@pytest.mark.parametrize('method', ALLOCATORS)
def test_speeds_give_the_thrusts_on_both_sides_of_zero(method):
    rov = Vehicle.load('rov')
    slow, last = SlewLimited(make_allocator(method, rov), rates=2000.0), np.full(8, -300.0)
    for step in range(60):
        swing = np.sin(0.1 * step) * np.array([80.0, 60.0, 120.0, 8.0, 8.0, 15.0])
        answer = slow.allocate(swing, last, 0.01)
        assert np.all(np.abs(answer.speeds - np.clip(last, -377.0, 377.0)) <= 20.0 * (1.0 + 1e-12))
        np.testing.assert_allclose(rov.thrusts(answer.speeds), answer.thrusts, atol=1e-9)
        last = answer.speeds


def test_rotors_that_can_only_reverse_for_now_are_not_lost():
    slow = SlewLimited(make_allocator('exact', Vehicle.load('rov')), rates=2000.0)
    answer = slow.allocate([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], np.full(8, -1.0), 0.0005)
    # The speeds are between -2 and 0; the vertical rotors stop, which is nearest to the demand.
    np.testing.assert_allclose(answer.speeds[4:], 0.0, atol=1e-5)
    assert answer.status is Status.RATE_LIMITED


def test_an_answer_without_slew_limits_has_no_bounds_of_its_own():
    assert make_allocator('exact', HEXAROTOR).allocate(ROLL).bounds is None


@pytest.mark.parametrize(('rates', 'last', 'period', 'fault'), [
    (0.0, HOVER, 0.01, 'rates: expected positive numbers'),
    ([1.0, 2.0], HOVER, 0.01, 'rates: expected 1 or 6 numbers'),
    (1.0, HOVER[:5], 0.01, 'last: expected 1 or 6 numbers'),
    (1.0, HOVER * np.nan, 0.01, 'last: expected finite numbers'),
    (1.0, HOVER, -0.1, 'period: expected a time from 0 on'),
    (1.0, HOVER, np.nan, 'period: expected finite numbers'),
    (1.0, HOVER, 'soon', 'period: expected numbers'),
])
def test_wrong_arguments_are_named(rates, last, period, fault):
    with pytest.raises(ValueError, match=fault):
        SlewLimited(make_allocator('exact', HEXAROTOR), rates).allocate(ROLL, last, period)


@pytest.mark.parametrize('method', ALLOCATORS)
def test_without_a_last_command_it_is_the_allocator(method):
    free = make_allocator(method, HEXAROTOR)
    slow = SlewLimited(free, rates=3000.0)
    assert isinstance(slow, Allocator)
    for answer in (slow.allocate(ROLL), slow.allocate_batch([ROLL])):
        np.testing.assert_array_equal(
            np.ravel(answer.thrusts), free.allocate(ROLL).thrusts)


# Against quadprog, NumPy and the priorities without rates

SEQUENCES = int(os.environ.get('CA_ROS_SEQUENCES', length(6, 40)))
"""How many sequences of 10 wrenches; of all vehicles together."""

RATES = 2000.0


def sequence(problem, rng, size=10):
    """Draw wrenches (size, m) between attainable ones, with unattainable ones among them."""
    ends = rng.uniform(problem.lower, problem.upper, (2, problem.n)) @ problem.gamma.T
    drawn = ends[0] + np.linspace(0.0, 1.0, size)[:, None] * (ends[1] - ends[0])
    pushed = rng.random((size, 1)) < 0.3
    return drawn + pushed * rng.normal(0.0, 0.5, drawn.shape) * problem.extent


@pytest.mark.parametrize('index', range(SEQUENCES))
def test_sequences_are_exact_within_the_moving_bounds(index, monkeypatch):
    need_kernel()
    rng = seeded(index)
    names = [*FLEET, *range(11)]
    name = names[index % len(names)]
    vehicle = FLEET[name] if name in FLEET else random_vehicle(
        seeded(name), 4 + name % 5)
    problem = VehicleProblem(vehicle)
    demands, periods = sequence(problem, rng), rng.choice([0.002, 0.01, 0.05], 10)
    rates = RATES * rng.uniform(0.5, 2.0, vehicle.n), 0.5 * RATES * rng.uniform(0.5, 2.0)
    start = rng.uniform(vehicle.speed_min, vehicle.speed_max)
    slow = {}
    for engine in ('c', 'numpy'):
        monkeypatch.setenv('CA_ROS_KERNEL', engine)
        slow[engine] = SlewLimited(make_allocator('exact', problem), *rates)
    last = start
    for u, period in zip(demands, periods, strict=True):
        # Both from the same last command: errors of single steps, not of the sequence.
        answer, numpy = (slow[engine].allocate(u, last, period) for engine in ('c', 'numpy'))
        last, size, (low, high) = answer.speeds, max(1.0, np.linalg.norm(u)), answer.bounds
        assert np.all((low <= answer.thrusts) & (answer.thrusts <= high))
        assert numpy.status == answer.status
        assert np.abs(numpy.wrench - answer.wrench).max() <= 1e-12 * max(
            size, np.abs(answer.thrusts).sum())
        served = u
        if answer.status == Status.EXACT:
            assert np.linalg.norm(answer.residual) <= 1e-12 * size
        else:
            served = answer.wrench
            assert answer.status in (Status.PRIORITIZED, Status.RATE_LIMITED)
            with pytest.raises(ValueError, match='constraints are inconsistent'):
                by_quadprog(problem.gamma, u, low, high)
        try:
            least = by_quadprog(problem.gamma, served, low, high)
        except ValueError:
            # On the boundary rounding decides whether quadprog finds the wrench.
            continue
        assert np.linalg.norm(answer.thrusts) <= np.linalg.norm(least) + 1e-9
    # Without a bound that is narrower the answers are those without rates, to the last bit.
    monkeypatch.setenv('CA_ROS_KERNEL', 'c')
    free = make_allocator('exact', problem)
    for u in demands:
        wide = SlewLimited(free, 1e9).allocate(u, start, 1.0)
        np.testing.assert_array_equal(wide.thrusts, free.allocate(u).thrusts)


def test_motors_brake_more_slowly_than_they_accelerate():
    slow = SlewLimited(make_allocator('exact', HEXAROTOR), rates=3000.0, braking=1000.0)
    low, high = (HEXAROTOR.speeds(bound) for bound in slow.reachable(HOVER, 0.01))
    np.testing.assert_allclose(low, HOVER - 10.0)
    np.testing.assert_allclose(high, HOVER + 30.0)
    # A rotor at 5 rad/s stops after 5 ms, then grows backwards for 5 ms.
    up, down = np.array(3000.0), np.array(1000.0)
    low, high = reached(np.array([5.0, -5.0]), 0.01, up, down, -99.0, 99.0)
    np.testing.assert_allclose(low, [-15.0, -35.0])
    np.testing.assert_allclose(high, [35.0, 15.0])


def test_the_certificate_and_the_explanation_name_the_rates():
    slow = SlewLimited(make_allocator('exact', HEXAROTOR), rates=1000.0)
    answer = slow.allocate([9.81, 0.0, 0.0, 0.15], HOVER, 0.01)
    assert answer.status is Status.RATE_LIMITED
    np.testing.assert_array_equal(answer.certificate.rate_limited, [False, True] * 3)
    assert 'by their rates' in str(answer.certificate)
    # Thrust is kept, so the rotors that slow down decide: they lose more than the others may.
    np.testing.assert_array_equal(answer.explanation.limit, [0, -2] * 3)
    assert 'at their rate' in str(answer.explanation)
    wide = slow.allocate([9.81, 0.0, 0.0, 0.15], HOVER, 1.0)
    assert wide.status is Status.EXACT


def test_the_rates_of_a_vehicle_are_in_its_file():
    quick = Vehicle.from_parameters(
        {**file_values('hexarotor'), 'rotors.acceleration_max': 3000.0,
         'rotors.deceleration_max': 1000.0})
    slow = SlewLimited(make_allocator('exact', quick))
    np.testing.assert_array_equal(slow.rates, 3000.0)
    np.testing.assert_array_equal(slow.braking, 1000.0)
    with pytest.raises(ValueError, match='rates: the vehicle has no'):
        SlewLimited(make_allocator('exact', HEXAROTOR))
    with pytest.raises(ValueError, match='for all rotors, or 0 for all'):
        Vehicle.from_parameters(
            {**file_values('hexarotor'), 'rotors.acceleration_max': [1.0, 0.0] * 3})
