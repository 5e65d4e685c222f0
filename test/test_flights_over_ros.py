"""Flights over the nodes in lockstep equal those without ROS, to the last bit."""

import pytest

from ca_ros.bringup.flight_options import failure_words
from ca_ros.control.trajectory import Trajectory
from ca_ros.simulation.closed_loop import fly, waypoint_changes
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.studies.cases import Case
from nodes import fly_over_ros
from strategies import EVERY_EFFECT, length

SQUARE = 't,x,y,z,heading\n0,1,0,1,0\n0.5,1,1,1,1.5\n0.9,0,1,1.5,-1.5\n'
EFFECTS = EVERY_EFFECT | {
    # A parameter other than in the file has to reach the nodes, too.
    'controller.position_stiffness': 1.4, 'controller.integral_gain': 0.5,
    # Neither whole milliseconds nor a whole number of steps in a second.
    'simulator.time_step': 0.0133333333333, 'simulator.sub_steps': 4.0,
    'simulator.command_delay': 0.01, 'simulator.state_delay': 0.02}


@pytest.mark.long
@pytest.mark.parametrize('method', length(['exact'], ['exact', 'conventional', 'osqp']))
def test_a_flight_with_every_effect_waypoints_and_failures(graph, tmp_path, method):
    path = tmp_path / 'square.csv'
    path.write_text(SQUARE)
    changes = [f'{name}:={value}' for name, value in EFFECTS.items()]
    case = Case.load('hexarotor', [*changes, f'allocation.method:={method}'])
    failures = RotorFailures.read(['2@0.4=0.3', '1@0.505=0.8'], 0.25)
    trajectory = Trajectory.read(path)
    fly(
        case.controller(), case.allocator(method), case.plant(), trajectory.first, 1.0,
        changes=[*case.announced(method, failures), *waypoint_changes(trajectory)],
        failures=failures).write_csv(tmp_path / 'offline.csv')
    flown = fly_over_ros(
        graph, tmp_path, case, 1.0, '--trajectory', str(path), *failure_words(failures))
    assert flown.read_bytes() == (tmp_path / 'offline.csv').read_bytes()


def test_a_short_flight(graph, tmp_path):
    case = Case.load('hexarotor', ['simulator.failures:=[2@0.1=0.3]'])
    path = tmp_path / 'goals.csv'
    path.write_text('t,x,y,z,heading\n0,1,0,1,0\n0.15,1,1,1,1.5\n')
    trajectory, failures = Trajectory.read(path), RotorFailures.read('2@0.1=0.3', 0.1)
    fly(
        case.controller(), case.allocator('exact'), case.plant(), trajectory.first, 0.3,
        changes=[*case.announced('exact', failures), *waypoint_changes(trajectory)],
    ).write_csv(tmp_path / 'offline.csv')
    # The failures of a file are announced, too.
    flown = fly_over_ros(graph, tmp_path, case, 0.3, '--trajectory', str(path))
    assert flown.read_bytes() == (tmp_path / 'offline.csv').read_bytes()
