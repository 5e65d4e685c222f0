"""Slips in airframes are named, sound vehicles are not, and mixers for others are right."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ca_ros import Exact, ParameterError, Vehicle, audit, control_allocation_matrix
from ca_ros.__main__ import main
from ca_ros.problem.diagnosis import diagnose
from ca_ros.px4 import parameters
from ca_ros.vehicle.files import shipped_tilting, shipped_vehicles
from ca_ros.vehicle.formats.mixers import MOTORS, ardupilot, betaflight, mixer
from ca_ros.vehicle.formats.px4_lines import px4_lines
from strategies import QUAD_X, build, length, ring

SOUND = sorted(shipped_vehicles() | shipped_tilting())
SYMMETRIC = ['quadrotor', 'hexarotor', 'hexarotor_tilted', 'octorotor', 'x8', 'y6']
"""Not hexarotor_ppnnpn: it has one symmetry, so that several changes explain its slips."""


def changed(vehicle, field, rotor, value):
    values = getattr(vehicle, field).copy()
    values[rotor] = value
    return replace(vehicle, **{field: values})


def slips(vehicle):
    """Yield kind, rotor (0: none) and vehicle of each single slip."""
    for i in range(vehicle.n):
        yield 'spin', i + 1, changed(vehicle, 'spins', i, -vehicle.spins[i])
        yield 'axis', i + 1, changed(vehicle, 'rotor_axes', i, -vehicle.rotor_axes[i])
        for factor in (0.5, 1.5):
            thrust = changed(
                vehicle, 'thrust_coefficient', i, factor * vehicle.thrust_coefficient[i])
            yield 'thrust', i + 1, changed(
                thrust, 'torque_coefficient', i, factor * vehicle.torque_coefficient[i])
        for axis in (0, 1):
            # A sign that is wrong, or a value that was misspelt, so that it is 0.
            for new in (0.0, -vehicle.arms[i, axis]):
                if abs(new - vehicle.arms[i, axis]) > 0.02:
                    arm = vehicle.arms[i].copy()
                    arm[axis] = new
                    yield 'position', i + 1, changed(vehicle, 'arms', i, arm)
    longest = np.linalg.norm(vehicle.arms, axis=1).max()
    for shift in ([0.12, 0, 0], [-0.12, 0, 0], [0, 0.12, 0], [0, -0.12, 0]):
        yield 'centre', 0, replace(vehicle, arms=vehicle.arms - longest * np.array(shift))
    for unit in 100.0, 1000.0:
        yield 'units', 0, replace(vehicle, arms=unit * vehicle.arms)
    if (vehicle.rotor_axes[:, 2] > 0.999).all():
        # Tilted rotors give a yaw torque without their drag.
        yield 'spins', 1, replace(vehicle, spins=np.ones(vehicle.n))


@pytest.mark.parametrize('name', SOUND)
def test_no_shipped_vehicle_is_said_to_be_wrong(name):
    vehicle = Vehicle.load(name)
    assert diagnose(vehicle) == ()
    # A lost rotor is no slip in the file.
    assert diagnose(vehicle.with_health([0.0] + [1.0] * (vehicle.n - 1))) == ()


@pytest.mark.parametrize('name', SYMMETRIC)
def test_each_slip_is_named_with_its_rotor(name):
    vehicle = Vehicle.load(name)
    for kind, rotor, wrong in slips(vehicle):
        causes = diagnose(wrong)
        named = [cause for cause in causes if cause.kind == kind]
        assert len(named) == 1, (kind, rotor, causes)
        assert rotor in (0, *named[0].rotors), (kind, rotor, causes)
        # Of the two rotors on an arm either may turn the wrong way.
        alone = kind in ('position', 'spin', 'spins') and name in ('x8', 'y6')
        if kind in ('axis', 'thrust', 'spin') and not alone:
            assert named[0].rotors == (rotor,)
        if kind == 'spin' and alone:
            beside = np.linalg.norm((vehicle.arms - vehicle.arms[rotor - 1])[:, :2], axis=1) < 0.01
            assert named[0].rotors == tuple(np.flatnonzero(beside) + 1)


@pytest.mark.parametrize('name', SOUND)
def test_speeds_in_revolutions_per_minute_are_named(name):
    vehicle = Vehicle.load(name)
    if vehicle.n < 4 or len(vehicle.servos):
        return
    rpm = 60.0 / (2.0 * np.pi)
    fast = replace(vehicle, speed_max=9000.0 * np.ones(vehicle.n))
    [cause] = diagnose(fast)
    assert cause.kind == 'speeds'
    assert '9000 rpm are 942.5 rad/s' in cause.text
    # With a thrust_coefficient that suits them, 12 times as fast as usual.
    turned = replace(vehicle, speed_max=rpm * vehicle.speed_max * 3.0)
    assert [each.kind for each in diagnose(turned)] == ['speeds']


def test_rotors_that_all_point_down_are_named():
    vehicle = Vehicle.load('quadrotor')
    [cause] = diagnose(replace(vehicle, rotor_axes=-vehicle.rotor_axes))
    assert (cause.kind, cause.rotors) == ('axis', (1, 2, 3, 4))


@pytest.mark.parametrize('factor', [0.1, 10.0])
@pytest.mark.parametrize('name', SYMMETRIC)
def test_one_torque_of_a_far_other_size_is_named(name, factor):
    vehicle = Vehicle.load(name)
    wrong = changed(vehicle, 'torque_coefficient', 2, factor * vehicle.torque_coefficient[2])
    [cause] = diagnose(wrong)
    assert (cause.kind, cause.rotors) == ('torque', (3,))


def test_one_rotor_in_millimetres_is_named():
    vehicle = Vehicle.load('quadrotor')
    [cause] = diagnose(changed(vehicle, 'arms', 1, 1000.0 * vehicle.arms[1]))
    assert (cause.kind, cause.rotors) == ('position', (2,))
    assert 'rotor 2 is' in cause.text


def test_the_audit_in_python_has_what_the_command_prints():
    wrong = changed(Vehicle.load('hexarotor'), 'spins', 2, -1.0)
    assert wrong != Vehicle.load('hexarotor')
    report = audit(wrong)
    assert report.causes == diagnose(wrong)
    assert report.causes
    for text in (str(report), repr(report)):
        assert text.endswith('; probably wrong: rotor 3 turns the wrong way: flip its spin')
    assert report.causes[0].text in report.warnings
    assert 'probably' not in report.summary
    with pytest.raises(ParameterError, match=r'refused: .*probably wrong: all rotors turn'):
        Exact(replace(wrong, spins=np.ones(6)))


def sound(rng):
    """Yield vehicles that fly, with an irregularity that builders choose."""
    def made(places, spins, **values):
        count = len(places)
        strength = values.pop('strength', 1.0) * np.ones(count)
        arms = np.column_stack([places, np.zeros(count)]) - np.array(values.pop('centre', 0.0))
        return Vehicle(
            mass=1.5, positions=arms, spins=[{'P': 'cw', 'N': 'ccw'}[each] for each in spins],
            thrust_coefficient=1e-5 * strength, torque_coefficient=2e-7 * strength, speed_min=50.0,
            speed_max=1000.0)

    def uniform(low, high, *size):
        return rng.uniform(low, high, size or None)

    front, rear, side = uniform(0.2, 0.4, 3)
    plus = [(front, 0), (0, side), (-rear, 0), (0, -side)]
    yield 'plus with unequal arms', made(plus, 'PNPN')
    yield 'a longer front arm', made([(uniform(0.2, 0.4), 0), (0, 0.25), (-0.25, 0), (0, -0.25)],
                                     'PNPN')
    x, y = uniform(0.15, 0.3, 2, 2)
    corners = [(x[0], y[0]), (-x[1], y[1]), (-x[1], -y[1]), (x[0], -y[0])]
    yield 'trapezoid', made(corners, 'PNPN', centre=[(x[0] - x[1]) / 2.0, 0, 0])
    near = [(0.2, 0.2), (-0.2, 0.2 * uniform(0.9, 1.1)), (-0.2, -0.2), (0.2, -0.2)]
    yield 'nearly a rectangle', made(near, 'PNPN', centre=[uniform(-0.02, 0.02), 0, 0])
    crooked = np.array(corners) + rng.normal(0, 0.03, (4, 2))
    yield 'crooked', made(crooked - crooked.mean(axis=0), 'PNPN')
    y4 = [(x[0], y[0]), (x[0], -y[0]), (-x[1], 0), (-x[1], 0)]
    yield 'y4, a weaker lower rotor', made(y4, 'PNPN', strength=[1, 1, 1, uniform(0.6, 1.0)])
    yield 'y4, another tail', made(y4, 'PNNP', strength=[1, 1, *uniform(0.75, 1.3, 2)])
    angles = np.arange(6) * np.pi / 3
    six = np.column_stack([np.cos(angles), np.sin(angles)]) * uniform(0.3, 0.5, 6, 1)
    yield 'hexarotor with unequal arms', made(six, 'PNPNPN')
    yield 'measured coefficients', made(ring(6)[:, :2], 'PNPNPN', strength=uniform(0.92, 1.08, 6))
    yield 'a battery in front', made(ring(6)[:, :2], 'PPNNPN', centre=[uniform(-0.03, 0.03), 0, 0])
    yield 'five', made(np.column_stack([np.cos(np.arange(5) * 0.4 * np.pi + 0.1 * rng.normal()),
                                        np.sin(np.arange(5) * 0.4 * np.pi)]) * 0.4, 'PNPNP')
    eight = ring(8)[:, :2] * uniform(0.8, 1.2, 8, 1)
    yield 'octorotor with unequal arms', made(eight, 'PNPNPNPN')


def test_sound_vehicles_with_irregularities_are_not_named():
    rng = np.random.default_rng(0)
    named = [(name, each.text) for _ in range(length(20, 200)) for name, vehicle in sound(rng)
             for each in diagnose(vehicle)]
    assert named == []


def test_exchanged_rotors_of_a_quadrotor_are_named():
    vehicle = Vehicle.load('quadrotor')
    [cause] = diagnose(replace(vehicle, spins=vehicle.spins[[1, 0, 2, 3]]))
    assert cause.kind == 'order'
    assert {1, 2} <= {*cause.rotors}
    assert ' 1 and 2' in cause.text


def test_the_shift_of_the_centre_of_mass_is_that_of_the_slip():
    vehicle = Vehicle.load('hexarotor')
    [cause] = diagnose(replace(vehicle, arms=vehicle.arms - [-0.05, 0.0, 0.0]))
    assert cause.text == "the centre of mass is 5 cm behind the rotors' centre"
    [cause] = diagnose(replace(vehicle, arms=vehicle.arms - [0.0, 0.06, 0.0]))
    assert cause.text == "the centre of mass is 6 cm left of the rotors' centre"


def test_a_vehicle_without_symmetry_gets_no_explanation():
    rng = np.random.default_rng(4)
    for _ in range(30):
        vehicle = Vehicle.load('hexarotor')
        arms = vehicle.arms + np.column_stack([rng.normal(0, 0.1, (6, 2)), np.zeros(6)])
        assert diagnose(replace(vehicle, arms=arms)) == ()


# The command

def test_the_audit_names_the_cause_as_text_and_as_json(tmp_path, capsys):
    file = tmp_path / 'wrong.yaml'
    right = (shipped_vehicles()['hexarotor']).read_text()
    file.write_text(right.replace('spins: [cw, ccw, cw,', 'spins: [cw, ccw, ccw,'))
    assert file.read_text() != right
    assert main(['audit', str(file)]) == 3
    assert 'warning: rotor 3 turns the wrong way: flip its spin\n' in capsys.readouterr().out
    assert main(['audit', str(file), '--format', 'json']) == 3
    said = json.loads(capsys.readouterr().out)
    [cause] = said['causes']
    assert (cause['kind'], cause['rotors']) == ('spin', [3])
    assert said['failures']['none']['lost_axes'] == []
    assert main(['audit', 'hexarotor', '--format', 'json']) == 0
    said = json.loads(capsys.readouterr().out)
    assert said['causes'] == []
    assert said['failures']['rotor 1']['lost_axes'] == ['yaw']


def test_what_changes_between_two_vehicles_is_shown(capsys):
    assert main(['compare', 'hexarotor', 'hexarotor_ppnnpn']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ['hexarotor', 'hexarotor_ppnnpn']
    assert lines[1].split() == ['hover', 'margin', '[N,', 'N', 'm]', '0.191', '0.158']
    # The standard hexarotor loses yaw with rotor 1, this one does not.
    [line] = [line for line in lines if line.startswith('without rotor 1')]
    assert line.split('without rotor 1')[1].split('margin')[0].strip() == 'lost: yaw;'
    assert line.count('lost: -') == 1
    assert main(['compare', 'x8', 'x8']) == 0
    assert capsys.readouterr().out == 'x8 has the same ranges, margins and losses as x8\n'


# PX4's parameters

NUMBERS = ['--mass', '1', '--speed-min', '0', '--speed-max', '800', '--thrust-coefficient', '1e-5']


@pytest.mark.parametrize(('old', 'new', 'fault'), [
    ('CA_ROTOR3_PX', 'CA_ROTOR3_PXX', 'line 9: PX4 has no parameter CA_ROTOR3_PXX; did you mean '
     'CA_ROTOR3_PX?'),
    ('COUNT 4', 'COUNT 3', 'CA_ROTOR_COUNT is 3, but CA_ROTOR3_PX and CA_ROTOR3_PY place a '
     'rotor 3: expected a count of 4'),
    ('0.15', '150', 'a rotor is 150 m from the centre of mass of 1 kg: positions look like '
     'millimetres; --length 0.001 takes them for such'),
    ('0.15', '33', 'positions look like millimetres; --length 0.001 takes them for such: '
     '0.033 m'),
    ('CA_ROTOR2_PX 0.15', 'CA_ROTOR2_PX 150', 'CA_ROTOR2 (rotor 3) is 150 m from the centre of '
     'mass, the others within 0.15 m: its CA_ROTOR2_PX or _PY looks like millimetres (0.15 m)'),
    ('CA_ROTOR2_PX', 'CA_ROTR2_PX', 'line 6: PX4 has no parameter CA_ROTR2_PX; did you mean '
     'CA_ROTOR2_PX?'),
    ('CA_ROTOR2_PX', 'ca_rotor2_px', 'line 6: PX4 has no parameter ca_rotor2_px; did you mean '
     'CA_ROTOR2_PX?'),
    ('CA_ROTOR2_KM', 'CA_ROTER2_KM', 'line 8: PX4 has no parameter CA_ROTER2_KM; did you mean '
     'CA_ROTOR2_KM?'),
    ('CA_ROTOR0_PX', 'CA_ROTORO_PX', 'line 2: PX4 has no parameter CA_ROTORO_PX; did you mean '
     'CA_ROTOR0_PX?'),
    ('CA_ROTOR3_PY', 'CA_ROTORX_PY', 'PX4 has no parameter CA_ROTORX_PY; did you mean '
     'CA_ROTOR3_PY?'),
    ('ROTOR_COUNT', 'ROTR_COUNT', 'line 1: PX4 has no parameter CA_ROTR_COUNT; did you mean '
     'CA_ROTOR_COUNT?'),
    ('_PX 0.15', '_PX O.15', "line 2: CA_ROTOR0_PX: 'O.15' is not a number")])
def test_an_airframe_with_a_slip_is_refused(old, new, fault, tmp_path, capsys):
    file = tmp_path / 'airframe'
    file.write_text(QUAD_X.replace(old, new))
    numbers = ['--mass', '0.03', *NUMBERS[2:]] if new == '33' else NUMBERS
    assert main(['px4-parameters', 'from-px4', str(file), *numbers]) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert fault in err


@pytest.mark.parametrize(('line', 'warning'), [
    ('CA_ROTOR0_KM -0.05', 'rotor 1 turns the wrong way: flip its spin (CA_ROTOR0_KM, line 12)'),
    ('CA_ROTOR2_AZ 1', 'its axis has the wrong sign (CA_ROTOR2_AZ, line 12)'),
    ('CA_ROTOR2_KM -0.5', 'rotor 3 gives 10 times the torque of the others for the same thrust: '
     'torque_coefficient (CA_ROTOR2_KM, line 12)'),
    ('CA_ROTOR1_PX 0.0', 'rotor 2: x is 0 m from the centre of mass, where -0.15 m would fit'),
    ('CA_ROTOR1_CT 13', 'rotor 2 gives 2 times the thrust of the others'),
    ('CA_ROTOR0_CT 6.5', '')])
def test_an_airframe_that_may_be_wrong_is_imported_with_a_warning(
        line, warning, tmp_path, capsys):
    file = tmp_path / 'airframe'
    file.write_text(f'{QUAD_X}param set-default {line}\n')
    assert main(['px4-parameters', 'from-px4', str(file), *NUMBERS]) == 0
    out, err = capsys.readouterr()
    assert 'positions:' in out
    assert warning in err
    assert bool(warning) == bool(err)


def test_a_rotor_without_a_place_is_named(tmp_path, capsys):
    file = tmp_path / 'airframe'
    lines = QUAD_X.splitlines(keepends=True)
    file.write_text(''.join(line for line in lines if 'ROTOR2_P' not in line))
    assert main(['px4-parameters', 'from-px4', str(file), *NUMBERS]) == 0
    assert 'CA_ROTOR2 (rotor 3) is at the centre of mass: there is' in capsys.readouterr().err


def test_names_of_other_parameters_of_px4_are_no_slip():
    rest = ''.join(f'param set-default {name} 1\n' for name in (
        'CA_SV_CS_COUNT', 'CA_SV_CS0_TYPE', 'CA_SV_CS0_TRQ_P', 'CA_R0_SLEW', 'CA_METHOD',
        'CA_HELI_RPM_SP', 'CA_CS_LAUN_LK', 'PWM_MAIN_FUNC1', 'CA_MAX_SVO_THROW', 'CA_SV0_SLEW'))
    assert parameters.read(QUAD_X + rest)['CA_METHOD'] == 1.0


@pytest.mark.parametrize('command', [['audit'], ['compare', 'x8']])
@pytest.mark.parametrize('style', ['params', 'airframe', 'shell'])
def test_a_file_of_px4_in_place_of_a_vehicle_is_told(command, style, tmp_path, capsys):
    file = tmp_path / 'my.params'
    file.write_text(parameters.text(parameters.to_px4(Vehicle.load('x8')), style))
    assert main([*command, str(file)]) == 1
    assert 'parameters of PX4: ca_ros px4-parameters from-px4 makes' in capsys.readouterr().err


@pytest.mark.parametrize('space', ['\t', '  ', '\N{NO-BREAK SPACE}', '\N{EM SPACE}'])
def test_any_space_parts_the_words_of_a_line_of_px4(space, tmp_path):
    file, sound = tmp_path / 'my.params', parameters.to_px4(Vehicle.load('x8'))
    text = parameters.text(sound, 'airframe').replace(' ', space)
    file.write_text(text)
    assert parameters.read(text) == pytest.approx(sound)
    with pytest.raises(ParameterError, match='parameters of PX4'):
        Vehicle.load(file)
    # The end of a line is no space.
    assert px4_lines('param set\nCA_ROTOR_COUNT 4\n1 1\nCA_ROTOR_COUNT 4 6') == []


def test_a_file_that_has_all_parameters_of_px4_is_no_slip():
    # As QGroundControl saves them.
    rest = ''.join(
        f'param set CA_ROTOR{i}_{kind} {value}\n'
        for i in range(4, 12) for kind, value in parameters.DEFAULTS.items())
    assert len(parameters.read(QUAD_X + rest)) == 11 + 64


# Out again

def test_the_mixer_of_betaflight_is_its_own_for_a_quadrotor():
    """Mixer.md of Betaflight: rear right turns clockwise, front right counter-clockwise."""
    said = betaflight(Vehicle.load('quadrotor'), [3, 4, 2, 1])
    assert said.splitlines() == [
        'mixer CUSTOM', 'mmix reset',
        'mmix 0 1.000 -1.000 1.000 -1.000', 'mmix 1 1.000 -1.000 -1.000 1.000',
        'mmix 2 1.000 1.000 1.000 1.000', 'mmix 3 1.000 1.000 -1.000 -1.000', 'save']


def test_the_script_for_ardupilot_has_its_own_factors_for_a_hexarotor():
    """AP_MotorsMatrix, hexa plus: front, left in front, ... at angles of 0, 60, ... degrees."""
    lines = ardupilot(Vehicle.load('hexarotor')).splitlines()
    factors = [
        [float(word.strip(' )')) for word in line.partition('(')[2].split(',')]
        for line in lines if 'add_motor_raw' in line]
    angles = np.radians([0, -60, -120, 180, 120, 60])
    expected = np.column_stack([
        np.arange(6), np.cos(angles + np.pi / 2) / np.sin(np.pi / 3), np.cos(angles),
        [-1, 1, -1, 1, -1, 1], np.arange(1, 7)])
    np.testing.assert_allclose(factors, expected, atol=1e-6)
    assert 'assert(MotorsMatrix:init(6)' in lines[-2]


@pytest.mark.parametrize('name', [
    'quadrotor', 'hexarotor', 'hexarotor_ppnnpn', 'octorotor', 'x8', 'y6'])
def test_a_demand_about_one_axis_moves_no_other(name):
    vehicle = Vehicle.load(name)
    columns = mixer(vehicle)
    np.testing.assert_allclose(np.abs(columns).max(axis=0), 1.0, rtol=1e-12)
    effect = control_allocation_matrix(vehicle) @ columns
    np.testing.assert_allclose(effect, np.diag(np.diag(effect)), atol=1e-9)
    assert (np.diag(effect) > 0.0).all()


@pytest.mark.parametrize(('style', 'name', 'fault'), [
    ('betaflight', 'hexarotor_tilted', 'mixers have the axes thrust, roll, pitch, yaw'),
    ('ardupilot', 'tricopter', 'tilt'),
    ('ardupilot', 'rov', 'mixers have the axes')])
def test_what_a_mixer_cannot_do_is_refused(style, name, fault, capsys):
    assert main(['mixer', style, name]) == 1
    assert fault in capsys.readouterr().err


def test_unequal_ranges_and_too_many_motors_are_refused():
    vehicle = Vehicle.load('hexarotor')
    uneven = changed(vehicle, 'thrust_coefficient', 0, 0.9 * vehicle.thrust_coefficient[0])
    with pytest.raises(ValueError, match='unequal ranges'):
        mixer(uneven)
    count = MOTORS['betaflight'] + 2
    many = build(ring(count), 'PN' * (count // 2))
    with pytest.raises(ValueError, match='10 rotors, but betaflight has 8 motors at most'):
        betaflight(many)
    ardupilot(many)
    with pytest.raises(ValueError, match='each of the rotors 1 to 6 once'):
        betaflight(vehicle, [1, 2, 3, 4, 5, 5])
