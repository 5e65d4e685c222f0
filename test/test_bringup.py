"""The bringup script: flights over DDS, and how they end."""

import math
import os
import signal
import subprocess
from collections import Counter
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import yaml
from geometry_msgs.msg import PoseStamped
from matplotlib import image

from ca_ros import Vehicle
from ca_ros.bringup import flight
from ca_ros.bringup.bringup import main, write_results
from ca_ros.bringup.flight import Flown, agreed
from ca_ros.bringup.options import parse
from ca_ros.errors import CaRosError
from ca_ros.parameter_files import DECLARED
from ca_ros.process import processes
from ca_ros.testing import DEADLINE, executable
from ca_ros_cli import NODES
from nodes import ended, fly_in_real_time, fly_offline, read
from strategies import file_values, length

HOVER_SPEED = math.sqrt(1.0 * 9.81 / (6 * 2.5e-5))
"""m g / 6 = k_f omega^2: 255.73 rad/s."""


# make demo flies the same.
@pytest.mark.long
@pytest.mark.timeout(3600)
def test_real_time_reaches_the_waypoint_within_the_bounds(tmp_path, graph):
    def flight(factor):
        # A stall of the machine is not a loss of commands.
        process = graph.start(
            'bringup', '--method', 'exact', '--out', str(tmp_path), '--duration', '8',
            '--ros-args', '-p', 'command_timeout:=1000.0',
            '-p', f'simulator.real_time_factor:={factor}')
        out, err = graph.outlive(process, DEADLINE / factor)
        assert process.returncode == 0, out + err
        assert 'reached' in out
        assert 'Traceback' not in err
        table = read(tmp_path)
        last = table[-1]
        assert math.dist([last['x'], last['y'], last['z']], [1.0, 1.0, 1.0]) <= 0.02
        assert abs(last['yaw'] - math.radians(45.0)) <= math.radians(0.5)
        speeds = np.column_stack([table[f'speed_{i}'] for i in range(1, 7)])
        assert np.all((speeds >= 40.0) & (speeds <= 400.0))
        np.testing.assert_allclose(speeds[-1], HOVER_SPEED, atol=0.5)
        steps = np.diff(table['t']) / 0.01
        np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
        # In real time the simulator keeps one message, so that any of them may be lost.
        assert table['t'][[0, -1]] == pytest.approx([0.0, 8.0], abs=0.05)

    fly_in_real_time(flight)
    picture = image.imread(tmp_path / 'flight.png')
    assert min(picture.shape[:2]) >= 1000
    assert picture[..., :3].std() > 0.05


# What is flown is what is judged

def write(path, content):
    """Write a parameter file."""
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')
    return str(path)


def test_it_judges_what_the_arguments_for_ros_make_it_fly(graph, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    x8 = file_values('x8')
    keyed = write(tmp_path / 'keyed.yaml', {'/a/*': {'ros__parameters': x8}} | {
        f'/a/{node}': {'ros__parameters': values} for node, values in {
            'simulator': {'vehicle.mass': 1.1 * x8['vehicle.mass']},
            'controller': {'controller.speed_max': 2.0, 'vehicle.gravity': 9.8}}.items()})
    err = flown_briefly(
        graph, '--figures', 'svg', '--figure-width', 'column',
        '--ros-args', '--params-file', keyed, '-r', '__ns:=/a', '-p', 'mode:=lockstep')
    assert [line for line in err.splitlines() if line.startswith('bringup: ')] == [
        'bringup: warning: the controller has another vehicle than other nodes: '
        'see vehicle.gravity',
        'bringup: warning: the simulator has another vehicle than other nodes: see vehicle.mass']
    [folder] = tmp_path.glob('flight_*')
    assert 'speed_8' in read(folder).dtype.names
    # A column has 88 mm: 249.4 points.
    assert 'width="249.4' in (folder / 'flight.svg').read_text(encoding='utf-8')


@pytest.mark.long
def test_a_dump_of_parameters_is_a_vehicle(graph, tmp_path):
    # As `ros2 param dump` writes it.
    dump = write(tmp_path / 'dump.yaml', {'/b/allocator': {'ros__parameters': {
        'start_type_description_service': True, 'use_sim_time': False, **file_values('x8')}}})
    err = flown_briefly(
        graph, '--vehicle', dump, '--namespace', 'b', '--mode', 'lockstep', '--out', str(tmp_path))
    assert 'bringup: ' not in err
    assert 'speed_8' in read(tmp_path).dtype.names


def flown_briefly(graph, *arguments):
    """Fly for 0.1 s, too short for the waypoint; return what was said."""
    flight = graph.start('bringup', '--duration', '0.1', *arguments)
    out, err = ended(graph, flight, 1)
    assert out.startswith('flight of 0.10 s (lockstep, 11 samples'), out + err
    assert 'within bounds' in out
    assert 'MISSED' in out
    assert 'no --vehicle' not in err
    return err


@pytest.mark.parametrize(('options', 'told'), [
    (['--vehicle', 'x8'], True), (['--vehicle', 'x8', '--namespace', '/a'], True),
    # There the monitor has a lag, or warns that it has none.
    (['--vehicle', 'hexarotor_realistic'], False), (['--vehicle', 'x8', '--plant', 'true'], False),
    (['--vehicle', 'x8', '--ros-args', '-p', 'simulator.motor_time_constant:=0.05'], False),
    (['--vehicle', 'x8', '--ros-args', '--params-file', 'own.yaml'], False)])
def test_the_monitor_is_told_that_simulated_motors_have_no_lag(
        options, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'own.yaml').touch()
    lines = parse([*options[:2], '--detect', *options[2:]]).commands()
    without = [name for name in lines if 'detector.motor_time_constant:=0.0' in lines[name]]
    assert without == ['monitor'] * told


def test_only_parameters_that_both_nodes_declare_are_compared(capsys):
    vehicle = file_values('hexarotor')
    parameters = dict.fromkeys(NODES, vehicle) | {'simulator': {'vehicle.name': 'hexarotor'}}
    agreed(parameters, {})
    assert 'has another vehicle' not in capsys.readouterr().err
    parameters['simulator'] = {'vehicle.name': 'other'}
    agreed(parameters, {})
    said = 'warning: the simulator has another vehicle than other nodes: see vehicle.name\n'
    assert said in capsys.readouterr().err


@pytest.mark.parametrize('node', ['allocator', 'simulator'])
def test_a_node_in_another_mode_is_refused(node):
    parameters = {
        name: file_values('hexarotor', kind=DECLARED[name]) | {'mode': 'lockstep'}
        for name in NODES}
    agreed(parameters, {'mode': 'lockstep'})
    parameters[node]['mode'] = 'realtime'
    said = f'mode of the {node} is realtime, not lockstep: see the parameter files and the ROS arg'
    with pytest.raises(CaRosError, match=said):
        agreed(parameters, {'mode': 'lockstep'})


@pytest.mark.parametrize(('node', 'topic'), [
    *length([], [('allocator', 'command/motor_speed')]),
    ('fault_proxy', 'faulty/command/motor_speed')])
def test_it_does_not_start_where_another_loop_is(graph, tmp_path, node, topic):
    graph.start(node, '--ros-args', '-r', '__ns:=/uav1', '-r', '__node:=mine')
    graph.spin_until(
        lambda: ('mine', '/uav1') in graph.node.get_node_names_and_namespaces(), node)
    flight = graph.start(
        'bringup', '--namespace', 'uav1', '--out', str(tmp_path), '--faults', '')
    out, err = graph.outlive(flight)
    assert (flight.returncode, out) == (1, ''), err
    [line] = [line for line in err.splitlines() if line.startswith('bringup: ')]
    assert line.startswith('bringup: other nodes publish on /uav1/')
    assert f'/uav1/{topic}' in line
    assert f'in ROS domain {graph.domain}: end them' in line


def test_a_node_with_the_name_of_another_is_named(graph, tmp_path):
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-r', '__ns:=/uav1',
                '-r', '__node:=allocator')
    graph.spin_until(
        lambda: ('allocator', '/uav1') in graph.node.get_node_names_and_namespaces(), 'monitor')
    out, err = graph.outlive(
        graph.start('bringup', '--figures', 'none', '--namespace', 'uav1', '--duration', '0.2',
                    '--out', str(tmp_path)))
    assert 'Traceback' not in err
    # Which of the two nodes answers is a matter of chance.
    if not out.startswith('flight of 0.20 s'):
        [line] = [line for line in err.splitlines() if line.startswith('bringup: ')]
        assert line == (
            'bringup: /uav1/allocator lacks parameters of the allocator: another node has its '
            'name; end it, or choose another --namespace')


def test_without_markers_view_says_what_it_needs(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr('ca_ros.bringup.options.MARKERS', None)
    assert main(['--view', '--out', str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith('bringup: --view: needs visualization_msgs: ')


@pytest.mark.parametrize('name', ['flight.csv'])
def test_a_full_disk_is_reported_with_the_file(tmp_path, name):
    (tmp_path / name).symlink_to('/dev/full')
    vehicle = file_values('hexarotor')
    flown = Flown(
        fly_offline('exact', 0.1), 0.1, Counter(), Counter(), Counter(), vehicle,
        Vehicle.from_parameters(vehicle), {})
    with pytest.raises(OSError, match=f'^{tmp_path / name}: No space left on device$'):
        write_results(parse([]), tmp_path, flown)


# Flights that end before their time

def test_a_wait_says_what_it_waits_for_before_it_ends(monkeypatch, capsys):
    monkeypatch.setattr(flight, 'PROGRESS_TIMEOUT', 0.05)
    monkeypatch.setattr(flight, 'NOTICE', 0.02)
    # The time is that of the test: the machine may be busy.
    now = [0.0]
    monkeypatch.setattr(processes, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    patience = flight.Patience()

    def wait():
        while True:
            patience.check('{:g} s without a wheel'.format)
            now[0] += 0.01

    with pytest.raises(flight.CaRosError, match=r'^0\.05 s without a wheel$'):
        wait()
    assert capsys.readouterr().err.splitlines()[0] == (
        'bringup: 0.02 s without a wheel; waiting up to 0.05 s')


def fly_on(graph, *arguments):
    """Start a flight that does not end, and return it when it has left the ground."""
    flight = graph.start(
        'bringup', '--mode', 'lockstep', '--duration', '1e6', '--namespace', 'uav1', *arguments)
    poses = graph.listen(PoseStamped, '/uav1/local_position/pose')
    graph.spin_until(lambda: poses and poses[-1].pose.position.z > 0.01, 'a flight')
    return flight


@pytest.mark.parametrize(('number', 'code'), [
    (signal.SIGINT, 130), *length([], [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])])
def test_a_signal_while_the_nodes_start_ends_all(graph, tmp_path, number, code):
    flight = graph.start('bringup', '--out', str(tmp_path))
    graph.spin_until(lambda: len(graph.alive()) == 4, 'four processes')
    flight.send_signal(number)
    _, err = ended(graph, flight, code)
    assert 'Traceback' not in err
    assert graph.alive() == []


def test_an_interrupted_flight_is_written(graph, tmp_path):
    flight = fly_on(graph, '--out', str(tmp_path))
    flight.send_signal(signal.SIGINT)
    out, err = ended(graph, flight, 130)
    assert err.splitlines()[-1] == 'bringup: interrupted by SIGINT'
    header, *rows = (tmp_path / 'flight.csv').read_text().splitlines()
    assert header.startswith('t,x,y,z')
    assert len(rows) > 5
    assert str(tmp_path / 'flight.csv') in out


def test_without_security_libraries_it_says_so(tmp_path):
    # With such libraries, an enclave without keys is what it says.
    (tmp_path / 'enclaves' / 'recorder').mkdir(parents=True)
    secured = {
        'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': str(tmp_path)}
    found = subprocess.run(
        [*executable('bringup'), '--duration', '1', '--out', str(tmp_path / 'out')],
        env={**os.environ, **secured}, capture_output=True, text=True, timeout=60)
    assert found.returncode == 1
    assert 'Traceback' not in found.stderr
    # rclpy and rcl have lines of their own.
    assert found.stderr.splitlines()[-1].startswith('bringup: error creating node: ')


def test_it_says_which_node_died_and_ends_the_others(graph, tmp_path):
    flight = fly_on(graph, '--out', str(tmp_path))
    [victim] = [
        child for child in psutil.Process(flight.pid).children(recursive=True)
        if 'allocator' in ' '.join(child.cmdline()).replace('allocation', '')]
    victim.kill()
    _, err = ended(graph, flight, 1)
    [line] = [line for line in err.splitlines() if line.startswith('bringup')]
    assert 'allocator' in line
    assert '-9' in line
    assert 'Traceback' not in err
    assert graph.alive() == []
