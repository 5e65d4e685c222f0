"""Allocators after failures: the axes of the wrench stay, lost ones leave the policies."""

import pickle
from itertools import combinations

import numpy as np
import pytest

from ca_ros import ALLOCATORS, Exact, ParameterError, Status, Vehicle, audit, make_allocator
from ca_ros.allocation.reduced import allocator_for
from strategies import length, seeded

VEHICLES = ['quadrotor', 'hexarotor', 'hexarotor_ppnnpn', 'hexarotor_tilted', 'x8', 'tricopter']
POLICIES = ['prioritize', 'scale', 'reject']


def health_without(n, *rotors):
    return np.where(np.isin(np.arange(1, n + 1), rotors), 0.0, 1.0)


def losses(vehicle):
    pairs = [*combinations(range(1, vehicle.n + 1), 2)]
    return [(i,) for i in range(1, vehicle.n + 1)] + pairs[:: length(4, 1)]


@pytest.mark.parametrize('policy', POLICIES)
@pytest.mark.parametrize('name', VEHICLES)
def test_the_answers_are_those_of_the_node_to_the_last_bit(name, policy):
    vehicle, rng = Vehicle.load(name), seeded(7)
    sound = Exact(vehicle, policy=policy)
    for lost in losses(vehicle):
        health = health_without(vehicle.n, *lost)
        allocator, report = sound.with_health(health), audit(vehicle.with_health(health))
        node = allocator_for(Exact, report, sound.settings)
        rows = [vehicle.axes.index(axis) for axis in report.independent.axes]
        assert allocator.problem.axes == vehicle.axes
        assert allocator.lost_axes == report.lost
        for _ in range(3):
            u = sound.problem.hover + rng.normal(0.0, 0.3, len(vehicle.axes))
            answer = allocator.allocate(u)
            np.testing.assert_array_equal(answer.thrusts, node.allocate(u[rows]).thrusts)
            np.testing.assert_allclose(
                answer.residual, u - sound.problem.part(vehicle.axes).gamma @ answer.thrusts
                if not len(vehicle.servos) else answer.residual, atol=1e-12)
            assert (answer.status is Status.EXACT) == (
                np.linalg.norm(answer.residual) <= 1e-12 * max(1.0, np.linalg.norm(u)))


@pytest.mark.parametrize('policy', POLICIES)
@pytest.mark.parametrize('name', VEHICLES)
def test_hover_keeps_the_axes_that_are_left_whatever_the_policy(name, policy):
    """A yaw that nobody can hold must not cost the vehicle its thrust, or tilt it."""
    vehicle = Vehicle.load(name)
    sound = Exact(vehicle, policy=policy)
    for lost in losses(vehicle):
        allocator = sound.with_health(health_without(vehicle.n, *lost))
        if not allocator.audit.keeps_hovering:
            continue
        answer = allocator.allocate(sound.problem.hover)
        left = [axis not in allocator.lost_axes for axis in vehicle.axes]
        np.testing.assert_allclose(answer.residual[left], 0.0, atol=1e-9)
        served = answer.explanation.served
        np.testing.assert_array_equal(np.isnan(served), np.logical_not(left))
        for axis in allocator.lost_axes:
            assert f'{axis} is lost' in str(answer.explanation)


def test_rotor_1_of_the_hexarotor():
    """By hand: without rotor 1 the others hover with a yaw torque that they cannot hold."""
    sound = Exact(Vehicle.load('hexarotor'))
    allocator = sound.with_health(health_without(6, 1))
    answer = allocator.allocate(sound.problem.hover)
    assert (allocator.lost_axes, answer.status) == (('yaw',), Status.PRIORITIZED)
    # Rotor 4, opposite, runs at its least thrust, 0.04 N; its drag of 0.02 m is the yaw torque.
    assert answer.thrusts[3] == pytest.approx(2.5e-5 * 40.0**2)
    assert abs(answer.residual[3]) == pytest.approx(0.0024, abs=1e-5)
    assert str(answer) == 'PRIORITIZED: thrust 9.81, roll 0, pitch 0, yaw -0.0024 of 0'


@pytest.mark.parametrize('method', ALLOCATORS)
def test_health_is_absolute_and_all_ones_give_the_same_bits_again(method):
    vehicle = Vehicle.load('hexarotor_ppnnpn')
    sound = ALLOCATORS[method](vehicle)
    u = np.array([11.0, 0.4, -0.2, 0.05])
    first = sound.with_health(health_without(6, 1)).with_health(health_without(6, 2))
    np.testing.assert_array_equal(
        first.allocate(u).thrusts,
        sound.with_health(health_without(6, 2)).allocate(u).thrusts)
    for again in (first.with_health(np.ones(6)), sound.with_health([1] * 6)):
        assert type(again) is type(sound)
        np.testing.assert_array_equal(again.allocate(u).thrusts, sound.allocate(u).thrusts)
    # The one that is asked stays as it is.
    assert not sound.problem.vehicle.lost.any()


def test_batches_copies_and_rates_have_all_axes(tmp_path):
    vehicle = Vehicle.load('hexarotor')
    allocator = Exact(vehicle, policy='scale').with_health(health_without(6, 3))
    wrenches = np.array([[9.81, 0.0, 0.0, 0.0], [12.0, 0.2, 0.1, 0.1], [90.0, 0.0, 0.0, 0.0]])
    batch, copied = allocator.allocate_batch(wrenches), pickle.loads(pickle.dumps(allocator))
    for u, answer in zip(wrenches, batch, strict=True):
        one, other = allocator.allocate(u), copied.allocate(u)
        for found in (answer, other):
            np.testing.assert_array_equal(found.thrusts, one.thrusts)
            assert (found.status, found.demand.shape) == (one.status, (4,))
    assert [Status(each).name for each in batch.status] == ['INEXACT', 'INEXACT', 'SCALED']
    within = allocator.allocate_within(
        wrenches[0], np.full(6, 0.5), np.full(6, 3.9))
    assert within.wrench[0] == pytest.approx(9.81)
    assert (within.thrusts[[0, 1, 3, 4, 5]] >= 0.5).all()


def test_without_any_rotor_all_answers_are_at_rest():
    allocator = Exact(Vehicle.load('x8')).with_health(np.zeros(8))
    answer = allocator.allocate([20.0, 0.0, 0.0, 0.0])
    assert (answer.status, np.abs(answer.thrusts).max()) == (Status.INEXACT, 0.0)
    assert allocator.problem.axes == ('thrust', 'roll', 'pitch', 'yaw')


@pytest.mark.parametrize('name', ['hexarotor', 'tricopter'])
def test_without_any_rotor_all_axes_are_lost(name):
    vehicle = Vehicle.load(name)
    allocator = Exact(vehicle).with_health(np.zeros(vehicle.n))
    assert allocator.lost_axes == vehicle.axes
    assert str(allocator.allocate([9.81, 0.1, 0.0, 0.0]).explanation) == (
        '; '.join(f'{axis} is lost' for axis in vehicle.axes))


def test_a_lost_axis_is_served_last_whatever_the_order():
    vehicle = Vehicle.load('hexarotor')
    yaw_first = Exact(vehicle, order=['yaw', 'roll pitch', 'thrust'])
    answer = yaw_first.with_health(health_without(6, 1)).allocate([9.81, 0.1, 0.0, 0.1])
    np.testing.assert_allclose(answer.residual[:3], 0.0, atol=1e-9)


@pytest.mark.parametrize('method', ['exact', 'pseudo_inverse', 'weighted_least_squares'])
@pytest.mark.parametrize(('name', 'arm'), [('x8', (3, 4)), ('y6', (5, 6))])
def test_an_arm_of_which_one_rotor_has_failed_is_one_effector(name, arm, method):
    vehicle, rng = Vehicle.load(name), seeded(3)
    pair = [rotor - 1 for rotor in arm]
    half = np.where(np.isin(np.arange(vehicle.n), pair), 0.5, 1.0)
    sound = make_allocator(method, vehicle)
    allocator = sound.with_health(half, [arm])
    for _ in range(50):
        answer = allocator.allocate(sound.problem.hover + rng.normal(0.0, 0.05, 4))
        np.testing.assert_allclose(answer.thrusts[pair[0]], answer.thrusts[pair[1]], atol=1e-12)
        # Whichever of both has failed, only the yaw is wrong, within the bound.
        expected = allocator.problem.gamma @ answer.thrusts
        for lost in pair:
            true = vehicle.with_health(health_without(vehicle.n, lost + 1))
            error = true.wrenches[[2, 3, 4, 5]] @ true.thrusts(answer.speeds) - expected
            np.testing.assert_allclose(error[:3], 0.0, atol=1e-10)
            bound = vehicle.torque_coefficient[lost] / vehicle.thrust_coefficient[lost]
            assert abs(error[3]) <= bound * 2.0 * answer.thrusts[lost] + 1e-9
    # The health alone says that both work, at half of their thrust.
    assert sound.with_health(half).problem.gamma[3, pair].all()
    again = allocator.with_health(np.ones(vehicle.n))
    np.testing.assert_array_equal(again.problem.gamma, sound.problem.gamma)


def test_misuse_is_refused():
    allocator = Exact(Vehicle.load('hexarotor'))
    with pytest.raises(ParameterError, match=r'expected 6 numbers in \[0, 1\], .* got 1$'):
        allocator.with_health(1)
    with pytest.raises(ParameterError, match=r'expected 6 numbers in \[0, 1\]'):
        allocator.with_health([1.0, 0.0])
    half = [0.5] * 6
    x8, eighth = Exact(Vehicle.load('x8')), [0.5] * 8
    for sound, arm, health, words in (
        (allocator, (1, 7), half, 'two different rotors of 1 to 6'),
        (allocator, (2, 2), half, 'two different rotors of 1 to 6'),
        (x8, (1, 9), eighth, 'two different rotors of 1 to 8'),
        (x8, (0, 1), eighth, 'two different rotors of 1 to 8'),
        (x8, (1, 2), [0.5, 0.4, 1, 1, 1, 1, 1, 1], 'two rotors with the same health'),
        (x8, (1, 5), eighth, 'two rotors on the same axis'),
        (allocator, (1, 2), half, 'two rotors on the same axis'),
    ):
        with pytest.raises(ParameterError, match=f'arm {arm[0]} {arm[1]}: expected {words}'):
            sound.with_health(health, [arm])
    with pytest.raises(TypeError, match=r"by keyword \(order, .* got 'scale'"):
        Exact(Vehicle.load('hexarotor'), 'scale')


@pytest.mark.parametrize('policy', POLICIES)
@pytest.mark.parametrize('name', VEHICLES)
def test_a_vehicle_that_recovers_flies_as_before(name, policy):
    vehicle = Vehicle.load(name)
    sound = Exact(vehicle, policy=policy)
    u = sound.problem.hover
    for share in (0.0, 0.4, 0.6):
        weak = sound.with_health([share] * vehicle.n)
        assert weak.problem.axes == vehicle.axes
        np.testing.assert_array_equal(
            weak.with_health(np.ones(vehicle.n)).allocate(u).thrusts, sound.allocate(u).thrusts)


def test_answers_after_failures_are_copied_certified_and_explained_as_single_ones():
    for name in ('hexarotor', 'quadrotor', 'hexarotor_tilted', 'tricopter'):
        sound = Exact(Vehicle.load(name))
        n = sound.problem.vehicle.n
        allocator = sound.with_health(health_without(n, 1))
        u = sound.problem.hover
        answer = allocator.allocate(u)
        assert answer.certificate.kkt_residual < 1e-4
        assert 'residual' in str(answer.certificate)
        # The residual is that of all axes, also of those that the method does not have.
        missed = np.linalg.norm(answer.residual)
        assert answer.certificate.primal_residual == pytest.approx(missed, rel=1e-12)
        both = allocator.allocate_batch([u, u + 0.1]).certificate
        np.testing.assert_allclose(both.primal_residual[0], missed, rtol=1e-9)
        copied = pickle.loads(pickle.dumps(answer))
        [one] = allocator.allocate_batch(u[None])
        [part] = allocator.allocate_batch(u[None])[0:1]
        for other in (copied, one, part):
            assert str(other.explanation) == str(answer.explanation)
            np.testing.assert_array_equal(other.thrusts, answer.thrusts)
        pickle.loads(pickle.dumps(sound)).allocate(u)


def test_a_reference_of_scale_that_is_out_of_reach_gives_way_to_hover():
    sound = Exact(Vehicle.load('hexarotor'), policy='scale', scale_reference=[9.81, 0, 0, 0])
    for health in ([0.0] * 6, [0.4] * 6, health_without(6, 1)):
        sound.with_health(health).allocate([9.81, 0.5, 0.0, 0.0])


@pytest.mark.parametrize(('name', 'rates', 'last'), [
    ('hexarotor_realistic', None, (np.full(6, 250.0),)),
    ('tricopter', 2000.0, (np.full(3, 250.0), [0.0]))])
def test_rates_after_a_failure_take_the_last_command(name, rates, last):
    """Those of the vehicle's file, and of rotors that tilt."""
    failed = Exact(Vehicle.load(name)).fail(1)
    slow = failed.within_rates(rates)
    u = failed.problem.hover
    answer = slow.allocate(u, *last, period=0.01)
    np.testing.assert_array_equal(
        answer.thrusts, slow.allocate_after(u, np.concatenate(last), 0.01).thrusts)
    assert answer.wrench.shape == (4,)
    assert repr(slow) == f'{type(slow._answering).__name__}: {failed!r}'


def test_rates_and_failures_in_either_order():
    sound = Exact(Vehicle.load('hexarotor'))
    health, last = health_without(6, 1), np.full(6, 250.0)
    u = sound.problem.hover
    one = sound.with_health(health).within_rates(2000.0).allocate(u, last, 0.01)
    other = sound.within_rates(2000.0).with_health(health).allocate(u, last, 0.01)
    np.testing.assert_array_equal(one.thrusts, other.thrusts)
