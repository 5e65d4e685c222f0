"""An inertial unit in g or in turned axes, found from states or the commanded rotors."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.detection.conditions import FLOWN
from benchmarks.detection.flights import VEHICLES, Setup
from benchmarks.detection.plant import Plant
from ca_ros.detection.force_check import ForceCheck
from ca_ros.vehicle.state import rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

HEXAROTOR = Vehicle.load('hexarotor')
HOVER = np.sqrt(HEXAROTOR.weight / 6 / HEXAROTOR.thrust_per_squared_speed)
UP = np.array([0.0, 0.0, 9.81])
STEP = 5_000_000  # [ns]


class Flight:
    def __init__(self, vehicle=HEXAROTOR):
        self.check, self.time = ForceCheck(vehicle), 0

    def fly(self, seconds, force, speeds=HOVER):
        """Give a specific force for some time; return all that is said."""
        said = []
        for _ in range(round(seconds / 0.005)):
            self.time += STEP
            if self.time % (4 * STEP) == 0:
                self.check.command(speeds)
            self.check.add(self.time, force)
            said.append(self.check.fault)
        return {*said}


@pytest.mark.parametrize(('read', 'words'), [
    (lambda force: force / 9.81, 'read as in g'),
    (lambda force: force * [1, -1, -1], 'read as forward-right-down')])
def test_a_wrong_reading_is_named_after_a_second_and_until_it_is_right(read, words):
    flight = Flight()
    assert flight.fly(0.9, read(UP)) == {''}
    flight.fly(0.3, read(UP))
    [fault] = flight.fly(1.0, read(1.3 * UP))
    assert words in fault
    # On the ground nothing is known.
    [kept] = flight.fly(5.0, UP, 0.1 * HOVER)
    assert words in kept
    flight.fly(1.2, UP)
    assert flight.fly(5.0, UP) == {''}


def test_a_fall_a_landing_a_turn_and_a_lost_rotor_are_no_faults():
    flight = Flight()
    manoeuvres = [
        (UP, HOVER),
        (0.02 * UP, 0.1 * HOVER),  # it falls, its rotors idle
        (0.02 * UP, HOVER),  # it falls, its rotors give nothing
        (3.0 * UP, 1.7 * HOVER),  # it is caught
        (UP, 0.75 * HOVER),  # it stands, half carried by the ground
        (0.8 * UP, HOVER),  # one of six is lost
        (1.5 * UP + [4.0, 0.0, 0.0], HOVER),  # it rises in a gust
    ]
    for force, speeds in manoeuvres:
        for seconds in (0.5, 3.0):
            assert flight.fly(seconds, force, speeds) == {''}, (force, speeds)


def test_states_show_it_on_the_ground_and_where_the_vehicle_lies_on_its_back():
    level, back = np.array([0.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0])
    for attitude, force, words in (
            (level, UP, ''), (level, UP / 9.81, 'in g'), (level, -UP, 'forward-right-down'),
            (back, -UP, ''), (back, UP, 'forward-right-down')):
        flight = Flight()
        for time in range(0, 3_000_000_000, 4 * STEP):
            flight.check.state(time, attitude, np.zeros(3))
            flight.fly(0.02, force)
        assert words in flight.check.fault, (attitude, force)
        assert bool(words) == bool(flight.check.fault), (attitude, force)


def in_wind(read, seconds=10.0):
    """Return all that is said of five vehicles in turbulence, whose forces are read so."""
    said = {}
    for name in VEHICLES:
        setup = Setup.load(name)
        truth, mission = FLOWN['turbulence'].draw(setup.model, np.random.default_rng(1), seconds)
        rows = Plant(setup.model, truth, mission, 1).fly(seconds)
        check, said[name] = ForceCheck(setup.vehicle), set()
        for time, attitude, velocity, force in zip(
                *(rows[each] for each in ('time', 'attitude', 'velocity', 'specific_force')),
                strict=True):
            check.state(int(time), attitude, velocity)
            check.add(int(time), read @ force)
            said[name].add(check.fault)
    return said


@pytest.mark.parametrize('angle', [0, 90, 135, 180, 270])
def test_axes_that_are_turned_about_z_are_named_in_wind_and_never_else(angle):
    turned = rotation_matrix(np.array([0, 0, *np.sin(np.radians([angle / 2, 90 - angle / 2]))]))
    words = f'in axes turned about z by {angle} degrees'
    for name, said in in_wind(turned.T).items():
        # An eighth of a turn beside one that is known would be named as that one.
        assert (angle in (90, 180, 270)) == any(said), name
        assert all(words in each for each in said if each), name
    # In hover they cannot be told from the right ones, also where the sensor has an offset.
    flight = Flight()
    for time in range(0, 3_000_000_000, 4 * STEP):
        flight.check.state(time, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
        assert flight.fly(0.02, turned.T @ np.add(UP, [0.5, -0.3, 0.2])) == {''}


def test_a_fall_and_a_turn_with_states_are_no_faults():
    """It falls, slowed by its drag, with its rotors at hover but dead, and turns over."""
    flight, velocity = Flight(), np.zeros(3)
    for step in range(200):
        angle = 0.03 * step
        attitude = np.array([np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)])
        turn, drag = rotation_matrix(attitude), -0.1 * velocity
        flight.check.state(flight.time, attitude, turn.T @ velocity)
        assert flight.fly(0.02, turn.T @ drag) == {''}
        velocity = velocity + 0.02 * (drag - UP)


def test_inverted_flight_by_rotors_that_turn_back_is_no_fault():
    vehicle = replace(HEXAROTOR, speed_min=-HEXAROTOR.speed_max)
    assert Flight(vehicle).fly(5.0, -UP, -HOVER) == {''}
