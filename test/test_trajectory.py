"""Flights along several waypoints, offline and over the nodes."""

import json

import numpy as np
import pytest

from ca_ros import ParameterError
from ca_ros.control.trajectory import Trajectory
from ca_ros.simulation.closed_loop import fly, waypoint_changes
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic import study

SQUARE = """t,x,y,z,heading
0,1,0,1,0
2.5,1,1,1,1.5
5,0,1,1.5,-1.5
"""


@pytest.fixture
def square(tmp_path):
    path = tmp_path / 'square.csv'
    path.write_text(SQUARE)
    return path


def offline(trajectory, duration):
    case = Case.load('hexarotor')
    return fly(case.controller(), case.allocator('exact'), case.body(), trajectory.first, duration,
               changes=waypoint_changes(trajectory))


def test_each_waypoint_counts_from_its_time_on(square):
    trajectory = Trajectory.read(square)
    assert trajectory.times == (0, 2_500_000_000, 5_000_000_000)
    for time, x in ((0, 1.0), (2_499_999_999, 1.0), (2_500_000_000, 1.0), (5_000_000_000, 0.0)):
        assert trajectory.at(time).position[0] == x
    assert trajectory.at(2_500_000_000).heading == pytest.approx(1.5)
    positions, headings = trajectory.goals(np.array([0.0, 2.5, 9.0]))
    np.testing.assert_allclose(positions, [[1, 0, 1], [1, 1, 1], [0, 1, 1.5]])
    np.testing.assert_allclose(headings, [0.0, 1.5, -1.5])


def test_the_flight_follows_and_ends_at_the_last_one(square):
    trajectory = Trajectory.read(square)
    flight = offline(trajectory, 20.0)
    assert flight.position_error(trajectory.last) < 2e-3
    assert flight.heading_error(trajectory.last) < 1e-2
    # Until the second waypoint the flight is that to the first.
    alone = offline(Trajectory.to(trajectory.first), 2.5)
    np.testing.assert_array_equal(flight.position[:251], alone.position)
    assert np.abs(flight.position[:251, 1]).max() < 1e-9
    assert flight.position[500, 1] > 0.5


@pytest.mark.slow
def test_the_study_flies_it_or_to_an_own_waypoint_and_judges_the_end(
        square, tmp_path, monkeypatch):
    monkeypatch.setattr(study, 'draw', lambda *_: None)
    goal = ['--waypoint', '0.0', '0.0', '2.0', '--heading', '0.0']
    for where, x in ((['--trajectory', str(square)], 0.05), (goal, 1e-2)):
        assert study.main([
            *where, '--duration', '12', '--methods', 'exact', '--out', str(tmp_path)]) == 0
        found = json.loads((tmp_path / 'dynamic.json').read_text())
        assert abs(found['methods']['exact']['steady_state_error']['x']) < x
        # exact produces each commanded wrench, also those after the second waypoint.
        assert found['methods']['exact']['worst_force_residual'] < 1e-9
        assert found['command'][-len(where):] == where
    last = (tmp_path / 'dynamic.csv').read_text().splitlines()[-1].split(',')
    assert [float(x) for x in last[2:5]] == pytest.approx([0.0, 0.0, 2.0], abs=1e-2)


@pytest.mark.parametrize(('text', 'fault'), [
    ('', 'expected at least one row'),
    ('t,x,y,z\n0,1,1,1\n', 'expected a header and rows of numbers'),
    ('t,x,y,z,heading\n0,1,1,one,0\n', 'expected a header and rows of numbers'),
    ('t,x,y,z,heading\n0,1,1\n', 'expected a header and rows of numbers'),
    ('t,x,y,z,heading\n0,1,1,nan,0\n', 'of numbers up to 1e6'),
    ('t,x,y,z,heading\n1,1,1,1,0\n', 'times that begin at 0 and ascend'),
    ('t,x,y,z,heading\n0,1,1,1,0\n2,1,1,1,0\n2,0,0,0,0\n', 'times that begin at 0 and ascend'),
])
def test_a_wrong_file_is_named_in_one_line(text, fault, tmp_path):
    path = tmp_path / 'own.csv'
    path.write_text(text)
    with pytest.raises(ParameterError, match=fault) as caught:
        Trajectory.read(path)
    assert str(caught.value).startswith(str(path))
    assert '\n' not in str(caught.value)


def test_a_spreadsheet_may_add_a_mark_and_blanks(tmp_path):
    path = tmp_path / 'own.csv'
    path.write_text('\ufefft, x, y, z, heading\n0, 1, 2, 3, 0\n', encoding='utf-8')
    np.testing.assert_array_equal(Trajectory.read(path).last.position, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(('arguments', 'fault'), [
    (['--duration', '5'], 'the last waypoint counts from 5 s on, but --duration is 5 s'),
    (['--waypoint', '1', '1', '1'], '--trajectory: not with --waypoint'),
    (['--heading', '3'], '--trajectory: not with --waypoint'),
])
def test_a_trajectory_excludes_a_waypoint(arguments, fault, square, tmp_path, capsys):
    words = ['--trajectory', str(square), *arguments, '--out', str(tmp_path / 'out')]
    assert study.main(words) == 1
    assert fault in capsys.readouterr().err
