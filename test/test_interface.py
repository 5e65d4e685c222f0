"""The interface as a newcomer types it: vehicles in code, and what objects say of themselves."""

import doctest
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import ca_ros
import user_code
from ca_ros import (
    ALLOCATORS,
    AdmissibleSet,
    AllocationProblem,
    Exact,
    FailureDetector,
    ParameterError,
    PseudoInverse,
    SlewLimited,
    Status,
    TiltLimited,
    Vehicle,
    audit,
    control_allocation_matrix,
    make_allocator,
    make_detector,
)
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.studies.dynamic.study import dynamic_study
from ca_ros.studies.static.study import static_study
from ca_ros.vehicle.files import shipped_tilting, shipped_vehicles
from strategies import ring

ROTOR = {
    'thrust_coefficient': 2.5e-5, 'torque_coefficient': 5e-7, 'speed_min': 40.0,
    'speed_max': 400.0}
SQUARE = [(0.2, 0.2, 0.0), (-0.2, 0.2, 0.0), (-0.2, -0.2, 0.0), (0.2, -0.2, 0.0)]
SPINS = ['cw', 'ccw', 'cw', 'ccw']


def quadrotor(**others):
    return Vehicle(**{'mass': 1.0, 'positions': SQUARE, 'spins': SPINS, **ROTOR, **others})


# Vehicles in code

def test_a_vehicle_by_keywords_is_that_of_its_parameters():
    flat = {
        'vehicle.mass': 1.0, 'rotors.positions': np.ravel(SQUARE).tolist(), 'rotors.spins': SPINS,
        **{f'rotors.{name}': value for name, value in ROTOR.items()}}
    nested = {
        'vehicle': {'mass': 1.0},
        'rotors': {'positions': np.ravel(SQUARE).tolist(), 'spins': SPINS, **ROTOR}}
    u = np.array([9.81, 0.2, -0.1, 0.05])
    expected = Exact(Vehicle.from_parameters(flat)).allocate(u).speeds
    for vehicle in (
            quadrotor(), Vehicle.from_parameters(nested),
            quadrotor(spins=None, yaw_torque_signs=[1, -1, 1, -1]),
            quadrotor(positions=np.array(SQUARE), center_of_mass=[0.0, 0.0, 0.0])):
        np.testing.assert_array_equal(Exact(vehicle).allocate(u).speeds, expected)


@pytest.mark.parametrize('positions', [
    SQUARE, np.array(SQUARE), [list(row) for row in SQUARE], np.ravel(SQUARE)])
def test_parameters_in_code_may_have_a_row_for_each_rotor(positions):
    given = {'vehicle': {'mass': 1.0}, 'rotors': {'positions': positions, 'spins': SPINS, **ROTOR}}
    assert Vehicle.from_parameters(given) == quadrotor()
    given['rotors']['axes'] = [(0.0, 0.0, 1.0)] * 4
    assert Vehicle.from_parameters(given) == quadrotor()


def test_parameters_may_be_the_content_of_a_file(tmp_path):
    quadrotor().save(tmp_path / 'saved.yaml')
    content = yaml.safe_load((tmp_path / 'saved.yaml').read_text(encoding='utf-8'))
    assert Vehicle.from_parameters(content) == Vehicle.load(tmp_path / 'saved.yaml')
    with pytest.raises(TypeError, match=r'Vehicle\.load reads a file'):
        Vehicle.from_parameters('hexarotor')


def test_a_ring_takes_signs_for_spins():
    circle = {'radius': 0.4, 'mass': 1.0, **ROTOR}
    made = Vehicle.ring(count=6, yaw_torque_signs=[1, 1, -1, -1, 1, -1], **circle)
    np.testing.assert_array_equal(made.spins, [1, 1, -1, -1, 1, -1])
    with pytest.raises(ParameterError, match='yaw_torque_signs: given beside spins'):
        Vehicle.ring(count=4, spins=SPINS, yaw_torque_signs=[1, -1, 1, -1], **circle)
    for count in (6.0, '6', 0, -2, None, True):
        with pytest.raises(ParameterError, match='count: expected a number of rotors such as 6'):
            Vehicle.ring(count=count, **circle)


def test_a_ring_is_that_of_the_shipped_hexarotor():
    made = Vehicle.ring(count=6, radius=0.4, mass=1.0, inertia=[0.015, 0.015, 0.03], **ROTOR)
    np.testing.assert_allclose(made.arms, ring(6), atol=1e-15)
    np.testing.assert_array_equal(made.spins, [1, -1, 1, -1, 1, -1])
    with pytest.raises(ParameterError, match='spins: missing; those of 5 rotors cannot alternate'):
        Vehicle.ring(count=5, radius=0.4, mass=1.0, **ROTOR)


@pytest.mark.parametrize(('wrong', 'fault'), [
    ({'spins': [1, -1, 1, -1]}, r'\+1 is clockwise.*rotorpy.*KM of PX4.*yaw_torque_signs'),
    ({'positions': np.zeros((7, 2))}, r'positions: expected shape \(n, 3\).*got \(7, 2\)'),
    ({'positions': np.ravel(SQUARE)}, r'positions: expected shape \(n, 3\)'),
    ({'positions': 'x'}, r"positions: expected shape \(n, 3\).* got 'x'"),
    ({'positions': [(1.0, 2.0, 3.0), (1.0, 2.0)]}, r'positions: expected shape \(n, 3\)'),
    ({'spins': None, 'yaw_torque_signs': 'x'}, "expected 1 or -1 for each rotor; got 'x'"),
    ({'spins': SPINS[:3]}, 'expected 4 words, one per rotor'),
    ({'spinz': 3}, r'spinz: no such keyword \(did you mean spins\?\)'),
    ({'max_thrust': 5.0}, r'max_thrust: no such keyword; .* speed_max=sqrt\(max_thrust / thr'),
    ({'speed_limits': (40, 400)}, 'speed_limits: no such keyword; give speed_min and speed_max'),
    ({'rotors': [1, 2]}, r'rotors: no such keyword; give positions=.* or Vehicle\.ring\('),
    ({'yaw_torque_signs': [1, -1, 1, -1]}, 'yaw_torque_signs: given beside spins'),
    ({'spins': None, 'yaw_torque_signs': [1, 2, 3, 4]}, 'expected 1 or -1 for each rotor'),
    ({'mass': None}, r'vehicle\.mass: missing')])
def test_a_wrong_keyword_is_refused_with_what_would_be_right(wrong, fault):
    with pytest.raises(ParameterError, match=fault):
        quadrotor(**wrong)


def test_an_inertia_that_is_a_little_wrong_is_a_warning():
    """As rotorpy's Crazyflie has it: 1 % more than the sum of the others."""
    with pytest.warns(UserWarning, match=r'vehicle\.inertia: .* 1 % above the sum of the others'):
        vehicle = quadrotor(inertia=[1e-2, 1e-2, 2.02e-2])
    assert Exact(vehicle).allocate([9.81, 0, 0, 0]).status is Status.EXACT
    with pytest.raises(ParameterError, match='no body has the principal moments'):
        quadrotor(inertia=[1e-2, 1e-2, 2.2e-2])


@pytest.mark.parametrize('name', sorted(shipped_vehicles() | shipped_tilting()))
def test_a_saved_vehicle_is_read_again(name, tmp_path):
    vehicle = Vehicle.load(name)
    if 'thrust' in vehicle.axes and not len(vehicle.servos):
        vehicle = vehicle.fail(1, 0.7)
    if name == 'hexarotor_realistic':
        with pytest.raises(ValueError, match='a thrust curve or a battery: keep its own file'):
            vehicle.save(tmp_path / 'saved.yaml')
        return
    vehicle.save(tmp_path / 'saved.yaml')
    again = Vehicle.load(tmp_path / 'saved.yaml')
    for field, value in vars(vehicle).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(again, field), value, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(
        vars(again.servos)['upper'], vars(vehicle.servos)['upper'], atol=1e-15)
    assert again.axes == vehicle.axes


def test_hover_speeds_and_failures_count_from_one():
    vehicle = Vehicle.load('hexarotor')
    # sqrt(9.81 / 6 / 2.5e-5), all alike.
    np.testing.assert_allclose(vehicle.hover_speeds, np.sqrt(9.81 / 6 / 2.5e-5))
    np.testing.assert_array_equal(
        vehicle.fail(1).fail(3, 0.4).health, [0.0, 1.0, 0.4, 1.0, 1.0, 1.0])
    for rotor in (0, 7):
        with pytest.raises(ParameterError, match=f'no rotor {rotor}: .* rotors 1 to 6'):
            vehicle.fail(rotor)
    with pytest.raises(ValueError, match='see audit'):
        _ = vehicle.fail(1).hover_speeds


# What objects say

def test_each_object_says_what_it_is_in_a_line():
    vehicle = Vehicle.load('hexarotor')
    allocator = Exact(vehicle, policy='scale')
    answer = allocator.allocate([9.81, 0.0, 0.0, 0.0])
    said = {
        repr(vehicle): 'Vehicle: 6 rotors, 1 kg, axes thrust, roll, pitch, yaw',
        repr(vehicle.fail(2)): 'Vehicle: 6 rotors, 1 kg, axes thrust, roll, pitch, yaw, lost: 2',
        repr(allocator): 'Exact: 6 rotors, axes thrust, roll, pitch, yaw, '
                         f"engine {allocator.engine}, policy='scale'",
        repr(allocator.problem): 'VehicleProblem: 6 rotors, axes thrust, roll, pitch, yaw',
        repr(allocator.within_rates(9.0).fail(1)): 'SlewLimited: Exact: 6 rotors, axes thrust, '
            f"roll, pitch, yaw, engine {allocator.engine}, policy='scale', lost axes yaw",
        repr(TiltLimited(Vehicle.load('tricopter'), 2000.0, 3.0)):
            'TiltLimited: 3 rotors, 1 servos, 1.2 kg, axes thrust, roll, pitch, yaw',
        repr(RigidBody(vehicle)): 'RigidBody: 6 rotors, 1 kg, axes thrust, roll, pitch, yaw',
        repr(AdmissibleSet(vehicle)): 'AdmissibleSet: 6 rotors, axes thrust, roll, pitch, yaw',
        repr(AllocationProblem([[1.0, 1.0]], 0.0, 1.0)):
            'AllocationProblem: 2 effectors, axes axis_1',
        repr(answer): 'Allocation: EXACT: thrust 9.81, roll 0, pitch 0, yaw 0; rotors at '
                      '[1.635, 1.635, 1.635, 1.635, 1.635, 1.635] N',
    }
    for found, expected in said.items():
        assert found == expected
    for each in (audit(vehicle), allocator.allocate_batch(np.eye(4)), answer.certificate,
                 *(kind(vehicle) for kind in ALLOCATORS.values())):
        assert len(repr(each)) < 800


@pytest.mark.parametrize('health', [[1] * 6, [0, 1, 1, 1, 1, 1]])
def test_batches_have_numbers_and_masks(health):
    allocator = Exact(Vehicle.load('hexarotor')).with_health(health)
    batch = allocator.allocate_batch([[9.81, 0.1 * k, 0.0, 0.0] for k in range(4)])
    for which, rows in (
            ([1, 3], [1, 3]), (np.array([3, 0]), [3, 0]), (batch.demand[:, 1] < 0.15, [0, 1]),
            ([True, False, False, True], [0, 3])):
        part = batch[which]
        np.testing.assert_array_equal(part.thrusts, batch.thrusts[rows])
        np.testing.assert_array_equal(
            part.certificate.primal_residual, batch.certificate.primal_residual[rows])
        assert [each.status for each in part] == [batch[k].status for k in rows]


def test_batches_have_slices_and_frames():
    allocator = Exact(Vehicle.load('hexarotor'))
    wrenches = np.array([[9.81, 0.1 * k, 0.0, 0.0] for k in range(40)])
    batch = allocator.allocate_batch(wrenches)
    part = batch[10:20:3]
    assert len(part) == 4
    np.testing.assert_array_equal(part.thrusts, batch.thrusts[10:20:3])
    frame = batch.to_frame()
    assert list(frame.columns[:3]) == ['status', 'demand_thrust', 'demand_roll']
    assert frame['status'].value_counts().to_dict() == {
        'EXACT': int((batch.status == 0).sum()), 'PRIORITIZED': int((batch.status == 1).sum())}
    np.testing.assert_array_equal(frame['rotor_3'], batch.thrusts[:, 2])
    np.testing.assert_array_equal(frame['roll'], batch.wrench[:, 1])
    # 1e-9 of half of each range is far above rounding, and below what is missed.
    np.testing.assert_array_equal(batch.is_close(1e-9), batch.status == 0)
    assert [answer.is_close(1e-9) for answer in batch] == (batch.status == 0).tolist()
    assert batch[39].is_close(1.0)
    assert batch.is_exact.tolist() == [answer.is_exact for answer in batch]
    assert 0 < batch.is_exact.sum() < 40
    with pytest.raises(ValueError, match=r'got \(40, 4\); allocate_batch takes many'):
        allocator.allocate(wrenches)
    with pytest.raises(ValueError, match=r'got \(4,\); allocate takes one'):
        allocator.allocate_batch(wrenches[0])


def test_a_status_is_compared_with_numbers_and_never_with_text():
    allocator = Exact(Vehicle.load('hexarotor'))
    status = allocator.allocate([9.81, 3.0, 0.0, 0.0]).status
    assert status.name == 'PRIORITIZED'
    assert status == 1 == np.int8(status)
    assert status not in (0, None)
    assert {status: 5}[1] == 5
    assert (np.array([0, 1], np.int8) == status).tolist() == [False, True]
    assert (np.array([0, 1], np.int8) != status).tolist() == [True, False]
    for text in ('PRIORITIZED', 'prioritized', ''):
        with pytest.raises(TypeError, match=r'compare status\.name with'):
            assert status == text
        with pytest.raises(TypeError, match=r'compare status\.name with'):
            assert status != text


@pytest.mark.parametrize('name', ['hexarotor', 'hexarotor_realistic', 'tricopter'])
def test_vehicles_with_the_same_numbers_are_equal(name):
    one, other = Vehicle.load(name), Vehicle.load(name)
    assert one == other
    assert hash(one) == hash(other)
    assert pickle.loads(pickle.dumps(one)) == one
    assert one.fail(1).intact == one != one.fail(1)
    arms = np.nextafter(one.arms, 9.0)
    assert one != replace(one, arms=arms)
    assert one != name
    assert len({one, other, one.fail(1)}) == 2


def test_reasons_and_certificates_are_shown_in_words():
    batch = Exact(Vehicle.load('hexarotor')).allocate_batch([[9.81, 0, 0, 0], [9.81, 3, 0, 0]])
    assert repr(batch.explanation[1]).startswith('Explanation: roll 91 % served, limited by rot')
    assert repr(batch[0].certificate).startswith('Certificate: residual below 1e-12')
    assert 'array' not in repr(batch.explanation)


def test_rates_by_a_method_of_the_allocator():
    allocator = Exact(Vehicle.load('hexarotor'))
    slow = allocator.within_rates(2000.0)
    last = np.full(6, 255.7)
    one, two = (slow.allocate([12.0, 0.2, 0.0, 0.0], last, 0.01) for _ in range(2))
    assert np.abs(one.speeds - last).max() <= 20.0 + 1e-9
    np.testing.assert_array_equal(one.thrusts, two.thrusts)
    with pytest.raises(ValueError, match='give rates'):
        allocator.within_rates()


@pytest.mark.parametrize('name', ['tricopter', 'hexarotor_tilting', 'azimuth_boat'])
def test_rates_of_rotors_that_tilt(name):
    vehicle = Vehicle.load(name)
    allocator = Exact(vehicle)
    slow, rest = allocator.within_rates(200.0), vehicle.idle_command
    answer = slow.allocate(allocator.problem.center, rest[:vehicle.n], rest[vehicle.n:], 0.01)
    assert isinstance(slow, TiltLimited)
    assert np.abs(np.abs(answer.speeds) - np.abs(rest[:vehicle.n])).max() <= 2.0 + 1e-6
    with pytest.raises(ValueError, match='give rates'):
        allocator.within_rates()
    with pytest.raises(ParameterError, match='PseudoInverse does not keep the rates'):
        PseudoInverse(vehicle).within_rates(200.0)


# Studies

def test_studies_return_the_rows_of_their_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = {'methods': ['exact', 'pseudo_inverse'], 'param': ['vehicle.mass:=1.1']}
    for study, name, more in (
            (static_study, 'static', {'samples': 20}),
            (dynamic_study, 'dynamic', {'duration': 0.1})):
        rows = study(**options, **more, out=tmp_path / name, figures='none')
        written = pd.read_csv(tmp_path / name / f'{name}.csv')
        assert set(rows['method']) == {'exact', 'pseudo_inverse'}
        assert (len(rows), [*rows.columns]) == (len(written), [*written.columns])
        # Without a folder no file is written.
        assert len(study(**options, **more)) == len(rows)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['dynamic', 'static']
    with pytest.raises(ValueError, match="--samples: '-1' is not a positive"):
        static_study(samples=-1)
    with pytest.raises(ca_ros.CaRosError, match="no method 'wls'; did you mean weighted_least_sq"):
        static_study(methods='wls')


# What is wrong

HEXAROTOR = Vehicle.load('hexarotor')
MATRIX = np.array([[1.0, -1.0, 0.2], [0.5, 0.5, 0.0]])
EXACT = Exact(HEXAROTOR)
HOVER = [9.81, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(('wrong', 'words'), [
    (lambda: Exact(HEXAROTOR, polcy='scale'), 'no setting polcy; did you mean policy?'),
    (lambda: make_allocator('exact', HEXAROTOR, polcy='scale'), 'did you mean policy?'),
    (lambda: PseudoInverse(HEXAROTOR, lag=1), '(settings: none)'),
    (lambda: Exact('hexarotor'), "Vehicle.load('hexarotor') reads a file"),
    (lambda: audit('hexarotor'), "Vehicle.load('hexarotor') reads a file"),
    (lambda: control_allocation_matrix('hexarotor'), 'expected a Vehicle'),
    (lambda: make_allocator('wls', HEXAROTOR), 'did you mean weighted_least_squares?'),
    (lambda: make_allocator('Exact', HEXAROTOR), 'did you mean exact?'),
    (lambda: make_allocator('pseudo-inverse', HEXAROTOR), 'did you mean pseudo_inverse?'),
    (lambda: make_allocator('xyz', HEXAROTOR), "no allocation method 'xyz' (there are exact"),
    (lambda: make_allocator(HEXAROTOR, 'exact'), 'method: expected a name'),
    (lambda: SlewLimited(HEXAROTOR, 100.0), 'expected an Allocator, such as Exact(vehicle)'),
    (lambda: Vehicle(1.0, SQUARE), 'keywords alone'),
    (lambda: quadrotor(spins='cw'), "spins: expected 'cw' or 'ccw' for each rotor"),
    (lambda: quadrotor(positions=dict(enumerate(SQUARE))), 'list its values()'),
    (lambda: quadrotor(k_f=1e-5), 'k_f: no such keyword; did you mean thrust_coefficient?'),
    (lambda: quadrotor(rotor_pos=SQUARE), 'did you mean positions?'),
    (lambda: Exact(HEXAROTOR, lost_axes='drop'), 'make_allocator takes it'),
    (lambda: quadrotor(axes='yew'), "must be one of force_x, .*, got 'yew'"),
    (lambda: make_detector(HEXAROTOR, lag=0.1), 'FailureDetector has no setting lag'),
    (lambda: make_detector(HEXAROTOR, dely=0.1), 'did you mean delay?'),
    *((lambda method=method, bounds=bounds: method.allocate_within(HOVER, *bounds), words)
      for method in (EXACT, PseudoInverse(HEXAROTOR)) for bounds, words in (
          (([np.nan] * 6, [3.0] * 6), 'lower: expected finite numbers'),
          ((np.zeros(6), np.full(6, np.inf)), 'upper: expected finite numbers'),
          ((np.full(6, 2.0), np.full(6, 1.0)), 'lower: 2 of rotor 1 is above'),
          ((np.zeros(5), np.ones(6)), 'lower: expected 1 or 6 numbers'))),
    (lambda: Exact(Vehicle.load('tricopter')).allocate_within(HOVER, 0.0, 1.0),
     'allocate_within takes effectors that are numbers'),
])
def test_what_is_wrong_is_told_with_what_would_be_right(wrong, words):
    with pytest.raises((TypeError, ValueError), match=re.escape(words).replace(r'\.\*', '.*')):
        wrong()


@pytest.mark.parametrize('method', [EXACT, PseudoInverse(HEXAROTOR)])
def test_bounds_of_an_answer_may_be_lists_or_one_number(method):
    lower, upper = np.full(6, 0.5), np.full(6, 2.0)
    expected = method.allocate_within([9.81, 0.2, 0.0, 0.0], lower, upper).thrusts
    for given in ((lower.tolist(), upper.tolist()), (0.5, 2.0), (0.5, upper)):
        found = method.allocate_within([9.81, 0.2, 0.0, 0.0], *given).thrusts
        np.testing.assert_array_equal(found, expected)


def test_one_axis_needs_no_list():
    assert quadrotor(axes='thrust').axes == ('thrust',)
    assert AllocationProblem([[1.0, 1.0]], 0.0, 1.0, axes='thrust').axes == ('thrust',)


STATE = [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]


@pytest.mark.parametrize(('wrong', 'words'), [
    (lambda d: d.command(0.5, [300.0] * 6), 'time 0.5: expected whole nanoseconds'),
    (lambda d: d.observe(0.5, *STATE), 'time 0.5: expected whole nanoseconds'),
    (lambda d: d.observe(2**63, *STATE), 'expected a number of nanoseconds below 2**62'),
    (lambda d: d.command(0, [300.0] * 4), 'command [300.0, 300.0, 300.0, 300.0]: expected 6 numb'),
    (lambda d: d.command(0, 'fast'), 'command fast: expected 6 numbers'),
    (lambda d: d.command(0, [np.nan] * 6), 'expected 6 numbers up to 1e100'),
    (lambda d: d.measure(0, [300.0]), 'speeds [300.0]: expected 6 numbers'),
    (lambda d: d.measure(0, np.zeros((2, 3))), 'expected 6 numbers'),
    (lambda d: d.measure(0, [np.inf] * 6), 'expected 6 numbers up to 1e100'),
    (lambda d: d.observe(0, STATE[1], *STATE[1:]), 'attitude [0.0, 0.0, 0.0]: expected 4 numbers'),
    (lambda d: d.observe(0, STATE[0], [0.0], STATE[2]), 'velocity [0.0]: expected 3 numbers'),
    (lambda d: d.observe(0, *STATE[:2], [0.0]), 'angular velocity [0.0]: expected 3 numbers'),
    (lambda d: d.observe(0, *STATE, [0.0]), 'specific force [0.0]: expected 3 numbers'),
    (lambda d: d.observe(0, [0.0] * 4, *STATE[1:]), 'expected a quaternion that is not zero'),
    (lambda d: d.announce([1.0]), 'expected 6 numbers in [0, 1]'),
    (lambda d: d.announce([2.0] * 6), 'expected 6 numbers in [0, 1]'),
])
@pytest.mark.parametrize('make', [FailureDetector, make_detector])
def test_both_detectors_refuse_the_same(make, wrong, words):
    detector = make(HEXAROTOR, motor_time_constant=0.05)
    with pytest.raises((TypeError, ValueError), match=re.escape(words)):
        wrong(detector)
    # Lists and integers are taken.
    detector.command(0, [300] * 6)
    detector.measure(0, [300.0] * 6)
    assert not detector.observe(np.int64(1), *STATE)


def test_a_detector_without_a_lag_warns():
    for make in (FailureDetector, make_detector):
        with pytest.warns(RuntimeWarning, match='motor_time_constant: taken as 0') as caught:
            make(HEXAROTOR)
        # It points at the line that did not give the lag.
        assert [Path(each.filename) for each in caught] == [Path(__file__)]


@pytest.mark.parametrize('make', [FailureDetector, make_detector])
def test_a_detector_says_of_what_it_is(make):
    detector = make(HEXAROTOR, motor_time_constant=0.05)
    assert repr(detector) == (
        f'{type(detector).__name__}: 6 rotors, 1 kg, axes thrust, roll, pitch, yaw, motors with a '
        'lag of 0.05 s, found: none')
    with pytest.raises(TypeError, match=r"Vehicle\.load\('hexarotor'\) reads a file"):
        make('hexarotor', motor_time_constant=0.05)


TOUCHED = (
    'AdmissibleSet', 'Allocation', 'AllocationBatch', 'AllocationProblem', 'Exact',
    'FailureDetector', 'SlewLimited', 'TiltLimited', 'Vehicle', 'audit', 'make_allocator')
"""What most users call or get."""


@pytest.mark.parametrize('name', [name for name in ca_ros.__all__ if name != 'ALLOCATORS'])
def test_the_examples_of_public_names(name):
    examples = doctest.DocTestFinder(recurse=True).find(
        getattr(ca_ros, name), name, globs={'np': np, **vars(ca_ros)})
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for each in examples:
        assert runner.run(each).failed == 0, name
    assert name not in TOUCHED or any(each.examples for each in examples)


def test_user_code_runs_and_audits_say_what_they_are():
    user_code.main()
    assert repr(audit(HEXAROTOR)).startswith('VehicleAudit: 6 rotors, axes thrust')


@pytest.mark.parametrize(('guess', 'words'), [
    (lambda: Exact(MATRIX), 'AllocationProblem(matrix, lower, upper) takes a matrix'),
    (lambda: Exact(MATRIX, lower=-1.0, upper=1.0), 'takes a matrix'),
    (lambda: AllocationProblem(MATRIX, bounds=(-1.0, 1.0)), 'no bounds; give lower and upper'),
    (lambda: AllocationProblem(MATRIX, -1, 1, names='ab'), 'no names; give effector_names'),
    (lambda: AllocationProblem(MATRIX, -1, 1, colour=3), 'AllocationProblem has no colour'),
    (lambda: audit(Exact(AllocationProblem(MATRIX, -1.0, 1.0))), 'an allocator has its audit'),
    (lambda: Exact(AllocationProblem(MATRIX, -1, 1)).with_health([1, 1, 1], stuck=[2]),
     'stuck: expected values by effector, such as {4: 0.1}, got [2]'),
    (lambda: Exact(HEXAROTOR.fail(1)), 'or fail and with_health of an allocator made before'),
    (lambda: Exact(HEXAROTOR).fail(True), 'no True of rotors: they count from 1 to 6'),
    (lambda: HEXAROTOR.fail(True), 'no rotor True: the vehicle has rotors 1 to 6'),
    (lambda: AllocationProblem(1e-9 * MATRIX, -1.0, 1.0),
     'too small: choose units in which it is at least 1e-06'),
    (lambda: make_allocator('exact', Vehicle.load('quadrotor').fail(1), lost_axes='drop').allocate(
        [9.81, 0.0, 0.0, 0.0]), 'fail and with_health of an allocator made before keep them'),
    (lambda: Exact(HEXAROTOR).fail(7), 'no 7 of rotors: they count from 1 to 6'),
    (lambda: Vehicle.from_text(''), "expected a ROS parameter file: '/**:'"),
    (lambda: Vehicle.from_text(None), 'expected the text of a parameter file, got None'),
    (lambda: Vehicle(Ixx=1.0), 'Ixx: no such keyword; give inertia=[Ixx, Iyy, Izz]')])
def test_what_a_stranger_guesses_is_answered(guess, words):
    with pytest.raises((TypeError, ValueError), match=re.escape(words)):
        guess()


def test_failures_one_by_one_are_those_of_with_health():
    sound, problem = Exact(HEXAROTOR), AllocationProblem(MATRIX, -1.0, 1.0)
    u = [9.81, 0.1, 0.0, 0.0]
    for made, health in (
            (sound.fail(2), [1, 0, 1, 1, 1, 1]),
            (sound.fail(2).fail(5, 0.5), [1, 0, 1, 1, 0.5, 1]),
            (sound.fail(2).fail(2, 1.0), [1] * 6)):
        np.testing.assert_array_equal(
            made.allocate(u).thrusts, sound.with_health(health).allocate(u).thrusts)
    assert Exact(problem).fail(3).problem.health.tolist() == [1.0, 1.0, 0.0]
    np.testing.assert_array_equal(problem.matrix, MATRIX)
    assert Status('EXACT') is Status.EXACT
    with pytest.raises(ValueError, match='not a valid Status'):
        Status('exact')
