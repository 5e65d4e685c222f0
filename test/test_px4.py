"""The conversions from and to PX4, on airframes and attitudes worked out by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from ca_ros import Exact, Vehicle, control_allocation_matrix, make_allocator
from ca_ros.__main__ import main
from ca_ros.px4 import frames as px4
from ca_ros.px4 import parameters
from ca_ros.vehicle.files import read
from strategies import FLEET, QUAD_X

S = np.sqrt(0.5)

FULL = 4.0
"""Greatest thrust of a rotor of these vehicles [N]: 2.5e-5 * 400^2."""


@pytest.fixture
def vehicle(tmp_path):
    """Return a function that makes the vehicle of an airframe."""
    def make(airframe, speeds=(0.0, 400.0), **options):
        file = tmp_path / 'vehicle.yaml'
        file.write_text(parameters.from_px4(
            parameters.read(airframe), 1.0, speeds, 2.5e-5, **options))
        return Vehicle.load(file)
    return make


# Odometry

def message(q=(1, 0, 0, 0), velocity=(0, 0, 0), **others):
    """Return the fields of a VehicleOdometry that the example reads."""
    given = {
        'pose_frame': 1, 'velocity_frame': 1, 'position': (1, 2, -3), 'q': q,
        'velocity': velocity, 'angular_velocity': (0.1, 0.2, 0.3)}
    return SimpleNamespace(**(given | others))


def test_nose_to_the_north_is_a_heading_of_90_degrees():
    """The heading is counted from the east."""
    position, attitude, velocity, rates = px4.state(message(velocity=(5, 0, 0)))
    assert_allclose(position, [2, 1, 3])
    assert_allclose(attitude, [0, 0, S, S], atol=1e-15)
    assert_allclose(velocity, [5, 0, 0], atol=1e-14)
    assert_allclose(rates, [0.1, -0.2, -0.3])


def test_any_attitude_is_that_of_the_matrices():
    # world ENU from NED, body FRD from FLU; independent: SciPy's rotations.
    world, body = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    for rotation in Rotation.random(50, random_state=0):
        x, y, z, w = rotation.as_quat()
        found = Rotation.from_quat(px4.attitude((w, x, y, z))).as_matrix()
        assert_allclose(found, world @ rotation.as_matrix() @ body, atol=1e-12)
        velocity = np.array([1.0, 2.0, 3.0])
        given = message((w, x, y, z), velocity)
        assert_allclose(px4.state(given)[2], body @ rotation.inv().apply(velocity))
        given = message((w, x, y, z), rotation.inv().apply(velocity), velocity_frame=3)
        assert_allclose(px4.state(given)[2], body @ rotation.inv().apply(velocity))


@pytest.mark.parametrize(('wrong', 'words'), [
    ({'pose_frame': 2}, 'pose_frame is 2, expected 1'),
    ({'velocity_frame': 2}, 'velocity_frame is 2, expected 1'),
    ({'q': (np.nan, 0, 0, 0)}, 'q is unknown'),
    ({'position': (0, 0, np.nan)}, 'position is unknown'),
])
def test_unknown_states_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        px4.state(message(**wrong))


# Set-points

def test_without_saturation_the_motors_are_those_of_px4(vehicle):
    """PX4's normalised mixer of a quadrotor X has 1/sqrt(2) for roll and pitch, 1 for the rest."""
    quad = vehicle(QUAD_X)
    roll, pitch, yaw, thrust = 0.1, -0.2, 0.05, 0.5
    u = px4.wrench((0, 0, -thrust), (roll, pitch, yaw), px4.units(quad))
    # Forward-left-up: to the right is positive too, nose up and to the right are negative.
    assert_allclose(np.sign(u[2:]), [1, 1, 1, -1])
    speeds = make_allocator('exact', quad).allocate(u[2:]).speeds
    # Front right and rear left turn counter-clockwise, front left and rear right clockwise.
    r, p = S * roll, S * pitch
    by_hand = [-r + p + yaw, r - p + yaw, r + p - yaw, -r - p - yaw]
    assert_allclose(controls(quad, speeds)[:4], thrust + np.array(by_hand))


@pytest.mark.parametrize('name', ['quadrotor', 'hexarotor', 'x8', 'y6', 'asymmetric'])
def test_the_units_normalise_the_motors_as_px4_says(name):
    """What PX4 promises of its normalised matrix, which is computed here from Gamma."""
    some = FLEET[name]
    full = some.thrust_coefficient * some.speed_max**2
    unit = px4.units(some)[2:] * [1, 1, 1, -1]
    mixer = np.linalg.pinv(control_allocation_matrix(some) * full) * unit
    changed = mixer[:, 1:3] ** 2
    level = [column[column > 1e-6].mean() for column in changed.T]
    assert np.abs(mixer[:, 0]).mean() == pytest.approx(1.0)
    assert max(level) == pytest.approx(0.5)
    assert mixer[:, 3].max() == pytest.approx(1.0)


def test_set_points_are_shares_of_the_units(vehicle):
    unit = px4.units(vehicle(QUAD_X))
    # Up is a negative thrust, nose down a negative pitch torque.
    thrust = 0.5 / unit[0], 0.3 / unit[1], -9.81 / (4 * FULL)
    torque = 0.2 / unit[3], 0.1 / unit[4], -0.05 / unit[5]
    assert_allclose(px4.wrench(thrust, torque, unit), [0.5, -0.3, 9.81, 0.2, -0.1, 0.05])


# Motors

def output(control, factor):
    """Return what PX4 makes of a control: the x of control = factor x^2 + (1 - factor) x."""
    roots = np.roots([factor, 1.0 - factor, -control]) if factor else [control]
    return max(np.real(roots))


def controls(vehicle, speeds, order=(), output='thrust', factor=0.0):
    return px4.Motors(vehicle, order, output, factor).convert(speeds)[0]


speeds = st.floats(40.0, 400.0)
QUAD = Vehicle.load('quadrotor')


@given(speeds)
def test_px4_gets_shares_of_the_greatest_thrust(speed):
    control = controls(QUAD, np.full(4, speed))[:4]
    assert_allclose(control, (2.5e-5 * speed**2) / (2.5e-5 * 400.0**2), rtol=1e-7)


@given(speeds, st.floats(1.0, 40.0), st.sampled_from([0.0, 0.3, 1.0]) | st.floats(1e-3, 1.0))
def test_px4_finds_the_output_that_sets_the_speed(speed, idle, factor):
    """With the throttles of Gazebo: 0 is the idle speed, 1 the greatest."""
    gazebo = Vehicle.from_parameters(read('quadrotor') | {
        'rotors.thrust_curve.speeds': [idle, 400.0], 'rotors.thrust_curve.throttles': [0.0, 1.0]})
    control = controls(gazebo, np.full(4, speed), [], 'throttle', factor)[0]
    assert idle + output(control, factor) * (400.0 - idle) == pytest.approx(speed, abs=0.1)


def test_px4_gets_its_own_order_and_nan_for_what_does_not_turn():
    sent = controls(QUAD, np.array([100.0, 200.0, 0.0, 400.0]), [2, 3, 1, 4], 'thrust', 0.0)
    assert (sent.dtype, sent.shape) == (np.float32, (12,))
    assert_allclose(sent[:4], [0.25, np.nan, 0.0625, 1.0])
    assert np.isnan(sent[4:]).all()


@pytest.mark.parametrize('wrong', [[401.0, 0, 0, 0], [-1.0, 0, 0, 0], [np.nan, 0, 0, 0], [100.0]])
def test_px4_gets_nothing_that_is_out_of_bounds(wrong):
    with pytest.raises(ValueError, match='rotor speeds'):
        controls(QUAD, np.array(wrong))


def test_px4_gets_full_thrust_with_more_than_the_nominal_voltage():
    """378 rad/s are the full throttle of 14 V, 400 the bound at any voltage."""
    some = Vehicle.load('hexarotor_realistic')
    full = Exact(some.at_voltage(16.0)).allocate([100.0, 0.0, 0.0, 0.0]).speeds
    assert_allclose(full, 400.0)
    for output in ('thrust', 'throttle'):
        assert_allclose(controls(some, full, [], output, 0.3)[:6], 1.0)


def test_the_land_detector_gets_the_force_of_all_rotors():
    some = FLEET['tilted_hexarotor']
    speeds = np.array([0.0, 100.0, 200.0, 300.0, 400.0, 200.0])
    _, force = px4.Motors(some, [], 'throttle', 0.3).convert(speeds)
    # Up, left and backwards are negative, right and forwards positive.
    expected = [1, -1, -1] * (some.thrusts(speeds) @ some.rotor_axes) / some.thrust_max.sum()
    assert_allclose(force, expected, atol=1e-7)
    assert force.dtype == np.float32
    _, full = px4.Motors(QUAD, [], 'thrust', 0.0).convert(np.full(4, 400.0))
    assert_allclose(full, [0, 0, -1])


# Parameters

def test_the_generic_quadrotor_as_a_vehicle(vehicle):
    quad = vehicle(QUAD_X)
    assert_allclose(
        quad.arms, [[0.15, -0.15, 0], [-0.15, 0.15, 0], [0.15, 0.15, 0], [-0.15, -0.15, 0]])
    assert_allclose(quad.rotor_axes, [[0, 0, 1]] * 4)
    # PX4's default of KM is positive: counter-clockwise, which is -1 here.
    assert_allclose(quad.spins, [-1, -1, 1, 1])
    assert_allclose(quad.torque_coefficient, 0.05 * 2.5e-5)


@pytest.mark.parametrize('name', ['hexarotor', 'x8', 'asymmetric', 'tilted_hexarotor'])
def test_the_parameters_of_px4_are_the_same_vehicle_seen_from_below(name):
    some = FLEET[name]
    order = np.random.default_rng(0).permutation(some.n)
    given = parameters.to_px4(some, (order + 1).tolist())
    assert given['CA_ROTOR_COUNT'] == some.n
    for motor, i in enumerate(order):
        place, axis = (
            np.array([given[f'CA_ROTOR{motor}_{kind}{axis}'] for axis in 'XYZ']) for kind in 'PA')
        # ActuatorEffectivenessRotors.cpp: thrust along the axis, moment p x a - km a.
        moment = np.cross(place, axis) - given[f'CA_ROTOR{motor}_KM'] * axis
        ours = control_allocation_matrix(some)[-3:, i]
        assert_allclose(moment, ours * [1.0, -1.0, -1.0], atol=1e-12)


def test_what_is_left_to_defaults_of_px4_is_named_in_the_file():
    text = parameters.from_px4(parameters.read(QUAD_X), 1.0, (0.0, 400.0), 2.5e-5)
    head = text.splitlines()[0]
    assert 'CA_ROTOR0_KM' in head
    assert 'CA_ROTOR2_KM' not in head


TILT = ''.join(f'param set-default CA_{line}\n' for line in (
    'AIRFRAME 8', 'SV_TL_COUNT 1', 'ROTOR2_TILT 1', 'SV_TL0_MINA -30', 'SV_TL0_MAXA 45',
    'SV_TL0_TD 90'))


def test_a_rotor_that_px4_tilts_to_the_right(vehicle):
    tilts = vehicle(QUAD_X + TILT).servos
    assert tilts.rotors == [2]
    assert_allclose(np.degrees(tilts.limits), [[-30], [45]])
    # At 30 degrees it points half to the right, which is -y here.
    assert_allclose(tilts.directions(np.radians([30]))[2], [0, -0.5, np.sqrt(0.75)], atol=1e-12)


def test_a_tricopter_to_px4_and_back(vehicle):
    tricopter = Vehicle.load('tricopter')
    given = parameters.to_px4(tricopter, [2, 1, 3])
    # The tail, motor 0, is at (-0.3, 0, 0) m and tilts to the left: torque about z alone.
    assert [name for name in given if name.endswith('_TILT')] == ['CA_ROTOR0_TILT']
    assert given['CA_SV_TL0_TD'] == 270
    assert given['CA_SV_TL0_CT'] == 1
    assert given['CA_SV_TL0_MAXA'] == pytest.approx(np.degrees(0.6))
    back = vehicle(parameters.text(given, 'airframe'))
    assert_allclose(back.servos.directions(np.array([0.4]))[0],
                    tricopter.servos.directions(np.array([0.4]))[1], atol=1e-8)
    for name, words in (('hexarotor_tilting', 'up to 4'), ('omnidirectional_gimbals', 'up to 4'),
                        ('azimuth_boat', 'upwards')):
        with pytest.raises(ValueError, match=words):
            parameters.to_px4(Vehicle.load(name))


@pytest.mark.parametrize(('airframe', 'words'), [
    ('rotors: 4', 'no CA_ROTOR_COUNT: expected an airframe'),
    (QUAD_X + 'param set-default CA_AIRFRAME 2\n', 'CA_AIRFRAME is 2: expected 0'),
    (QUAD_X + 'param set-default CA_ROTOR1_TILT 1\n', 'CA_AIRFRAME: expected 8'),
    (QUAD_X + TILT + 'param set-default CA_ROTOR1_TILT 2\n', 'is 2: CA_SV_TL_COUNT is 1'),
    (QUAD_X + TILT + 'param set-default CA_ROTOR1_TILT 1\n', 'a servo for each rotor'),
    (QUAD_X + 'param set-default CA_ROTOR1_KM 0\n', 'CA_ROTOR1_KM is 0: expected its sign'),
    (QUAD_X + 'param set-default CA_ROTOR1_CT 0\n', r'CA_ROTOR1 \(rotor 2\) has no axis or no'),
    (QUAD_X + 'param set-default CA_ROTOR1_AZ 0\n', r'CA_ROTOR1 \(rotor 2\) has no axis or no'),
    (QUAD_X + 'param set-default CA_ROTOR1_CT -6\n', 'CA_ROTOR1_CT is -6: expected above 0'),
    (QUAD_X + 'param set-default CA_R_REV 1\n', 'CA_R_REV: motors reverse'),
    (QUAD_X + 'param set-default CA_ROTOR_COUNT 13\n', 'CA_ROTOR_COUNT is 13: expected 1 to 12'),
    (QUAD_X + 'param set-default CA_ROTOR1_PX here\n', "CA_ROTOR1_PX: 'here' is not a number"),
])
def test_what_is_no_multirotor_is_refused(airframe, words):
    with pytest.raises(ValueError, match=words):
        parameters.from_px4(parameters.read(airframe), 1.0, (0.0, 400.0), 2.5e-5)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_normalised_positions_are_not_taken_for_metres(vehicle, sign):
    """As of 10040_sihsim_quadx and 10044_sihsim_hex, or of 4001_quad_x of 2026."""
    text = QUAD_X.replace('0.15', f'{sign:g}').replace('--', '')
    for airframe in (text, text.replace('CA_ROTOR0_PX 1', 'CA_ROTOR0_PX 0.866')):
        with pytest.raises(ValueError, match=r'positions are normalised.*: give --length'):
            parameters.from_px4(parameters.read(airframe), 1.0, (0.0, 400.0), 2.5e-5)
    arms = vehicle(text, length=0.2).arms
    assert_allclose(np.abs(arms), np.tile([0.2, 0.2, 0.0], (4, 1)))
    assert_allclose(np.abs(vehicle(text, length=1.0).arms[:, 0]), 1.0)
    # Metres stay metres.
    assert_allclose(np.abs(vehicle(QUAD_X).arms[:, 0]), 0.15)


def test_a_wrong_number_for_the_file_is_refused_by_its_name():
    given = parameters.read(QUAD_X)
    with pytest.raises(ValueError, match=r'^vehicle\.mass: must be positive'):
        parameters.from_px4(given, -1.0, (0.0, 400.0), 2.5e-5)
    with pytest.raises(ValueError, match=r'^rotors\.speed_m'):
        parameters.from_px4(given, 1.0, (500.0, 400.0), 2.5e-5)


@pytest.mark.parametrize(('reverse', 'found'), [('', 0), ('param set-default CA_R_REV 3\n', 3)])
def test_one_least_speed_is_for_motors_that_all_reverse(reverse, found):
    speeds = -300.0, 400.0
    with pytest.raises(ValueError, match=f'^CA_R_REV is {found}: .* expects 15, all motors'):
        parameters.from_px4(parameters.read(QUAD_X + reverse), 1.0, speeds, 2.5e-5)
    given = parameters.read(QUAD_X + 'param set-default CA_R_REV 15\n')
    assert 'speed_min: -300.0' in parameters.from_px4(given, 1.0, speeds, 2.5e-5)


def test_rotors_without_a_reaction_torque_are_read_back(vehicle):
    rov = Vehicle.load('rov')
    back = vehicle(parameters.text(parameters.to_px4(rov), 'params'), speeds=(-400.0, 400.0))
    assert_allclose(back.torque_coefficient, 0.0)
    ours = control_allocation_matrix(replace(back, axes=rov.axes))
    assert_allclose(ours, control_allocation_matrix(rov), atol=1e-7)


def test_motors_that_reverse_are_marked():
    assert parameters.to_px4(Vehicle.load('rov'))['CA_R_REV'] == 2**8 - 1
    assert 'CA_R_REV' not in parameters.to_px4(Vehicle.load('quadrotor'))


def test_the_commands_for_both_ways(tmp_path, capsys):
    file, vehicle = tmp_path / 'my.params', tmp_path / 'my.yaml'

    def convert(*arguments):
        code = main(['px4-parameters', *map(str, arguments)])
        return code, *capsys.readouterr()

    _, there, _ = convert('to-px4', 'hexarotor', '--style', 'params')
    assert there.splitlines()[1] == '1\t1\tCA_ROTOR_COUNT\t6\t6'
    file.write_text(there)
    numbers = (
        '--mass', 1, '--speed-min', 40, '--speed-max', 400, '--thrust-coefficient', 2.5e-5)
    code, back, err = convert('from-px4', file, *numbers, '--inertia', 0.015, 0.015, 0.03)
    assert (code, err) == (0, '')
    vehicle.write_text(back)
    found, expected = Vehicle.load(vehicle), Vehicle.load('hexarotor')
    for name in ('mass', 'inertia', 'thrust_min', 'thrust_max'):
        assert_allclose(getattr(found, name), getattr(expected, name))
    assert_allclose(
        control_allocation_matrix(found), control_allocation_matrix(expected), atol=1e-9)
    code, _, err = convert('from-px4', vehicle, *numbers)
    assert (code, err.startswith('ca_ros px4-parameters: no CA_ROTOR_COUNT')) == (1, True)
