"""The audit: which axes the rotors can control, as they are."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from ca_ros import (
    ALLOCATORS,
    AdmissibleSet,
    ParameterError,
    Status,
    Vehicle,
    audit,
    make_allocator,
)
from ca_ros.__main__ import main
from ca_ros.problem.controllability import INDEPENDENCE_MIN
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.studies.cases import Case
from ca_ros.vehicle.files import config_directory
from strategies import build, file_values, length, ring


def without(vehicle, *rotors):
    """Return the vehicle with some rotors lost, counted from 1."""
    return vehicle.with_health([0.0 if i + 1 in rotors else 1.0 for i in range(vehicle.n)])


def moved(distance, **changes):
    """Return the hexarotor with rotor 2 moved a little [m], and rotors 1 and 4 lost."""
    parameters = {**file_values('hexarotor'), **changes}
    positions = list(parameters['rotors.positions'])
    positions[3] += distance
    return without(Vehicle.from_parameters({**parameters, 'rotors.positions': positions}), 1, 4)


@pytest.mark.parametrize('name', ['hexarotor_ppnnpn', 'x8'])
def test_hover_is_inside_where_a_linear_program_says_so(name):
    vehicle = Vehicle.load(name)
    answers = set()
    for lost, load_factor in itertools.product(range(vehicle.n + 1), (0.05, 0.5, 1.0, 1.5, 2.4)):
        loaded = replace(without(vehicle, lost), mass=load_factor * vehicle.mass)
        problem = VehicleProblem(loaded)
        # Greatest t for which center + t (hover - center) is attainable: variables are f and t.
        way = problem.hover - problem.center
        bounds = [*zip(problem.lower, problem.upper, strict=True), (0.0, 2.0)]
        found = linprog(
            [*np.zeros(problem.n), -1.0],
            A_eq=np.column_stack([problem.gamma, -way]), b_eq=problem.center, bounds=bounds)
        assert problem.interior.has_volume
        assert problem.interior.has_reference == (found.x[-1] > 1.0 + 1e-9)
        answers.add(problem.interior.has_reference)
    assert answers == {True, False}


@pytest.fixture(scope='module')
def pnpnpn():
    return Vehicle.load('hexarotor')


@pytest.mark.parametrize(
    'name',
    ['hexarotor', 'hexarotor_ppnnpn', 'hexarotor_tilted', 'octorotor', 'quadrotor', 'x8', 'y6'],
)
def test_every_shipped_vehicle_is_sound(name):
    report = audit(Vehicle.load(name))
    assert report.sound
    assert report.warnings == ()
    assert report.rank == len(report.vehicle.axes)
    assert all(low < 0.0 < high for low, high in report.authority.values())


def test_the_authority_of_the_hexarotor_worked_out_by_hand(pnpnpn):
    # At hover each rotor gives 1.635 N. For yaw alone three rotors give t more and three t less,
    # 6 k t = 0.12 t N m; the first end is the lower bound of 0.04 N: 0.12 (1.635 - 0.04).
    low, high = audit(pnpnpn).authority['yaw']
    assert high == pytest.approx(0.02 * 6.0 * (1.635 - 0.04), rel=1e-12)
    assert low == pytest.approx(-high, rel=1e-12)
    # Thrust goes from 6 * 0.04 N to 6 * 4 N.
    assert audit(pnpnpn).authority['thrust'] == pytest.approx((0.24 - 9.81, 24.0 - 9.81))


@pytest.mark.parametrize('rotor', range(1, 7))
def test_pnpnpn_loses_hover_with_any_rotor(pnpnpn, rotor):
    report = audit(without(pnpnpn, rotor))
    assert report.lost == ('yaw',)
    # Just outside of the set, as every rotor keeps turning at 40 rad/s.
    assert -0.01 < report.hover_margin < 0.0
    assert report.controllable_hover_margin > 0.0
    assert 'yaw lost' in str(report)
    # What is lost for the sake of hover is still commanded, with what the others leave.
    assert 'yaw' in report.vehicle.axes


def test_two_opposite_rotors_lost_leave_no_independent_yaw(pnpnpn):
    # Rotors 1 and 4 carry roll nothing, pitch most: without them pitch and yaw have parallel rows.
    report = audit(without(pnpnpn, 1, 4))
    assert report.lost == ('yaw',)
    assert report.rank == 3
    assert report.independence['yaw'] < 1e-12
    assert 'yaw' not in report.vehicle.axes
    AdmissibleSet(report.vehicle)


def test_nearly_parallel_rows_are_not_commanded_with_great_gains(pnpnpn):
    # The same, but with a rotor moved a little: the rows are about a degree apart, and pitch
    # against yaw would take fifty times the thrusts (PX4 issue 28589).
    report = audit(moved(0.012))
    assert 0.0 < report.independence['yaw'] < INDEPENDENCE_MIN
    assert report.lost == ('yaw',)
    gains = np.linalg.pinv(AdmissibleSet(report.vehicle).problem.gamma)
    assert np.abs(gains).max() < 10.0


@pytest.mark.parametrize(('changes', 'words'), [
    # The six rotors lift from 0.24 N to 24 N.
    ({'vehicle.mass': 18.0}, 'cannot hover: 18 kg on rotors that lift 2.446 kg'),
    ({'vehicle.mass': 0.01}, 'cannot hover: 0.01 kg on rotors that lift at least 0.02446 kg'),
    # 176.58 N / 24 N = 7.3575, and its root is 2.7125.
    ({'vehicle.mass': 18.0}, 'hover needs 176.6 N, the rotors give at most 24 N: '
     'thrust_coefficient or speed_max too small (by the factor 7.36 or 2.71), or mass too large'),
    # 0.24 N / 0.0981 N = 2.4465, and its root is 1.5641.
    ({'vehicle.mass': 0.01}, 'hover needs 0.0981 N, the rotors give at least 0.24 N: '
     'thrust_coefficient or speed_min too large (by the factor 2.45 or 1.56), or mass too small'),
    ({'vehicle.gravity': 3.71, 'vehicle.mass': 8.0},
     'cannot hover: 8 kg on rotors that lift 6.469 kg'),
    ({'vehicle.mass': 2.0, 'vehicle.center_of_mass': [0.39, 0.0, 0.0],
      'allocation.axes': ['thrust', 'pitch', 'roll']}, 'pitch lost (given up for hover)'),
    ({'vehicle.mass': 2.0, 'vehicle.center_of_mass': [0.39, 0.0, 0.0],
      'allocation.axes': ['thrust']}, 'hover margin'),
    ({'rotors.axes': [0.0, 0.0, -1.0]}, 'cannot hover: 1 kg on rotors that lift -0.02446 kg'),
])
def test_why_a_vehicle_cannot_hover_is_said_plainly(changes, words):
    assert words in str(audit(Vehicle.from_parameters({**file_values('hexarotor'), **changes})))


def test_the_lines_have_units(pnpnpn):
    number = r'[-+]?[0-9.]+'
    ends = rf'{number} to {number}'
    assert re.fullmatch(
        rf'hover margin {number} \[N, N m\]; around hover: thrust {ends} N, roll {ends} N m, '
        rf'pitch {ends} N m, yaw {ends} N m', str(audit(pnpnpn)))


# One refusal

NO_YAW = {'rotors.torque_coefficient': 0.0}
UNSOUND = {
    'a geometry without yaw': lambda **changes: Vehicle.from_parameters(
        {**file_values('hexarotor'), **NO_YAW, **changes}),
    'nearly parallel rows': lambda **changes: moved(1e-3, **changes),
    'hover on the boundary': lambda **changes: without(
        Vehicle.from_parameters({**file_values('hexarotor'), **changes}), 1),
    'too heavy': lambda **changes: Vehicle.from_parameters(
        {**file_values('hexarotor'), 'vehicle.mass': 2.5, **changes}),
}


@pytest.mark.parametrize('fault', UNSOUND)
def test_every_method_refuses_what_the_audit_refuses_in_the_same_words(fault):
    vehicle = UNSOUND[fault]()
    lines = set()
    for name, kind in ALLOCATORS.items():
        for make in (lambda name=name: make_allocator(name, vehicle),
                     lambda kind=kind: kind(vehicle)):
            with pytest.raises(ParameterError) as caught:
                make()
            lines.add(str(caught.value))
    [line] = lines
    assert line.startswith('allocation.lost_axes: this vehicle is refused: ')
    assert str(audit(vehicle)) in line
    assert "'drop' accepts it" in line


@pytest.mark.parametrize('method', length(['exact', 'conventional'], ALLOCATORS))
@pytest.mark.parametrize('fault', UNSOUND)
def test_drop_gives_up_the_lost_axes(fault, method):
    vehicle = UNSOUND[fault]()
    report = audit(vehicle)
    # As an option, as the file says, or as the audit leaves the vehicle.
    said = UNSOUND[fault](**{'allocation.lost_axes': 'drop'})
    for allocator in (
            make_allocator(method, vehicle, lost_axes='drop'), make_allocator(method, said),
            ALLOCATORS[method](said), make_allocator(method, report.vehicle)):
        assert allocator.problem.axes == report.vehicle.axes
        demand = allocator.problem.gamma @ (0.5 * (vehicle.thrust_min + vehicle.thrust_max))
        assert allocator.allocate(demand).status in (Status.EXACT, Status.INEXACT)
    with pytest.raises(ParameterError, match='is refused'):
        make_allocator(method, said, lost_axes='refuse')


def test_a_problem_is_judged_by_its_mathematics_alone():
    vehicle = moved(1e-3)
    problem = VehicleProblem(vehicle)
    middle = problem.gamma @ (0.5 * (problem.lower + problem.upper))
    assert make_allocator('exact', problem).allocate(middle).status is Status.EXACT
    # It is audited where that is asked for.
    dropped = make_allocator('exact', VehicleProblem(vehicle), lost_axes='drop')
    assert dropped.problem.axes == ('thrust', 'roll', 'pitch')


def test_studies_refuse_in_the_same_words(pnpnpn):
    with pytest.raises(ParameterError) as python:
        make_allocator('exact', without(pnpnpn, 1))
    lost = 'rotors.health:=[0, 1, 1, 1, 1, 1]'
    with pytest.raises(ParameterError) as study:
        Case.load('hexarotor', [lost])
    assert str(study.value) == f'hexarotor: {python.value}'
    case = Case.load('hexarotor', [lost, 'allocation.lost_axes:=drop'])
    assert [name for name in ALLOCATORS if case.allocator(name)] == list(ALLOCATORS)


# Warnings

def test_millimetres_and_few_digits_are_warned_of_and_accepted(tmp_path, capsys):
    turned = ring(8, radius=0.5, first=np.pi / 8)
    slips = {1.0: r'^warning: facets almost parallel, .*rotors.ring, .*nine digits$',
             1000.0: r'^warning: an arm of 500 m for 1 kg: .*millimetres'}
    codes = {1.0: 0, 1000.0: 3}
    for scale, words in slips.items():
        places = (scale * turned).round(4)
        assert make_allocator('exact', build(places, 'PN' * 4)).allocate([9.81, 0, 0, 0])
        values = ', '.join(map(str, places.ravel().tolist()))
        file = tmp_path / f'{scale}.yaml'
        text = (config_directory() / 'octorotor.yaml').read_text().replace('1.6', '1.0')
        text = re.sub('#.*', '', text)
        file.write_text(re.sub(r'positions: \[[^]]*\]', f'positions: [{values}]', text))
        assert main(['audit', str(file)]) == codes[scale]
        assert re.search(words, capsys.readouterr().out, re.MULTILINE)
    # The largest multirotors have arms of nearly 20 m.
    assert not audit(build(40.0 * ring(6), 'PN' * 3, {'vehicle.mass': 200.0})).warnings


# The command

def test_the_command_audits_a_vehicle_and_the_loss_of_each_rotor(capsys):
    assert main(['audit', 'hexarotor_ppnnpn']) == 0
    out, err = capsys.readouterr()
    assert err == ''
    title, _, head, none, *rows = out.splitlines()
    assert title == 'hexarotor_ppnnpn: 1 kg on 6 rotors that lift 0.0245 to 2.45 kg'
    for words in ('lost axes', 'hover margin [N, N m]', 'thrust [N]', 'yaw [N m]'):
        assert words in head
    vehicle = Vehicle.load('hexarotor_ppnnpn')
    for i, row in enumerate([none, *rows]):
        report = audit(without(vehicle, i))
        words = row.split('  ')[0], *re.split(r' {2,}', row)[1:]
        assert words == (
            f'rotor {i}' if i else 'none', ', '.join(report.lost) or '-',
            f'{report.controllable_hover_margin:.3g}',
            *(report.ends(axis) if axis in report.authority else '-' for axis in vehicle.axes))


def test_the_command_says_what_the_nodes_would(pnpnpn, capsys):
    for options, health in (
            (['--fail', '3'], [1, 1, 0, 1, 1, 1]), (['--fail', '1,4'], [0, 1, 1, 0, 1, 1]),
            (['--fail', 'all=0.2'], [0.2] * 6),
            (['--fail', '1=0,all=0.9'], [0, 0.9, 0.9, 0.9, 0.9, 0.9])):
        assert main(['audit', 'hexarotor', *options]) == 1
        out, err = capsys.readouterr()
        with pytest.raises(ParameterError) as refused:
            make_allocator('exact', pnpnpn.with_health(health))
        assert err == f'ca_ros audit: {refused.value}\n'
        # A further loss of each rotor that is left.
        assert len(re.findall('^rotor', out, re.MULTILINE)) == np.count_nonzero(
            np.broadcast_to(health, 6))


def test_the_command_reads_a_file_and_its_faults_in_one_line(tmp_path, capsys):
    path = tmp_path / 'my.yaml'
    for text, words in (('a: [', 'my.yaml: not readable YAML'), ('a: 1', 'my.yaml: expected')):
        path.write_text(text)
        assert main(['audit', str(path)]) == 1
        out, err = capsys.readouterr()
        assert (out, len(err.splitlines())) == ('', 1)
        assert words in err
    for options, words in (
            (['--fail', '7'], '--fail: no rotor 7: the vehicle has rotors 1 to 6'),
            (['--fail', 'one'], "--fail: 'one': expected ROTOR or ROTOR=HEALTH"),
            (['--fail', '1,1=0.5'], "--fail: '1,1=0.5': rotor 1 twice"),
            (['--fail', '1=nan'], "--fail: '1=nan': expected a health in [0, 1]")):
        assert main(['audit', 'hexarotor', *options]) == 1
        assert words in capsys.readouterr().err


# Beyond all vehicles


def test_a_vehicle_of_many_rotors_is_audited_without_its_facets():
    # Of 190 rotors more than a million choices would have to be looked at for the hover margin.
    many = build(ring(190, radius=2.0), 'PN' * 95, {'vehicle.mass': 50.0})
    for vehicle in (many, without(many, 1, 2)):
        report = audit(vehicle)
        assert report.sound
        assert 'hover margin' not in str(report)
        assert 'around hover: thrust' in str(report)
    with pytest.raises(ValueError, match='190 rotors and 4 axes'):
        _ = audit(many).hover_margin
