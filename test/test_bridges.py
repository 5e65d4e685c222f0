"""Motors of others: order, signs and models; vehicles from URDF."""

import importlib.util
import re
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from ca_ros import ParameterError, Vehicle
from ca_ros.__main__ import main
from ca_ros.arguments import rotor_rows
from ca_ros.px4 import frames
from ca_ros.vehicle.formats import gazebo
from ca_ros.vehicle.formats.urdf import read_urdf
from nodes import refused
from strategies import FLEET

EXAMPLE = Path(__file__).resolve().parent.parent / 'examples' / 'motor_commands.py'
PAGE = Path(__file__).resolve().parent.parent / 'docs' / 'px4.md'


# Motors

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


@pytest.mark.skipif(not PAGE.is_file(), reason='docs/ is not beside the tests')
def test_the_motor_models_of_the_x500_are_those_of_px4(tmp_path, capsys):
    """models/x500/model.sdf of PX4-gazebo-models."""
    [x500] = re.findall(r'<!-- file x500.yaml -->\n```yaml\n(.*?)```', PAGE.read_text(), re.DOTALL)
    (tmp_path / 'x500.yaml').write_text(x500)
    assert main(['gazebo-motors', str(tmp_path / 'x500.yaml')]) == 0
    models = ElementTree.fromstring(f'<sdf>{capsys.readouterr().out}</sdf>')
    names = (
        'motorNumber', 'turningDirection', 'maxRotVelocity', 'motorConstant', 'momentConstant')
    assert [[model.findtext(name) for name in names] for model in models] == [
        [str(number), spin, '1000', '8.54858e-06', '0.016']
        for number, spin in enumerate(['ccw', 'ccw', 'cw', 'cw'])]
    assert {model.get('filename') for model in models} == {'gz-sim-multicopter-motor-model-system'}


def test_the_order_of_the_motors():
    assert rotor_rows(0.0, 3) == rotor_rows([], 3) == [0, 1, 2]
    assert rotor_rows([3.0, 1.0, 2.0], 3) == [2, 0, 1]
    for wrong in ([1, 2], [1, 2, 2], [0, 1, 2], [2.4, 3, 1], [0.4]):
        with pytest.raises(ParameterError, match=r'^px4\.order: expected each'):
            rotor_rows(wrong, 3, 'px4.order')


@pytest.mark.parametrize('wrong', [
    [100.0] * 5, [np.nan] * 6, [1e308] * 6, [-300.0] * 6, [400.0 * (1.0 + 1e-12)] * 6])
def test_px4_gets_no_speeds_that_are_none_of_the_vehicle(wrong):
    motors = frames.Motors(Vehicle.load('hexarotor'), [], 'thrust', 0.0)
    motors.convert(np.array([400.0] * 6))
    with pytest.raises(ValueError, match='rotor speeds'):
        motors.convert(np.array(wrong))


def test_gazebo_takes_no_rotors_that_tilt():
    with pytest.raises(ParameterError, match='model of Gazebo takes fixed rotors only'):
        gazebo.motor_models(Vehicle.load('tricopter'))


def test_a_restart_of_the_states_reaches_controller_and_monitor(graph):
    from ca_ros.nodes.topics import STATE_RESTART
    from ca_ros.testing import Diagnostics

    names = 'controller', 'monitor'
    for name in names:
        graph.start(name, '--vehicle', 'hexarotor')
    diagnostics = Diagnostics(graph)
    sender = graph.publisher(STATE_RESTART.kind, STATE_RESTART.name)

    def counted(name):
        return any('restarts' in status.values for status in diagnostics.all(name))

    graph.spin_until(
        lambda: all(map(counted, names)), 'restarts', lambda: sender.publish(STATE_RESTART.kind()))


@pytest.mark.slow
def test_without_its_messages_the_bridge_says_so_in_one_line():
    if not importlib.util.find_spec('px4_msgs'):
        refused([(('px4_bridge', '--vehicle', 'quadrotor'), ['px4_bridge: needs px4_msgs: '])])


# Other motors

@pytest.mark.skipif(not EXAMPLE.is_file(), reason='examples/ is not beside the tests')
def test_the_example_takes_the_command_of_the_page(graph):
    from std_msgs.msg import Float64MultiArray

    joints = graph.listen(Float64MultiArray, '/rotor_controller/commands')
    speeds = graph.publisher(Float64MultiArray, 'command/motor_speed')
    graph.start(
        sys.executable, str(EXAMPLE), 'hexarotor', '--ros-args', '-r',
        'commands:=/rotor_controller/commands', exit_codes=(1, -2))
    graph.spin_until(
        lambda: joints, 'joints', lambda: speeds.publish(Float64MultiArray(data=[100.0] * 6)))
    assert joints[0].data.tolist() == [-100.0, 100.0] * 3
    for words in ([], ['hexarotor', 'speed']):
        run = subprocess.run(
            [sys.executable, str(EXAMPLE), *words], capture_output=True, text=True, check=False)
        assert (run.returncode, run.stderr.split(':')[0]) == (1, 'motor_commands')


@pytest.mark.skipif(not EXAMPLE.is_file(), reason='examples/ is not beside the tests')
def test_the_example_gives_joints_their_signs_and_actuators_their_speeds(graph):
    from std_msgs.msg import Float64MultiArray

    node = runpy.run_path(str(EXAMPLE))['MotorCommands'](
        'quadrotor', [4, 3, 2, 1], context=graph.context)
    graph.add_node(node)
    sender = graph.publisher(Float64MultiArray, 'command/motor_speed')
    received = graph.listen(Float64MultiArray, 'commands')
    graph.spin_until(
        lambda: received, 'velocities', lambda: (
            sender.publish(Float64MultiArray(data=[1.0])),
            sender.publish(Float64MultiArray(data=[100.0, 200.0, 0.0, 400.0]))))
    # The quadrotor's spins are cw, ccw, cw, ccw; motor 1 is rotor 4.
    assert list(received[0].data) == [400.0, 0.0, 200.0, -100.0]


# URDF

URDF = """\
<robot name="quad">
  <link name="base_link"><inertial><origin xyz="0 0 0.01"/><mass value="1.0"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  {rotors}
</robot>
"""
ROTOR = """
  <joint name="arm_{i}" type="fixed"><parent link="base_link"/><child link="arm_{i}"/>
    <origin xyz="0 0 0" rpy="0 0 {angle}"/></joint>
  <link name="arm_{i}"/>
  <joint name="turn_{i}" type="continuous"><parent link="arm_{i}"/><child link="rotor_{i}"/>
    <origin xyz="0.2 0 0.05" rpy="{tilt} 0 0"/><axis xyz="0 0 1"/></joint>
  <link name="rotor_{i}"><inertial><mass value="0.02"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""


def urdf(tilt=0.0):
    """Return the URDF of a quadrotor X whose rotors are tilted about their arms [rad]."""
    return URDF.format(rotors=''.join(
        ROTOR.format(i=i, angle=np.pi / 4 + i * np.pi / 2, tilt=tilt) for i in range(4)))


def test_a_urdf_by_hand():
    """The rotors are 0.2 m from the axis; they move the centre up by 4 * 0.02 * 0.04 / 1.08 m."""
    model = read_urdf(urdf(), [f'rotor_{i}' for i in range(4)])
    side = 0.2 * np.sqrt(0.5)
    assert_allclose(model.positions, [
        [side, side, 0.05], [-side, side, 0.05], [-side, -side, 0.05], [side, -side, 0.05]])
    assert_allclose(model.axes, [[0, 0, 1]] * 4)
    assert model.mass == pytest.approx(1.08)
    height = (0.01 + 0.08 * 0.05) / 1.08
    assert_allclose(model.center, [0, 0, height], atol=1e-15)
    # Steiner: about z only the rotors' distances count.
    assert model.inertia[2, 2] == pytest.approx(0.02 + 4 * (2e-5 + 0.02 * 0.2**2))
    up = 1.0 * (height - 0.01) ** 2 + 0.08 * (0.05 - height) ** 2
    assert model.inertia[0, 0] == pytest.approx(0.01 + 4 * (1e-5 + 0.02 * side**2) + up)


def test_the_axes_of_tilted_rotors_are_those_of_scipy():
    axes = read_urdf(urdf(0.3), [f'rotor_{i}' for i in range(4)]).axes
    for i, axis in enumerate(axes):
        turn = Rotation.from_euler('Z', np.pi / 4 + i * np.pi / 2) * Rotation.from_euler('x', 0.3)
        assert_allclose(axis, turn.apply([0.0, 0.0, 1.0]), atol=1e-11)


def test_the_command_prints_a_vehicle(tmp_path, capsys):
    file, out = tmp_path / 'quad.urdf', tmp_path / 'quad.yaml'
    file.write_text(urdf())
    command = [
        'from-urdf', str(file), '--spins', 'cw', 'ccw', 'cw', 'ccw', '--speed-min', '40',
        '--speed-max', '400', '--thrust-coefficient', '2.5e-5', '--torque-coefficient', '5e-7']
    assert main([*command, '--rotors', *(f'rotor_{i}' for i in range(4))]) == 0
    out.write_text(capsys.readouterr().out)
    vehicle = Vehicle.load(out)
    assert (vehicle.n, vehicle.mass) == (4, pytest.approx(1.08))
    assert_allclose(vehicle.arms[:, 2], 0.05 - 0.014 / 1.08)
    assert main([*command, '--rotors', 'rotor_9']) == 1
    assert 'rotor_9: no link with a joint; continuous joints turn rotor_0' in (
        capsys.readouterr().err)
    assert main([*command, '--rotors', 'rotor_0', 'rotor_1', 'rotor_2', 'rotor_0']) == 1
    assert 'rotor_0: named twice' in capsys.readouterr().err
    file.write_text(urdf().replace('continuous', 'fixed'))
    assert main([*command, '--rotors', 'rotor_9']) == 1
    assert 'continuous joints turn no link' in capsys.readouterr().err


@pytest.mark.parametrize(('wrong', 'words'), [
    ('<robot', 'no URDF'),
    (urdf().replace('value="1.0"', ''), 'base_link: <inertial> without a number value'),
    (urdf().replace('xyz="0.2 0 0.05"', 'xyz="0.2 0"', 1), "turn_0: xyz='0.2 0': expected three"),
    (urdf().replace('<parent link="base_link"/>', '<parent link="rotor_0"/>'), 'form a ring'),
])
def test_a_broken_urdf_is_refused(wrong, words):
    with pytest.raises(ParameterError, match=re.escape(words)):
        read_urdf(wrong, [f'rotor_{i}' for i in range(4)])
