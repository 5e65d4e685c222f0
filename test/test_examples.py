"""The adapters in examples/: what they send, without the packages that they send it to."""

import importlib.util
import re
import signal
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import Vehicle
from strategies import EXAMPLES, FLEET, example, run_example

FILES = sorted(EXAMPLES.glob('*.py'))
PAGE = EXAMPLES.parent / 'docs' / 'px4.md'
if not FILES or not PAGE.is_file():
    pytest.skip('examples/ and docs/ are not beside the tests', allow_module_level=True)


gazebo, px4, joints = map(
    example, ('gazebo_actuators', 'px4_actuator_motors', 'ros2_control_velocities'))


# Gazebo

def test_gazebo_gets_the_speeds_as_they_are():
    assert gazebo.velocities(np.array([0.0, 40.0, 400.0])) == [0.0, 40.0, 400.0]
    for wrong in (-1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match='none negative'):
            gazebo.velocities([wrong])


@pytest.mark.parametrize('name', ['hexarotor', 'x8', 'asymmetric'])
def test_the_motor_models_give_the_yaw_torque_of_the_allocation_matrix(name):
    vehicle = FLEET[name]
    models = ElementTree.fromstring(f'<sdf>{gazebo.motor_models(vehicle)}</sdf>')
    assert [int(model.findtext('motorNumber')) for model in models] == list(range(vehicle.n))
    for model, i in zip(models, range(vehicle.n), strict=True):
        # MulticopterMotorModel.cc: thrust k w^2, torque -direction * thrust * moment constant.
        sign = {'ccw': -1.0, 'cw': 1.0}[model.findtext('turningDirection')]
        thrust = float(model.findtext('motorConstant')) * 100.0**2
        torque = sign * thrust * float(model.findtext('momentConstant'))
        assert thrust == pytest.approx(vehicle.thrust_coefficient[i] * 100.0**2)
        assert torque == pytest.approx(
            vehicle.spins[i] * vehicle.torque_coefficient[i] * 100.0**2)
        assert float(model.findtext('maxRotVelocity')) == pytest.approx(vehicle.speed_max[i])


def test_the_motor_models_of_the_x500_are_those_of_px4(tmp_path):
    """models/x500/model.sdf of PX4-gazebo-models."""
    [x500] = re.findall(r'<!-- file x500.yaml -->\n```yaml\n(.*?)```', PAGE.read_text(), re.DOTALL)
    (tmp_path / 'x500.yaml').write_text(x500)
    models = ElementTree.fromstring(
        f'<sdf>{gazebo.motor_models(Vehicle.load(tmp_path / "x500.yaml"))}</sdf>')
    names = (
        'motorNumber', 'turningDirection', 'maxRotVelocity', 'motorConstant', 'momentConstant')
    assert [[model.findtext(name) for name in names] for model in models] == [
        [str(number), spin, '1000', '8.54858e-06', '0.016']
        for number, spin in enumerate(['ccw', 'ccw', 'cw', 'cw'])]
    assert {model.get('filename') for model in models} == {'gz-sim-multicopter-motor-model-system'}


# PX4

def output(control, factor):
    """Return what PX4 makes of a control: the x of control = factor x^2 + (1 - factor) x."""
    roots = np.roots([factor, 1.0 - factor, -control]) if factor else [control]
    return max(np.real(roots))


speeds = st.floats(40.0, 400.0)


@given(speeds)
def test_px4_gets_shares_of_the_greatest_thrust(speed):
    [control] = px4.thrust_controls(np.array([speed]), np.array([400.0]))
    assert control == pytest.approx((2.5e-5 * speed**2) / (2.5e-5 * 400.0**2), rel=1e-12)
    assert 0.0 < control <= 1.0


@given(speeds, st.floats(0.0, 40.0), st.sampled_from([0.0, 0.3, 1.0]) | st.floats(1e-3, 1.0))
def test_px4_finds_the_output_that_sets_the_speed(speed, idle, factor):
    [control] = px4.speed_controls(np.array([speed]), np.array([400.0]), idle, factor)
    assert idle + output(control, factor) * (400.0 - idle) == pytest.approx(speed, abs=1e-3)


def test_px4_gets_its_own_order_and_nan_for_what_does_not_turn():
    turning, top = np.array([100.0, 200.0, 0.0]), np.full(3, 400.0)
    sent = px4.fields(px4.thrust_controls(turning, top), turning, [2, 3, 1])
    assert sent.dtype == np.float32
    assert sent.shape == (12,)
    np.testing.assert_array_equal(sent[:3], np.array([0.25, np.nan, 0.0625], dtype=np.float32))
    assert np.isnan(sent[3:]).all()


@pytest.mark.parametrize('wrong', [[401.0, 0.0], [-1.0, 0.0], [np.nan, 0.0], [100.0]])
def test_px4_gets_nothing_that_is_out_of_bounds(wrong):
    with pytest.raises(ValueError, match='rotor speeds'):
        px4.thrust_controls(np.array(wrong), np.full(2, 400.0))
    with pytest.raises(ValueError, match='below the idle speed'):
        px4.speed_controls(np.array([20.0]), np.full(1, 400.0), 40.0, 0.0)


# ros2_control

def test_joints_turn_clockwise_by_a_minus():
    vehicle = Vehicle.load('hexarotor')
    signs = np.sign(joints.joint_velocities(np.full(6, 100.0), vehicle.spins))
    np.testing.assert_array_equal(signs, [-1, 1, -1, 1, -1, 1])
    with pytest.raises(ValueError, match='5 rotor speeds for 6 rotors'):
        joints.joint_velocities([1.0] * 5, vehicle.spins)


def test_joint_velocities_arrive(graph):
    from std_msgs.msg import Float64MultiArray

    process = graph.start(
        sys.executable, str(EXAMPLES / 'ros2_control_velocities.py'), '--vehicle', 'quadrotor',
        '--ros-args', '-r', '~/commands:=/rotor_controller/commands')
    sender = graph.publisher(Float64MultiArray, 'command/motor_speed')
    received = graph.listen(Float64MultiArray, '/rotor_controller/commands')
    graph.spin_until(
        lambda: received, 'velocities', lambda: (
            sender.publish(Float64MultiArray(data=[1.0])),
            sender.publish(Float64MultiArray(data=[100.0, 200.0, 300.0, 400.0]))))
    expected = joints.joint_velocities(
        [100.0, 200.0, 300.0, 400.0], Vehicle.load('quadrotor').spins)
    assert list(received[0].data) == expected
    _, err = graph.end(process, signal.SIGTERM)
    assert 'Traceback' not in err
    assert process.returncode == 0


# All of them

@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_help(file):
    code, out, err = run_example(file.stem, '--help')
    assert (code, err) == (0, '')
    ours = file.stem in ('px4_parameters', 'design_study')
    assert ('--ros-args' in out) != ours


@pytest.mark.parametrize(('name', 'arguments', 'package'), [
    ('gazebo_actuators', [], 'actuator_msgs'),
    ('px4_actuator_motors', ['--vehicle', 'quadrotor'], 'px4_msgs'),
    ('px4_odometry', [], 'px4_msgs'),
    ('px4_setpoints', ['--vehicle', 'quadrotor'], 'px4_msgs')])
def test_without_its_messages_an_example_says_so_in_one_line(name, arguments, package):
    if importlib.util.find_spec(package):
        pytest.skip(f'{package} is installed')
    code, _, err = run_example(name, *arguments)
    assert code == 1
    [line] = err.splitlines()
    assert line.startswith(f'{name}: ')
    assert package in line


NUMBERS = [
    '--mass', '1', '--speed-min', '0', '--speed-max', '400', '--thrust-coefficient', '2.5e-5']


@pytest.mark.parametrize(('name', 'arguments', 'words'), [
    ('gazebo_actuators', ['--sdf', 'nope'], ['nope', 'hexarotor']),
    ('ros2_control_velocities', ['--vehicle', 'nope'], ['nope', 'hexarotor']),
    ('px4_actuator_motors', ['--vehicle', 'nope'], ['nope', 'hexarotor']),
    ('px4_setpoints', ['--vehicle', 'nope'], ['nope', 'hexarotor']),
    ('px4_parameters', ['to-px4', 'nope'], ['nope', 'hexarotor']),
    ('px4_parameters', ['to-px4', 'quadrotor', '--order', '1,2,3,3'], ['--order', 'once']),
    ('px4_parameters', ['to-px4', 'quadrotor', '--order', '1,2,3,x'], ['--order', 'once']),
    ('px4_parameters', ['from-px4', 'nope', *NUMBERS], ['nope']),
    ('px4_actuator_motors', ['--vehicle', 'quadrotor', '--order', '1,2,3'], ['--order', '4', '3']),
    ('px4_actuator_motors', ['--vehicle', 'quadrotor', '--order', '1,2,3,3'], ['--order', 'once']),
    ('px4_actuator_motors', ['--vehicle', 'quadrotor', '--thrust-factor', 'nan'], ['0 to 1']),
    ('px4_actuator_motors', ['--vehicle', 'quadrotor', '--idle-speed', '1e9'], ['--idle-speed']),
])
def test_a_wrong_option_is_refused_by_name(name, arguments, words):
    code, out, err = run_example(name, *arguments)
    assert (bool(code), out) == (True, '')
    last = err.splitlines()[-1]
    assert last.startswith(name)
    assert [word for word in words if word not in last] == []
