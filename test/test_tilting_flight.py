"""Flights of vehicles whose rotors tilt, with servos that lag and are slow."""

from functools import partial

import numpy as np
import pytest

from ca_ros import ParameterError, TiltLimited, Vehicle, make_allocator
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.parameter_files import ControllerNodeSettings
from ca_ros.settings import read
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.studies.cases import Case
from ca_ros.vehicle import files
from ca_ros.vehicle.motor_lag import ServoLag
from ca_ros.vehicle.state import NULL_STATE, tilt

pytestmark = pytest.mark.slow

PLANT = PlantSettings(
    time_step=0.02, sub_steps=2, motor_time_constant=0.02, servo_time_constant=0.03,
    servo_rate=6.0,
)
HOVER = Waypoint.of(0.0, 0.0, 0.0, 0.0)


def parts(vehicle, given):
    controller = Controller.from_settings(vehicle, read(ControllerNodeSettings, given))
    return controller, make_allocator('exact', vehicle), body_of(vehicle, PLANT)


def flown(name, duration, changes=(), **over):
    given = files.read(name) | over
    controller, allocator, body = parts(Vehicle.from_parameters(given), given)
    return fly(controller, allocator, Plant(body, PLANT), HOVER, duration, changes=changes)


def announced(name, body, health, stuck=(), **others):
    """Return a failure after a second that is announced at once."""
    reconfigure = partial(Case.load(name).reconfiguration, 'exact')
    return Change(
        int(1e9), body, announced=(health, dict([stuck] if stuck else [])),
        reconfigure=reconfigure, **others)


def test_slalom_at_constant_attitude():
    points = [Waypoint.of(0.4 * k, 0.4 * (-1) ** k, 0.0, 0.0) for k in (1, 2, 3)]
    flight = flown('hexarotor_tilting', 5.0, [
        Change(int((1.0 + k) * 1e9), waypoint=point) for k, point in enumerate(points)
    ])
    assert tilt(flight.attitude).max() < 1e-9
    assert np.ptp(flight.position[:, 1]) > 0.25
    assert np.abs(flight.position[-1] - points[-1].position).max() < 0.3


def test_roll_by_90_degrees_on_the_spot():
    side = Waypoint(np.zeros(3), np.array([np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)]))
    flight = flown('omnidirectional_gimbals', 4.0, [Change(int(1e9), waypoint=side)],
                   **{'controller.attitude': 'pose'})
    assert np.degrees(tilt(flight.attitude)[-1]) == pytest.approx(90.0, abs=0.5)
    assert np.abs(flight.position[flight.time > 1.0]).max() < 0.3


def test_a_boat_reaches_its_waypoint_also_after_the_loss_of_a_thruster():
    given, goal = files.read('azimuth_boat'), Waypoint.of(0.3, 0.3, 0.0, 0.5)
    vehicle = Vehicle.from_parameters(given)
    health = [0.0, 1.0, 1.0, 1.0]
    lost = announced('azimuth_boat', parts(vehicle.with_health(health), given)[2], health)
    flight = fly(*parts(vehicle, given), goal, 8.0, 0.02, changes=[lost])
    assert flight.position_error(goal) < 0.01
    assert abs(flight.heading[-1] - 0.5) < 0.01
    # It stays upright and on the water, though nobody commands roll, pitch or height.
    assert tilt(flight.attitude).max() < 1e-9
    assert np.abs(flight.position[:, 2]).max() < 1e-9


def test_a_tricopter_reaches_its_waypoint_though_its_tail_pushes_to_the_side():
    given, goal = files.read('tricopter'), Waypoint.of(0.5, 0.5, 0.5, 0.5)
    flight = fly(*parts(Vehicle.from_parameters(given), given), goal, 10.0, 0.02)
    assert abs(flight.angles[-1, 0]) > 0.05
    assert flight.position_error(goal) < 0.005
    assert abs(flight.heading[-1] - 0.5) < 0.01


@pytest.mark.parametrize('failure', ['servo', 'rotor'])
def test_announced_failure_of_one_servo_or_rotor(failure):
    given = files.read('hexarotor_tilting')
    vehicle = Vehicle.from_parameters(given)
    health, stuck = [1.0, float(failure == 'servo'), *[1.0] * 4], ()
    if failure == 'servo':
        stuck = (2, 0.5)
    body = parts(vehicle.with_health(health).with_stuck_servos(stuck or 0.0), given)[2]
    change = announced(
        'hexarotor_tilting', body, health, stuck, waypoint=Waypoint.of(0.3, 0.0, 0.0, 0.0))
    flight = flown('hexarotor_tilting', 4.0, [change])
    assert np.degrees(tilt(flight.attitude).max()) < 10.0
    assert np.abs(flight.position[-1] - [0.3, 0.0, 0.0]).max() < 0.1
    after = flight.speeds[flight.time > 1.0]
    if failure == 'servo':
        np.testing.assert_array_equal(flight.angles[flight.time > 1.0, 1], 0.5)
    else:
        assert (after[:, 1] == 0.0).all()


def test_servos_of_the_plant_lag_and_have_a_rate():
    vehicle = Vehicle.load('hexarotor_tilting')
    plant = Plant(body_of(vehicle, PLANT), PLANT, NULL_STATE)
    command = np.concatenate([np.full(6, 255.7), np.full(6, 1.0)])
    angles = []
    for _ in range(50):
        plant.step(command)
        angles.append(plant.speeds[6:])
    angles = np.array(angles)
    assert angles[0] == pytest.approx(6.0 * 0.02)
    assert np.diff(angles, axis=0).max() <= 6.0 * 0.02 + 1e-12
    # Within the rate, the lag is exponential: 1 - exp(-0.02 / 0.03) of what is left a step.
    assert 1.0 - angles[20] == pytest.approx((1.0 - angles[19]) * np.exp(-0.02 / 0.03))


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_azimuth_thrusters_turn_on_beyond_their_limits(side):
    vehicle, before = Vehicle.load('azimuth_boat'), side * np.full(4, np.pi - 0.05)
    # Backwards and a little to one side: 0.1 rad further, and not a whole turn back.
    wrench = [-8.0 * np.cos(0.05), -side * 8.0 * np.sin(0.05), 0.0]
    answer = TiltLimited(vehicle, 1e6, 6.0).allocate(wrench, np.full(4, 63.0), before, 0.02)
    assert answer.status.name == 'EXACT'
    np.testing.assert_allclose(answer.angles, side * (0.05 - np.pi), atol=1e-9)
    servos = ServoLag(0.0, 3.0, vehicle)
    turned = servos.move(before, answer.angles, 0.02, vehicle)
    np.testing.assert_allclose(turned, side * (np.pi + 0.01 - 2.0 * np.pi), atol=1e-12)


def test_wrong_servos_are_named():
    with pytest.raises(ParameterError, match='no single servo'):
        Vehicle.load('omnidirectional_gimbals').with_stuck_servo(1, 0.1)
    with pytest.raises(ParameterError, match='expected -1 to 1 rad'):
        Vehicle.load('hexarotor_tilting').with_stuck_servo(1, 1.5)
    with pytest.raises(ParameterError, match='no rotor'):
        Vehicle.load('hexarotor').with_stuck_servo(1, 0.0)
