"""Slew limits: bounds that move with the last command."""

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
from strategies import HEXAROTOR

HOVER = make_allocator('exact', HEXAROTOR).allocate([9.81, 0.0, 0.0, 0.0]).speeds
ROLL = [9.81, 0.8, 0.0, 0.0]


@pytest.mark.parametrize('method', ALLOCATORS)
def test_the_speeds_stay_within_reach_of_the_last_ones(method):
    slow = SlewLimited(make_allocator(method, HEXAROTOR), rates=3000.0)
    rng, last = np.random.default_rng(1), HOVER
    for _ in range(25):
        answer = slow.allocate(ROLL + rng.normal(0.0, [3.0, 0.5, 0.5, 0.05]), last, period=0.01)
        assert np.all(np.abs(answer.speeds - last) <= 30.0 * (1.0 + 1e-12))
        assert np.all((HEXAROTOR.speed_min <= answer.speeds)
                      & (answer.speeds <= HEXAROTOR.speed_max))
        np.testing.assert_array_equal(answer.last, last)
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
    assert statuses[0] is Status.PRIORITIZED
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
    assert answer.status is Status.PRIORITIZED
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
    assert answer.status is Status.INEXACT
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
    assert answer.status is Status.PRIORITIZED


def test_an_answer_without_slew_limits_has_no_last_command():
    assert make_allocator('exact', HEXAROTOR).allocate(ROLL).last is None


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
