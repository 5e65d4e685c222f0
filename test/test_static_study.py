"""The static study: Table 1 of the paper, from one command."""

import csv
import json
import os
import re
import sys

import numpy as np
import pandas as pd
import pytest

from ca_ros import (
    AdmissibleSet,
    AllocationProblem,
    CaRosError,
    ParameterError,
    Status,
    Vehicle,
)
from ca_ros.allocation import ALLOCATORS
from ca_ros.arguments import split
from ca_ros.studies.cases import PAPER, Case
from ca_ros.studies.errors import evaluate
from ca_ros.studies.result_files import write
from ca_ros.studies.static import study as static_study
from ca_ros.studies.static.study import main
from ca_ros.studies.wrench_sets import SAMPLINGS, samples
from ca_ros.vehicle.files import config_directory
from strategies import length

SHIPPED = sorted(path.stem for path in config_directory().glob('*.yaml'))
PLOTS = ('errors.png', 'latency.png', 'slices.png', 'violations.png')


def test_a_metric_that_is_not_finite_is_null_in_json(tmp_path):
    worst = {'worst': [-np.inf, np.nan, 1.0]}
    write(tmp_path / 'study', pd.DataFrame({'a': [1.0]}), worst, '')
    text = (tmp_path / 'study.json').read_text()
    assert json.loads(text, parse_constant=pytest.fail) == {'worst': [None, None, 1.0]}


def rows_of(folder):
    with (folder / 'static.csv').open(newline='') as file:
        return list(csv.DictReader(file))


def metrics_of(folder):
    return json.loads((folder / 'static.json').read_text())


def numbers(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    out = tmp_path_factory.mktemp('static')
    assert main(['--samples', '1000', '--seed', '0', '--out', str(out)]) == 0
    return out


@pytest.fixture
def plain(monkeypatch):
    """Draw no plots: they take longer than all the rest."""
    monkeypatch.setattr(static_study, 'draw', lambda *_: None)


# The paper's table

def test_the_metrics_are_those_of_the_paper(study):
    methods = metrics_of(study)['methods']
    pseudo_inverse, conventional = methods['pseudo_inverse'], methods['conventional']
    assert abs(pseudo_inverse['violations'] - 519) <= 48
    assert abs(pseudo_inverse['force_error']['mean'] - 0.17) <= 0.02
    assert abs(pseudo_inverse['torque_error']['mean'] - 0.063) <= 0.007
    assert abs(conventional['force_error']['mean'] - 1.1e-2) <= 0.1e-2
    assert abs(conventional['force_error']['max'] - 2.0e-2) <= 0.3e-2
    assert conventional['torque_error']['mean'] < 1e-6
    for name, force, torque in (
            ('exact', 1.7e-9, 4.5e-10), ('direct', 1e-13, 1e-13)):
        assert methods[name]['force_error']['max'] < force
        assert methods[name]['torque_error']['max'] < torque
    for name in ('exact', 'conventional', 'direct'):
        assert methods[name]['violations'] == 0


def test_the_rows_are_true(study):
    """Every row says what its own thrusts give."""
    rows, vehicle = rows_of(study), Vehicle.load('hexarotor')
    assert list(rows[0]) == [
        'sample', 'method', 'thrust', 'tau_x', 'tau_y', 'tau_z', *(f'f_{i}' for i in range(1, 7)),
        'violated', 'force_error', 'torque_error', 'time', 'status']
    assert [(int(row['sample']), row['method']) for row in rows] == [
        (i, method) for i in range(1000) for method in PAPER]
    admissible = AdmissibleSet(vehicle)
    u = numbers(rows, 'thrust', 'tau_x', 'tau_y', 'tau_z')
    assert admissible.margin(u).min() > -1e-12
    thrusts = numbers(rows, *(f'f_{i}' for i in range(1, 7)))
    assert np.all((thrusts >= vehicle.thrust_min) & (thrusts <= vehicle.thrust_max))
    residual = u - thrusts @ admissible.problem.gamma.T
    force, torque = numbers(rows, 'force_error', 'torque_error').T
    np.testing.assert_allclose(force, np.abs(residual[:, 0]), atol=1e-13)
    np.testing.assert_allclose(torque, np.linalg.norm(residual[:, 1:], axis=1), atol=1e-13)
    wanted = u @ np.linalg.pinv(admissible.problem.gamma).T
    outside = np.any((wanted < 0.04 - 1e-9) | (wanted > 4.0 + 1e-9), axis=1)
    assert [row['violated'] == '1' for row in rows] == [
        bool(bad) and row['method'] == 'pseudo_inverse'
        for row, bad in zip(rows, outside, strict=True)]
    exact = [Status[row['status']] is Status.EXACT for row in rows]
    np.testing.assert_array_equal(exact, np.linalg.norm(residual, axis=1) < 1e-11)


def test_the_metrics_are_those_of_the_rows(study):
    rows, written = rows_of(study), metrics_of(study)
    assert (written['samples'], written['seed'], written['sampling']) == (1000, 0, 'volume')
    assert written['command'] == [
        'static_study', '--vehicle', 'hexarotor', '--methods', 'paper', '--samples', '1000',
        '--seed', '0', '--sampling', 'volume']
    assert {'python', 'numpy', 'scipy', 'ca_ros'} <= set(written['versions'])
    assert {'processor', 'cores', 'system'} <= set(written['machine'])
    assert tuple(written['methods']) == PAPER
    for name, found in written['methods'].items():
        own = [row for row in rows if row['method'] == name]
        assert found['violations'] == sum(row['violated'] == '1' for row in own)
        for key in ('force_error', 'torque_error', 'time'):
            values = numbers(own, key)[:, 0]
            assert found[key]['mean'] == pytest.approx(values.mean(), rel=1e-12)
            assert found[key]['max'] == values.max()
        assert found['time']['median'] == pytest.approx(np.median(values), rel=1e-12)
        assert found['time']['p99'] == pytest.approx(np.percentile(values, 99), rel=1e-12)
        assert 0.0 < found['time']['median'] <= found['time']['p99'] <= found['time']['max']


def test_the_table_has_a_row_of_each_method(study):
    text = (study / 'static.md').read_text()
    for words in (
            '`pseudo_inverse` | 516 ± 16 of 1000',
            '`conventional` | 0 of 1000 | 1.1e-02 / 2.0e-02',
            '`exact` produces 1000 of 1000 wrenches'):
        assert words in text
    for name in PLOTS:
        assert (study / name).stat().st_size > 20_000


# Any size, any order

@pytest.mark.parametrize('sampling', SAMPLINGS)
def test_a_sample_depends_on_seed_and_number_alone(sampling):
    admissible = AdmissibleSet(Vehicle.load('hexarotor'))
    whole = samples(admissible, sampling, 3, 0, 2500)
    parts = [samples(admissible, sampling, 3, *ends)
             for ends in ((0, 1), (1, 999), (999, 2001), (2001, 2500))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    distance = admissible.problem.attainable_set.gauge(whole)
    if sampling == 'boundary':
        np.testing.assert_allclose(distance, 1.0, atol=1e-12)
    elif sampling == 'outside':
        # Uniform from once to twice the distance of the boundary.
        assert 1.0 < distance.min() < 1.01
        assert 1.99 < distance.max() <= 2.0
        assert distance.mean() == pytest.approx(1.5, abs=0.02)
        assert not admissible.contains(whole).any()
    else:
        assert distance.max() < 1.0
    # Uniform by volume: the share within a copy of the set at half its size is 1 / 2^4.
    inner = (distance < 0.5).mean()
    assert inner == pytest.approx(
        {'volume': 0.0625, 'thrusts': 0.27, 'boundary': 0.0, 'outside': 0.0}[sampling], abs=0.03)


def test_batches_give_what_single_calls_give(study, tmp_path, monkeypatch, plain):
    monkeypatch.setattr(static_study, 'SINGLE_MAX', 100)
    monkeypatch.setattr(static_study, 'BATCH', 50)
    assert main(['--samples', '200', '--out', str(tmp_path)]) == 0
    batch = rows_of(tmp_path)
    single = rows_of(study)[:len(batch)]
    assert [(row['sample'], row['method'], row['violated'], row['status']) for row in batch] == [
        (row['sample'], row['method'], row['violated'], row['status']) for row in single]
    names = [f'f_{i}' for i in range(1, 7)]
    np.testing.assert_allclose(numbers(batch, *names), numbers(single, *names), atol=1e-9)
    assert metrics_of(tmp_path)['timing'] == 'batches of 50'
    # A wrench's time is its share of its batch.
    assert len({row['time'] for row in batch if row['method'] == 'exact'}) <= 4


# Ctrl-C

@pytest.fixture
def interrupting(tmp_path, monkeypatch):
    """A method that sends the study a Ctrl-C at its 250th call."""
    (tmp_path / 'interrupting.py').write_text("""
import os, signal
from ca_ros.allocation.pseudo_inverse import PseudoInverse

calls = 0

class Interrupting(PseudoInverse):
    def _allocate(self, u):
        global calls
        calls += 1
        if calls == 250:
            os.kill(os.getpid(), signal.SIGINT)
        return super()._allocate(u)
""")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'interrupting', raising=False)
    return 'exact,interrupting:Interrupting'


def test_an_interrupted_study_ends_in_one_line_and_writes_nothing(
        interrupting, tmp_path, capsys, plain):
    out = tmp_path / 'out'
    assert main(['--methods', interrupting, '--samples', '900', '--out', str(out)]) == 130
    # Another thread computes: chunks that are done may not have been counted yet.
    assert re.fullmatch(
        r'static_study: interrupted after [012] of 9 chunks\n', capsys.readouterr().err)
    assert list(out.iterdir()) == []


# Other vehicles and methods

@pytest.mark.parametrize('vehicle', length(['hexarotor', 'rov'], SHIPPED))
def test_every_shipped_vehicle(vehicle, tmp_path, plain):
    assert main(['--vehicle', vehicle, '--samples', '40', '--out', str(tmp_path)]) == 0
    problem = AdmissibleSet(Vehicle.load(vehicle)).problem
    names = {'roll': 'tau_x', 'pitch': 'tau_y', 'yaw': 'tau_z'}
    header = list(rows_of(tmp_path)[0])
    assert header[2:2 + len(problem.axes)] == [names.get(axis, axis) for axis in problem.axes]
    methods = metrics_of(tmp_path)['methods']
    for key in ('force_error', 'torque_error'):
        assert methods['exact'][key]['max'] < 1e-12
        assert methods['direct'][key]['max'] < 1e-12


@pytest.mark.long
@pytest.mark.parametrize(
    'axes', ['[thrust, roll]', '[force_x, force_y, thrust, roll, pitch, yaw]'])
def test_a_vehicle_with_other_axes_is_drawn(axes, tmp_path):
    assert main([
        '--vehicle', 'hexarotor_tilted', '-p', f'allocation.axes:={axes}', '--samples', '20',
        '--out', str(tmp_path)]) == 0
    assert ('tau_y' in rows_of(tmp_path)[0]) is ('pitch' in axes)
    assert ('force_x' in rows_of(tmp_path)[0]) is ('force_x' in axes)
    assert (tmp_path / 'violations.png').stat().st_size > 20_000


@pytest.mark.slow
def test_plain_osqp_shows_what_the_finish_is_for(tmp_path, plain):
    pytest.importorskip('osqp')
    command = ['--samples', '300', '--methods', 'exact,osqp,osqp_tight']
    for sampling, least in (('volume', 40), ('boundary', 150)):
        assert main([*command, '--sampling', sampling, '--out', str(tmp_path)]) == 0
        methods = metrics_of(tmp_path)['methods']
        assert methods['osqp']['violations'] > least
        assert methods['osqp']['violation_max'] > 1e-3
        assert 1e-10 < methods['osqp_tight']['force_error']['max'] < 1e-5
        assert methods['exact']['violation_max'] == 0.0
        assert methods['exact']['status'] == {'EXACT': 300}


# Problems without a vehicle

@pytest.mark.slow
def test_a_problem_has_the_names_of_its_axes_and_one_error(tmp_path, plain):
    command = ['--vehicle', 'admire', '--methods', 'all', '--samples', '60']
    assert main([*command, '--out', str(tmp_path)]) == 0
    rows, problem = rows_of(tmp_path), AllocationProblem.load('admire')
    assert list(rows[0]) == [
        'sample', 'method', 'roll', 'pitch', 'yaw', 'f_1', 'f_2', 'f_3', 'f_4', 'violated',
        'error', 'time', 'status']
    u = numbers(rows, 'roll', 'pitch', 'yaw')
    residual = u - numbers(rows, 'f_1', 'f_2', 'f_3', 'f_4') @ problem.gamma.T
    np.testing.assert_allclose(
        numbers(rows, 'error')[:, 0], np.linalg.norm(residual, axis=1), atol=1e-13)
    found = metrics_of(tmp_path)
    assert set(found['left_out']) == {'sequential_desaturation', 'betaflight_mixer'}
    assert set(found['methods']) == set(ALLOCATORS) - set(found['left_out'])
    assert found['methods']['exact']['error']['max'] < 1e-13
    # Energy is a law of rotors.
    assert 'energy' not in found['methods']['exact']
    text = (tmp_path / 'static.md').read_text()
    assert '`betaflight_mixer`: betaflight_mixer is for multirotors' in text
    assert '`exact` produces 60 of 60 wrenches' in text
    assert '[N]' not in text
    assert 'paper' not in text


@pytest.mark.slow
def test_rotors_that_tilt_are_studied(tmp_path):
    command = ['--vehicle', 'azimuth_boat', '--methods', 'exact,pseudo_inverse', '--samples', '40']
    assert main([*command, '--out', str(tmp_path)]) == 0
    found = metrics_of(tmp_path)['methods']
    assert found['exact']['violations'] == 0
    assert found['pseudo_inverse']['violations'] > 0
    assert (tmp_path / 'violations.png').stat().st_size > 20_000
    admissible = AdmissibleSet(Vehicle.load('azimuth_boat'))
    wrenches = samples(admissible, 'boundary', 0, 0, 20)
    np.testing.assert_allclose(admissible.problem.attainable_set.gauge(wrenches), 1.0, atol=1e-8)
    for share, inside in ((0.999, True), (1.001, False)):
        moved = admissible.center + share * (wrenches - admissible.center)
        assert (admissible.contains(moved) == inside).all()
    with pytest.raises(ParameterError, match='sampling thrusts'):
        samples(admissible, 'thrusts', 0, 0, 20)


def test_a_problem_of_any_names_is_drawn_and_takes_options_of_its_file(tmp_path):
    file = tmp_path / 'plane.yaml'
    file.write_text("""
problem:
  matrix: [[1, 1, 0], [0, 1, 1]]
  lower: -1
  upper: [1, 2, 3]
allocation: {exact: {policy: scale}}
""")
    command = ['--vehicle', str(file), '--samples', '30', '--sampling', 'outside']
    assert main([*command, '--out', str(tmp_path)]) == 0
    assert list(rows_of(tmp_path)[0])[2:4] == ['axis_1', 'axis_2']
    found = metrics_of(tmp_path)
    assert found['methods']['exact']['status'] == {'SCALED': 30}
    assert found['methods']['exact']['reversed'] == 0.0
    assert (tmp_path / 'slices.png').stat().st_size > 20_000


class Bare:
    """No subclass of ours, and it does not say that its thrusts are out of bounds."""

    def __init__(self, vehicle):
        self.vehicle = vehicle

    def allocate(self, u):
        return type('Answer', (), {
            'thrusts': np.full(6, 5.0), 'violation': 0.0, 'status': Status.EXACT})


def test_a_method_is_judged_by_the_problem_s_data():
    case = Case.load('hexarotor')
    problem = AdmissibleSet(case.vehicle).problem
    for batch in (False, True):
        found = evaluate('bare', Bare(case.vehicle), problem, problem.hover[None], batch)
        assert found.violated.tolist() == [True]
        assert found.violation[0] == pytest.approx(1.0)
        assert found.force_error[0] == pytest.approx(30.0 - 9.81)


def test_answers_that_are_none_are_reported():
    case = Case.load('hexarotor')
    problem = AdmissibleSet(case.vehicle).problem
    for answer, words in (
            (np.zeros(6), 'an Allocation'),
            (type('A', (), {'thrusts': np.zeros(5), 'violation': 0.0, 'status': 0}), 'thrusts')):
        method = type('Method', (), {'allocate': lambda self, u, answer=answer: answer})()
        with pytest.raises(CaRosError, match=f'mine: .*{words}'):
            evaluate('mine', method, problem, problem.hover[None], batch=False)


# The command line

@pytest.mark.parametrize(('arguments', 'code', 'words'), [
    (['--vehicle', 'nowhere'], 1, 'nowhere: neither a file nor a shipped vehicle'),
    (['--methods', 'exakt'], 1, r"no method 'exakt'; did you mean exact\?; there are exact"),
    (['--vehicle', 'admire', '--methods', 'betaflight_mixer'], 1, 'is for multirotors'),
    (['--vehicle', 'admire', '-p', 'vehicle.mass:=1'], 1, 'vehicle.mass: no such parameter'),
    (['--vehicle', 'admire', '-p', 'allocation.exact.policy:=none'], 1, 'policy: .*none'),
    (['--methods', '../../../etc/passwd:X'], 1, "no method '../../../etc/passwd:X'; there are"),
    (['-p', 'vehicle.mass:=!!timestamp foo'], 1, 'vehicle.mass: not a value: .*timestamp'),
    (['-p', 'allocation.conventional.weight:=1.7e308'], 1, 'weight: .*up to 1e.09'),
    (['-p', 'vehicle.mass:=-1'], 1, 'vehicle.mass: must be positive'),
    (['-p', 'vehicle.mas:=1'], 1, 'vehicle.mas: no such parameter'),
    (['-p', 'vehicle.mass=1'], 1, 'expected NAME:=VALUE'),
    (['--samples', '0'], 2, 'not a positive whole number'),
    (['--workers', '2', '--scheduler', 'tcp://h:1'], 2, 'not allowed with'),
    (['--seed', '-1'], 2, 'whole number'),
    (['--sampling', 'cube'], 2, 'invalid choice'),
])
def test_what_is_wrong_is_said_in_one_line(
        arguments, code, words, tmp_path, capsys):
    try:
        found = main([*arguments, '--out', str(tmp_path)])
    except SystemExit as end:
        found = end.code
    assert found == code
    out, err = capsys.readouterr()
    assert out == ''
    assert re.search(words, err.splitlines()[-1])
    assert 'Traceback' not in err
    assert code == 2 or len(err.splitlines()) == 1


def test_arguments_of_ros_are_left_to_ros():
    words = ['--seed', '1', '--ros-args', '-p', 'a:=1', '--', '--samples', '5']
    assert split(words) == (
        ['--seed', '1', '--samples', '5'], ['--ros-args', '-p', 'a:=1', '--'])
    assert os.sep not in ''.join(split(words)[0])
