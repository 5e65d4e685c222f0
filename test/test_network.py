"""More than one host, and more than one vehicle."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from ca_ros.testing import DEADLINE
from nodes import fly_offline


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_three_hosts_fly_though_a_link_is_cut():
    run = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-rs', '-p', 'no:cacheprovider', 'three_hosts.py'],
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    if ' passed' not in run.stdout:
        pytest.skip(next(line for line in run.stdout.splitlines() if line.startswith('SKIPPED')))


FLIGHTS = {
    'uav1': ('exact', (1.0, 1.0, 1.0)), 'uav2': ('direct', (-1.0, 2.0, 1.5)),
    'uav3': ('pseudo_inverse', (2.0, -1.0, 2.0)), 'uav4': ('conventional', (-2.0, -2.0, 0.5)),
    'uav5': ('exact', (0.0, 0.0, 3.0))}
"""Method and waypoint of each vehicle."""

DURATION = 8.0
"""[s]"""


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_five_vehicles_in_one_graph_fly_as_offline_to_the_last_bit(graph, tmp_path):
    flights = {
        name: graph.start(
            'bringup', '--figures', 'none',
            '--namespace', name, '--mode', 'lockstep', '--duration', str(DURATION),
            '--method', method, '--out', str(tmp_path / name), '--waypoint', *map(str, goal))
        for name, (method, goal) in FLIGHTS.items()}
    for name, flight in flights.items():
        out, err = graph.outlive(flight, 4 * DEADLINE)
        assert flight.returncode == 0, f'{name}: {out}{err}'
        assert out.count('reached') == 1, f'{name}: {out}{err}'
        method, goal = FLIGHTS[name]
        offline = fly_offline(method, DURATION, (*goal, math.radians(45.0)))
        offline.write_csv(tmp_path / 'offline.csv')
        flown = (tmp_path / name / 'flight.csv').read_bytes()
        assert flown == (tmp_path / 'offline.csv').read_bytes(), name
    assert graph.alive() == []
