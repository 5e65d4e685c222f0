"""The dynamic study: Figures 2 to 4 of the paper, from one command."""

import csv
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ca_ros import Vehicle
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.audit import audit
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.record import Flight
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import PAPER, Case
from ca_ros.studies.dynamic import study as dynamic_study
from ca_ros.studies.dynamic.manoeuvres import median_of, share_of
from ca_ros.studies.dynamic.metrics import Flights, metrics, sample_errors
from ca_ros.studies.dynamic.plots import coinciding_groups
from ca_ros.studies.dynamic.study import main
from ca_ros.studies.dynamic.tables import observations
from strategies import HEXAROTOR, settings_of

WAYPOINT = Waypoint.of(1.0, 1.0, 1.0, math.radians(45.0))
HOVER = 255.73423
PLOTS = ('position.png', 'attitude.png', 'rotor_speeds.png')


def metrics_of(folder):
    return json.loads((folder / 'dynamic.json').read_text())


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    out = tmp_path_factory.mktemp('dynamic')
    assert main(['--out', str(out)]) == 0
    return out


@pytest.fixture
def plain(monkeypatch):
    """Draw no plots: they take longer than all the rest."""
    monkeypatch.setattr(dynamic_study, 'draw', lambda *_: None)


def test_the_paper_s_observations_hold(study):
    """Section 4: in steady state, the last second."""
    flown = {method: [] for method in PAPER}
    with (study / 'dynamic.csv').open() as file:
        for row in csv.DictReader(file):
            if float(row['t']) >= 9.0:
                flown[row['method']].append(
                    [float(row[name]) for name in ('z', *(f'speed_{i}' for i in range(1, 7)))])
    flown = {method: np.array(rows) for method, rows in flown.items()}
    height = {method: abs(1.0 - rows[:, 0].mean()) for method, rows in flown.items()}
    assert height.pop('conventional') > 1e-3
    # With the gains of the file, 0.04 mm of the step are left.
    assert max(height.values()) < 1e-3
    speeds = {method: rows[:, 1:] for method, rows in flown.items()}
    np.testing.assert_array_equal((speeds.pop('direct') > 399.5).sum(axis=1), 2)
    for method, found in speeds.items():
        # What does not change the first decimal.
        np.testing.assert_allclose(found, HOVER, atol=0.05, err_msg=method)


def test_the_metrics_are_those_of_the_paper_s_flights(study):
    methods = metrics_of(study)['methods']
    assert tuple(methods) == PAPER
    error = {name: found['steady_state_error'] for name, found in methods.items()}
    # The thrust is u / (1 + q), so hover takes a height error of q g / k_p.
    assert error['conventional']['z'] == pytest.approx(9.1e-4 * 9.81 / 1.5, abs=1e-4)
    for name in set(methods) - {'conventional'}:
        assert abs(error[name]['z']) < 1e-4
    for name, found in methods.items():
        assert found['overshoot']['z'] == 0.0
        assert all(2.0 < time < 6.0 for time in found['settling_time'].values())
        assert max(map(abs, error[name].values())) < 1e-2
    assert methods['direct']['effort'] > 2.0 * methods['exact']['effort']
    assert methods['direct']['time_at_bound'] > 0.3
    assert methods['exact']['time_at_bound'] == 0.0
    assert methods['exact']['worst_force_residual'] < 1e-12
    assert methods['conventional']['worst_force_residual'] == pytest.approx(1e-2, rel=0.2)


def test_the_rows_are_those_of_the_closed_loop(study):
    with (study / 'dynamic.csv').open(newline='') as file:
        rows = list(csv.reader(file))
    assert rows[0][:8] == ['method', 't', 'x', 'y', 'z', 'roll', 'pitch', 'yaw']
    assert rows[0][8:14] == [f'speed_{i}' for i in range(1, 7)]
    assert [row[0] for row in rows[1::1001]] == list(PAPER)
    assert len(rows) == 1 + len(PAPER) * 1001
    case = Case.load('hexarotor')
    for k, name in ((0, 'exact'), (2, 'conventional')):
        flight = fly(
            Controller(HEXAROTOR, case.flown.controller), case.allocator(name),
            RigidBody(HEXAROTOR), WAYPOINT, 10.0)
        values = np.array([row[1:] for row in rows[1 + 1001 * k:1 + 1001 * (k + 1)]], dtype=float)
        # Not to the last bit: a method in another state may round otherwise.
        np.testing.assert_allclose(
            values, np.column_stack(list(flight.columns().values())), atol=1e-9)


def test_the_plots_are_drawn(study):
    for name in PLOTS:
        assert (study / name).stat().st_size > 50_000


# The numbers, by hand

def flight_of(height, speeds, step=0.1):
    """A flight straight up, of given heights (K,) and speeds (K, n)."""
    count = len(height)
    zeros = np.zeros((count, 3))
    return Flight(
        step * np.arange(count), np.column_stack([zeros[:, :2], height]),
        np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), zeros, zeros, np.asarray(speeds, dtype=float))


def test_methods_share_a_curve_only_if_their_errors_in_the_last_second_do():
    rising = np.clip(np.linspace(0.0, 2.0, 31), 0.0, 1.0)
    speeds = np.linspace(200.0, 250.0, 31)[:, None] * np.ones(6)
    flights = {
        name: flight_of(top * rising, speeds) for name, top in
        {'exact': 1.0, 'conventional': 0.994, 'direct': 1.0, 'lost': 0.5}.items()}
    goal = Trajectory.to(Waypoint.of(0.0, 0.0, 1.0, 0.0))
    found = Flights(flights, {}, HEXAROTOR, goal, RotorFailures())
    assert coinciding_groups(found) == [['exact', 'conventional', 'direct'], ['lost']]
    del flights['lost']
    assert coinciding_groups(found, last_second=True) == [['exact', 'direct'], ['conventional']]


def test_metrics_of_a_flight_made_by_hand():
    height = np.concatenate([[0.0, 0.5, 1.25, 0.9, 1.019], np.full(26, 1.01)])
    speeds = np.full((31, 6), 200.0)
    speeds[:, 0], speeds[10:, 1] = 400.0, 40.1
    controller = Controller(HEXAROTOR, settings_of({}).controller)
    flight, waypoint = flight_of(height, speeds), Waypoint.of(0.0, 0.0, 1.0, 0.0)
    found = metrics(flight, sample_errors(flight, controller, waypoint), waypoint)
    assert found['steady_state_error'] == pytest.approx({'x': 0, 'y': 0, 'z': -0.01, 'yaw': 0})
    assert found['settling_time'] == pytest.approx({'x': 0.0, 'y': 0.0, 'z': 0.4, 'yaw': 0.0})
    assert found['overshoot'] == pytest.approx({'x': 0.0, 'y': 0.0, 'z': 0.25, 'yaw': 0.0})
    # 30 intervals of 0.1 s with 4 N on rotor 1, 1 N on four, and on rotor 2 first 1 N.
    assert found['effort'] == pytest.approx(
        3.0 * (16.0 + 4.0) + 1.0 + 2.0 * (2.5e-5 * 40.1**2) ** 2)
    assert found['time_at_bound'] == pytest.approx((31 + 21) / (6 * 31))
    # The same with f^1.5; 1 N and 4 N are 1 and 8 N^1.5.
    last = 2.5e-5 * 40.1**2
    assert found['energy'] == pytest.approx(3.0 * (8.0 + 4.0) + 1.0 + 2.0 * last**1.5)
    # One change, of rotor 2 from 1 N, in 3 s.
    assert found['smoothness'] == pytest.approx((1.0 - last) / 3.0)
    assert (found['recovered'], found['height_lost']) == (True, 0.0)


def test_height_is_lost_below_the_lower_of_start_and_waypoint():
    controller = Controller(HEXAROTOR, settings_of({}).controller)
    flight = flight_of([2.0, -1.5, 0.4, 0.4, 0.4], np.full((5, 6), HOVER))
    for height, drop, recovered in ((0.0, 1.5, False), (0.2, 1.7, True), (3.0, 3.5, False)):
        waypoint = Waypoint.of(0.0, 0.0, height, 0.0)
        found = metrics(flight, sample_errors(flight, controller, waypoint), waypoint)
        assert found['height_lost'] == pytest.approx(drop)
        assert found['recovered'] is recovered


def test_observations_are_said_of_each_method(tmp_path, plain):
    command = ['--vehicle', 'x8', '--methods', 'exact,direct', '--duration', '1']
    assert main([*command, '--out', str(tmp_path)]) == 0
    found = metrics_of(tmp_path)
    assert [line.split('`')[1] for line in found['observations']] == ['exact', 'direct']
    text = (tmp_path / 'dynamic.md').read_text()
    assert '- With `exact` the flight ends ' in text
    assert 'paper' not in text


@pytest.mark.parametrize('problem', ['admire', 'omnidirectional_hexarotor'])
def test_a_problem_without_a_vehicle_does_not_fly(problem, tmp_path, capsys):
    assert main(['--vehicle', problem, '--out', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith('dynamic_study: ')
    assert 'a problem without a vehicle' in err
    assert err.count('\n') == 1


def test_what_never_settles_says_so():
    controller = Controller(HEXAROTOR, settings_of({}).controller)
    flight = flight_of(np.linspace(0.0, 0.9, 31), np.full((31, 6), HOVER))
    waypoint = Waypoint.of(0.0, 0.0, 1.0, 0.0)
    found = metrics(flight, sample_errors(flight, controller, waypoint), waypoint)
    assert found['settling_time']['z'] is None


# Vehicles, methods and mistakes

@pytest.mark.parametrize(('failure', 'said'), [
    (['--fail', '2@1', '--announce', 'never'], r'`exact` rotor 2 at 1\.0\d s\.'),
    ([], r'`exact` none\.'),
])
def test_what_was_detected_is_said(tmp_path, plain, failure, said):
    words = ['--methods', 'exact', '--duration', '1.2', '--detect', '--out', str(tmp_path)]
    assert main([*words, *failure]) == 0
    assert re.search(f'^Detected: {said}$', (tmp_path / 'dynamic.md').read_text(), re.MULTILINE)


def test_a_stuck_servo_is_drawn_without_a_margin_and_leaves_a_yaw_torque(tmp_path, capsys):
    words = ['--vehicle', 'tricopter', '--duration', '0.3']
    assert main([*words, '--fail', '2@0.1=0.05rad', '--out', str(tmp_path)]) == 0
    assert (tmp_path / 'failure.png').exists()
    notes = capsys.readouterr().err.splitlines()
    assert [note.split(': ')[0] for note in notes] == [
        'conventional is left out', 'direct is left out']
    report = audit(Vehicle.load('tricopter').with_stuck_servos([2.0, 0.05]))
    # By hand: roll makes T_1 = T_3, thrust and pitch the tail's T; the drag of a rotor is 0.02 m.
    c, s = math.cos(0.05), math.sin(0.05)
    tail = 0.15 * 1.2 * 9.81 / (0.45 * c - 0.02 * s)
    assert report.spin_torque == pytest.approx(-tail * (0.3 * s + 0.02 * c), rel=1e-9)


def test_parameters_can_be_changed(tmp_path, plain):
    command = ['--methods', 'conventional', '--out', str(tmp_path)]
    assert main([*command, '-p', 'allocation.conventional.reference:=hover']) == 0
    # As docs/reproduction.md says: with f_ref at hover there is no error in steady state.
    error = metrics_of(tmp_path)['methods']['conventional']['steady_state_error']
    assert abs(error['z']) < 1e-4
    assert main([*command, '-p', 'simulator.time_step:=0.02', '--duration', '1']) == 0
    assert len((tmp_path / 'dynamic.csv').read_text().splitlines()) == 52
    # 1 / 0.015 = 66.7: the last of 67 samples is at 0.99 s.
    assert main([*command, '-p', 'simulator.time_step:=0.015', '--duration', '1']) == 0
    assert len((tmp_path / 'dynamic.csv').read_text().splitlines()) == 68


def test_a_flight_that_diverges_ends_it_in_one_line(tmp_path, capsys):
    assert main([
        '--methods', 'exact', '-p', 'simulator.time_step:=1e4', '--duration', '1e9',
        '--out', str(tmp_path)]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith('dynamic_study: ')


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--methods', 'exakt'], "no method 'exakt'"),
    (['-p', 'rotors.health:=[0, 1, 1, 1, 1, 1]'], 'this vehicle is refused: yaw lost'),
    (['--vehicle', 'tricopter', '--methods', 'exact', '--plot-rows', 'margin'], 'do not tilt'),
])
def test_what_is_wrong_is_said_in_one_line(arguments, words, tmp_path, capsys):
    assert main([*arguments, '--out', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith('dynamic_study: ')
    assert words in err
    assert err.count('\n') == 1


# Rotor failures

@pytest.fixture(scope='module')
def failing(tmp_path_factory):
    out = tmp_path_factory.mktemp('failing')
    command = ['--fail', '1@4', '--fail', '2@4.5=0.9', '--duration', '10', '--out', str(out)]
    assert main([*command, '--methods', 'exact,fixed_pseudo_inverse']) == 0
    return out


def test_failures_are_flown_by_all_methods_and_drawn(failing):
    written = metrics_of(failing)
    assert written['failures'][:4] == ['--fail', '1@4', '--fail', '2@4.5=0.9']
    assert written['lost_axes'] == ['yaw']
    again = dynamic_study._parse(written['command'][1:])
    assert [(each.rotor, each.time, each.health) for each in again.fail] == [
        (1, 4.0, 0.0), (2, 4.5, 0.9)]
    assert again.methods == 'exact,fixed_pseudo_inverse'
    for name, found in written['methods'].items():
        error = math.hypot(*(found['steady_state_error'][axis] for axis in 'xyz'))
        assert (error < 0.05) == (name != 'fixed_pseudo_inverse')
        assert found['greatest_tilt'] > math.radians(8.0)
        # Until it is announced, what rotor 1 gives is missing.
        assert 1.0 < found['worst_force_residual'] < 10.0
    text = (failing / 'dynamic.md').read_text()
    assert '`--fail 1@4 --fail 2@4.5=0.9 --announce 0.1`. Lost axes at the end: yaw.' in text
    for name, found in written['methods'].items():
        # Yaw is given up, and the vehicle spins: no heading has an error.
        rate = found['heading_rate']
        assert abs(rate) > 0.5
        assert [found[metric]['yaw'] for metric in
                ('steady_state_error', 'settling_time', 'overshoot')] == [None] * 3
        assert f'given up, turns at {rate:.2f} rad/s' in text
        line = f'With `{name}` the flight ends '
        [said] = [each for each in written['observations'] if each.startswith(line)]
        assert said.endswith(f', the heading is given up, the vehicle turns at {rate:.2f} rad/s.')
    assert 'mean of goal minus value' in text
    assert (failing / 'failure.png').stat().st_size > 50_000


def test_a_heading_that_turns_has_no_error_even_if_it_is_not_known_to_be_lost():
    flight = flight_of(np.ones(31), np.full((31, 6), 250.0))
    # 8.4 rad/s: the mean of the wrapped errors of the last second would be small.
    half = 8.4 * flight.time / 2.0
    turns = np.column_stack([np.zeros((31, 2)), np.sin(half), np.cos(half)])
    goal = Waypoint.of(0.0, 0.0, 1.0, 0.0)
    spinning = replace(flight, attitude=turns)
    samples = sample_errors(spinning, Case.load('hexarotor').controller(), goal)
    found = metrics(spinning, samples, goal)
    assert found['heading_rate'] == pytest.approx(8.4)
    assert found['steady_state_error']['yaw'] is None
    assert list(observations({'exact': spinning}, goal)) == [
        'With `exact` the flight ends 0 m from the waypoint, the vehicle turns at 8.40 rad/s.']


def test_the_margin_is_that_of_the_rotors_as_they_are():
    case, failures = Case.load('hexarotor'), RotorFailures((RotorFailure(1, 0.5),), 0.1)
    changes = case.announced('exact', failures)
    hover = Waypoint.of(0.0, 0.0, 0.0, 0.0)
    flight = fly(
        case.controller(), case.allocator('exact'), case.body(), hover, 1.0, changes=changes,
        failures=failures)
    found = sample_errors(flight, case.controller(), hover, changes, failures=failures)
    found = found['margin'].to_numpy()
    # Hover: 0.191 inside; then outside, as nobody knows; then on the boundary.
    np.testing.assert_allclose(found[:50], audit(case.vehicle).hover_margin, atol=1e-9)
    assert np.all(found[50:60] < 0.0)
    assert np.all(found[60:] > -1e-9)


@pytest.mark.parametrize('name', ['tricopter', 'omnidirectional_gimbals'])
def test_the_wrench_of_rotors_that_tilt_is_that_of_their_angles(name):
    case, goal = Case.load(name), Waypoint.of(0.1, 0.2, 0.3, 0.5)
    flight = fly(case.controller(), case.allocator('exact'), case.body(), goal, 0.1)
    samples = sample_errors(flight, case.controller(), goal)
    assert samples[['force_error', 'torque_error']].to_numpy().max() < 1e-9
    turned = replace(flight, angles=flight.angles + 0.1)
    assert sample_errors(turned, case.controller(), goal)['torque_error'].min() > 0.01


def test_manoeuvres_are_the_same_for_each_method_and_have_intervals(tmp_path):
    words = ['--manoeuvres', 'upsets', '--seeds', '2', '--out', str(tmp_path)]
    assert main([*words, '--methods', 'exact,pseudo_inverse']) == 0
    with (tmp_path / 'manoeuvres.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert [(row['seed'], row['method']) for row in rows] == [
        (seed, method) for seed in '01' for method in ('exact', 'pseudo_inverse')]
    assert [row['recovered'] for row in rows if row['method'] == 'exact'] == ['1', '1']
    # Less height lost in each of the two, and another one with each seed.
    heights = np.array([float(row['height_lost']) for row in rows]).reshape(2, 2)
    assert (heights[:, 0] < heights[:, 1]).all()
    assert heights[0, 0] != heights[1, 0]
    assert '2 of 2 (34% to 100%)' in (tmp_path / 'manoeuvres.md').read_text()
    command = json.loads((tmp_path / 'manoeuvres.json').read_text())['command']
    assert dynamic_study._parse(command[1:]).seeds == 2


def test_intervals_of_shares_and_medians():
    # Wilson's interval for 5 of 10, as in textbooks, and its ends.
    np.testing.assert_allclose(share_of(5, 10), (0.2366, 0.7634), atol=1e-4)
    np.testing.assert_allclose(share_of(0, 10), (0.0, 0.2775), atol=1e-4)
    # Of 100 values the 41st and the 60th.
    assert median_of(np.arange(1.0, 101.0)) == (50.5, 41.0, 60.0)


@pytest.mark.parametrize(('words', 'error'), [
    ('--manoeuvres flips', "--manoeuvres: 'flips': expected upsets, "),
    ('--seeds 0', "argument --seeds: '0' is not a positive whole number"),
    ('--seeds 50', '--seeds: only with --manoeuvres'),
    ('--manoeuvres upsets --detect --fail 1@2', 'not with --detect, --fail'),
    ('--manoeuvres upsets --duration 10 --plot-rows tilt --figures png',
     'not with --duration, --figures, --plot-rows'),
    ('--manoeuvres upsets --announce never --waypoint 1 1 1', 'not with --announce, --waypoint'),
    ('--view', 'unrecognized arguments: --view')])
def test_options_that_would_be_ignored_are_refused(words, error, capsys):
    with pytest.raises(SystemExit):
        main(words.split())
    assert error in capsys.readouterr().err.splitlines()[-1]
