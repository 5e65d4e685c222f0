"""More than one host, and more than one vehicle."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from ca_ros import Vehicle, make_allocator
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller, Gains
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.parameters import load
from ros import DEADLINE


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_three_hosts_fly_though_a_link_is_cut():
    run = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-rs', '-p', 'no:cacheprovider', 'three_hosts.py'],
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    if ' passed' not in run.stdout:
        pytest.skip(next(line for line in run.stdout.splitlines() if line.startswith('SKIPPED')))


# Five vehicles

WAYPOINTS = [
    (1.0, 1.0, 1.0), (-1.0, 2.0, 1.5), (2.0, -1.0, 2.0), (-2.0, -2.0, 0.5), (0.0, 0.0, 3.0)]
DURATION = 8.0
"""[s]"""


def offline(waypoint):
    """Return the flight to a waypoint without ROS, and without other vehicles."""
    vehicle = Vehicle.load('hexarotor')
    return fly(
        Controller(vehicle, Gains.from_parameters(load('hexarotor'))),
        make_allocator('exact', vehicle), RigidBody(vehicle),
        Waypoint.of(*waypoint, math.radians(45.0)), DURATION)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_five_vehicles_in_one_graph_fly_as_if_each_were_alone(graph, tmp_path):
    names = [f'uav{i}' for i in range(1, 6)]
    flights = {
        name: graph.start_silent(
            'bringup', '--namespace', name, '--mode', 'lockstep', '--duration', str(DURATION),
            '--out', str(tmp_path / name), '--waypoint', *map(str, waypoint))
        for name, waypoint in zip(names, WAYPOINTS, strict=True)}

    for (name, flight), waypoint in zip(flights.items(), WAYPOINTS, strict=True):
        out, err = graph.outlive(flight, 4 * DEADLINE)
        assert out.count('reached') == 1, f'{name}: {out}{err}'
        offline(waypoint).write_csv(tmp_path / 'offline.csv')
        flown = (tmp_path / name / 'flight.csv').read_bytes()
        assert flown == (tmp_path / 'offline.csv').read_bytes(), name
    assert graph.alive() == []
