"""The flight of Section 4: from rest to (1, 1, 1) m and 45 degrees, with each method."""


import numpy as np
import pytest

from ca_ros import ALLOCATORS, Vehicle, make_allocator
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.simulation.plant import Plant
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.studies.cases import Case
from strategies import HEXAROTOR, file_values, length, settings_of

PARAMETERS = file_values('hexarotor')
WAYPOINT = Waypoint.of(1.0, 1.0, 1.0, np.pi / 4)

SHIPPED = [
    'hexarotor', 'hexarotor_ppnnpn', 'hexarotor_tilted', 'octorotor', 'quadrotor', 'x8', 'y6']

every_method = pytest.mark.parametrize('method', ALLOCATORS)


def fly_with(method, duration):
    options = {name: PARAMETERS[f'allocation.conventional.{name}']
               for name in ('weight', 'reference') if method == 'conventional'}
    controller = Controller(HEXAROTOR, settings_of({}).controller)
    allocator = make_allocator(method, HEXAROTOR, **options)
    return fly(controller, allocator, RigidBody(HEXAROTOR), WAYPOINT, duration)


@pytest.fixture(scope='module')
def flights():
    return {method: fly_with(method, 6.0) for method in ALLOCATORS}


def test_both_engines_of_exact_fly_alike(flights, monkeypatch):
    monkeypatch.setenv('CA_ROS_KERNEL', 'numpy')
    other, flight = fly_with('exact', 2.0), flights['exact']
    np.testing.assert_allclose(flight.position[:201], other.position, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(flight.speeds[:201], other.speeds, rtol=0.0, atol=1e-6)


@every_method
def test_the_waypoint_is_reached(flights, method):
    flight = flights[method]
    assert flight.time[-1] == 6.0
    assert np.linalg.norm(flight.position[-1] - [1.0, 1.0, 1.0]) < 0.02
    np.testing.assert_allclose(flight.euler[-1], [0.0, 0.0, np.pi / 4], atol=np.radians(0.5))
    assert flight.position_error(WAYPOINT) < 0.02
    assert flight.heading_error(WAYPOINT) < np.radians(0.5)
    assert flight.speeds.shape == (601, 6)
    assert np.all((flight.speeds >= 40.0) & (flight.speeds <= 400.0))


@every_method
def test_the_flight_is_the_same_to_the_last_bit_each_time(flights, method):
    again = fly_with(method, 0.5)
    for name in ('time', 'position', 'attitude', 'velocity', 'angular_velocity', 'speeds'):
        np.testing.assert_array_equal(
            getattr(again, name), getattr(flights[method], name)[:51], name)


@pytest.mark.slow
@pytest.mark.parametrize('vehicle', length(['y6'], SHIPPED))
@pytest.mark.parametrize(('position', 'heading'), [
    *length([], [((8.0, 0.0, 0.0), 179.0)]), ((8.0, -6.0, 4.0), 170.0)])
def test_a_great_turn_of_the_heading_takes_neither_tilt_nor_height(vehicle, position, heading):
    case = Case.load(vehicle)
    waypoint = Waypoint.of(*position, np.radians(heading))
    # The plan: the same climb, without going anywhere else and without turning.
    plan, flight = (
        fly(case.controller(), case.allocator('exact'), case.body(), goal, 20.0)
        for goal in (Waypoint.of(0.0, 0.0, position[2], 0.0), waypoint))
    assert np.degrees(flight.tilt.max()) < np.degrees(case.parameters['controller.tilt_max']) + 5.0
    assert np.abs(flight.position[:, 2] - plan.position[:, 2]).max() < 0.15
    assert flight.position_error(waypoint) < 1e-3
    assert flight.heading_error(waypoint) < np.radians(0.01)


@pytest.mark.parametrize('tilt_max', [0.1, 0.8])
def test_the_greatest_tilt_holds_in_flight(tilt_max):
    # So far and so fast that the limit is reached.
    case = Case.load('hexarotor', [
        f'controller.tilt_max:={tilt_max}', 'controller.speed_max:=20',
        'controller.position_damping:=3'])
    flight = fly(
        case.controller(), case.allocator('exact'), case.body(),
        Waypoint.of(40.0, -20.0, 4.0, 3.0), 15.0)
    assert 0.95 * tilt_max < flight.tilt.max() < tilt_max + np.radians(1.0)


def test_a_change_takes_effect_at_the_first_sample_that_is_not_before_it():
    case = Case.load('hexarotor')
    there, back = Waypoint.of(1.0, 0.0, 0.0, 0.0), Waypoint.of(-1.0, 0.0, 0.0, 0.0)
    loop = case.controller(), case.allocator('exact'), case.body()
    plain, turned = fly(*loop, there, 1.0), fly(
        *loop, there, 1.0, changes=[Change(495_000_001, waypoint=way) for way in (there, back)])
    np.testing.assert_array_equal(turned.speeds[:50], plain.speeds[:50])
    assert np.any(turned.speeds[50] != plain.speeds[50])


# OSQP finds the wrench infeasible within what rotors at rest reach, and it is rejected.
@pytest.mark.parametrize('method', [method for method in ALLOCATORS if method != 'osqp'])
def test_a_vehicle_with_rates_flies_within_them(method):
    quick = {**file_values('hexarotor'), 'rotors.acceleration_max': 200.0,
             'rotors.deceleration_max': 100.0}
    vehicle = Vehicle.from_parameters(quick)
    settings = settings_of(quick)
    body = Plant(RigidBody(vehicle), PlantSettings(motor_time_constant=0.05))
    flight = fly(
        Controller(vehicle, settings.controller), make_allocator(method, vehicle), body,
        WAYPOINT, 0.5)
    change = np.diff(flight.speeds, axis=0)
    assert change.max() <= 2.0 * (1.0 + 1e-12)
    assert change.min() >= -1.0 * (1.0 + 1e-12)
    assert change.max() > 1.99
