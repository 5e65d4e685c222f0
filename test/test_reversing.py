"""Rotors that reverse, in the vehicle, the simulated body, the nodes and a flight."""

import numpy as np
import pytest

from ca_ros import ALLOCATORS, ParameterError, Status, Vehicle, make_allocator
from ca_ros.control.waypoint import Waypoint
from ca_ros.nodes.watchdog import fallback
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.studies.cases import Case
from ca_ros.vehicle.state import ATTITUDE, NULL_STATE, VELOCITY

ROV = Vehicle.load('rov')
GOAL = Waypoint.of(1.0, 0.0, 0.0, np.radians(90.0))


def test_thrust_and_speed_by_hand():
    # 3.62e-4 * 100^2 = 3.62 N forwards, 2.83e-4 * 100^2 = 2.83 N backwards.
    speeds = np.array([100.0, -100.0, 0.0, 377.0, -377.0, 1.0, -1.0, 50.0])
    thrusts = ROV.thrusts(speeds)
    np.testing.assert_allclose(thrusts[:3], [3.62, -2.83, 0.0], rtol=1e-12)
    np.testing.assert_allclose(ROV.speeds(thrusts), speeds, rtol=1e-12, atol=0.0)
    np.testing.assert_allclose(ROV.speeds([thrusts, thrusts]), [speeds, speeds], rtol=1e-12)
    np.testing.assert_allclose(ROV.thrust_min, -2.83e-4 * 377.0**2)
    assert ROV.speeds(ROV.thrust_min).tolist() == [-377.0] * 8


def test_a_weak_or_lost_rotor_is_so_in_both_senses():
    weak = ROV.with_health([0.5, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(weak.thrust_min[:2], [0.5 * ROV.thrust_min[0], 0.0])
    np.testing.assert_array_equal([limit[1] for limit in weak.speed_limits], 0.0)


@pytest.mark.parametrize('method', ALLOCATORS)
def test_speeds_are_within_the_bounds_and_give_the_thrusts(method):
    allocator = make_allocator(method, ROV)
    rng = np.random.default_rng(3)
    reach = np.array([150.0, 120.0, 200.0, 40.0, 20.0, 35.0])
    for u in rng.uniform(-1.5 * reach, 1.5 * reach, (100, 6)):
        answer = allocator.allocate(u)
        assert np.all((ROV.speed_min <= answer.speeds) & (answer.speeds <= ROV.speed_max))
        np.testing.assert_allclose(ROV.thrusts(answer.speeds), answer.thrusts, atol=1e-12)


def test_an_idle_rotor_that_can_reverse_stands_still():
    assert fallback('idle', ROV, ROV.speed_max).tolist() == [0.0] * 8
    hexarotor = Vehicle.load('hexarotor')
    assert fallback('idle', hexarotor, hexarotor.speed_max).tolist() == [40.0] * 6


def test_buoyancy_carries_the_body():
    # m g - b = 13.5 * 9.82 - 131.588 = 0.982 N
    assert ROV.weight == pytest.approx(0.982)
    after = RigidBody(ROV).step(NULL_STATE, np.zeros(8), 1.0)
    np.testing.assert_allclose(after[VELOCITY], [0.0, 0.0, -0.982 / 13.5], atol=1e-12)
    hover = make_allocator('exact', ROV).allocate([0.0, 0.0, ROV.weight, 0.0, 0.0, 0.0])
    assert hover.status is Status.EXACT
    after = RigidBody(ROV).step(NULL_STATE, hover.speeds, 1.0)
    np.testing.assert_allclose(after[VELOCITY], 0.0, atol=1e-12)


def test_a_vehicle_that_keeps_level_does_not_tilt():
    case = Case.load('rov')
    flight = fly(case.controller(), case.allocator('exact'), case.body(), GOAL, 15.0)
    assert np.degrees(flight.tilt.max()) < 1e-6
    assert flight.position_error(GOAL) < 1e-4
    assert flight.heading_error(GOAL) < 1e-6
    assert np.all((flight.speeds >= -377.0) & (flight.speeds <= 377.0))
    assert np.all((flight.speeds.min(axis=0) < 0.0)[:4])


def test_it_tilts_when_it_has_lost_the_sideways_force():
    case = Case.load('hexarotor_tilted', ['controller.attitude:=level'])
    four = case.audited(np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    assert 'force_x' not in four.axes or 'force_y' not in four.axes
    still = NULL_STATE[ATTITUDE], np.zeros(3), np.zeros(3), Waypoint.of(1.0, 0.0, 0.0, 0.0)
    level = case.controller().demand(np.zeros(3), *still)
    tilted = case.controller(four).demand(np.zeros(3), *still)
    axes = case.vehicle.axes
    assert level[axes.index('pitch')] == pytest.approx(0.0)
    assert tilted[four.axes.index('pitch')] > 0.1


def test_level_needs_the_sideways_force():
    with pytest.raises(ParameterError, match='level needs force_x, force_y in'):
        Case.load('hexarotor', ['controller.attitude:=level']).controller()
