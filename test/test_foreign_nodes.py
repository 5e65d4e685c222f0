"""Programs of one's own beside our nodes: `bringup --plant`, stamps, standing waypoints."""

import sys
from functools import partial
from itertools import count

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from ca_ros.bringup.flight import agreed
from ca_ros.bringup.options import parse
from ca_ros.bringup.recorder import Recorder
from ca_ros.bringup.scenario import Scenario
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.errors import CaRosError
from ca_ros.nodes.topics import STANDING
from ca_ros.parameter_files import DECLARED
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.testing import Diagnostics
from ca_ros.vehicle.vehicle import Vehicle
from ca_ros_cli import NODES
from nodes import fly_offline, host, read
from strategies import file_values

# The command lines

def test_a_program_gets_the_arguments_of_the_node_whose_place_it_takes():
    arguments = ['--vehicle', 'x8', '--mode', 'lockstep', '--namespace', '/uav1']
    own = parse(arguments).commands()
    program = f"{sys.executable} 'my plant.py' --gain 2"
    lines = parse([*arguments, '--plant', program]).commands()
    assert lines['simulator'][:4] == [sys.executable, 'my plant.py', '--gain', '2']
    rest = lines['simulator'][4:]
    name = rest.index('__node:=simulator')
    del rest[name - 1:name + 1]
    assert rest == own['simulator'][4:]
    assert {name: lines[name] for name in ('controller', 'allocator')} == {
        name: own[name] for name in ('controller', 'allocator')}


@pytest.mark.parametrize('command', ['', 'no_such_program --x', "python 'x"])
def test_a_program_that_does_not_exist_is_refused_at_once(command, capsys):
    with pytest.raises(SystemExit):
        parse(['--plant', command])
    assert 'argument --plant: ' in capsys.readouterr().err


# What cannot be compared

def test_it_says_which_parameters_of_a_program_it_cannot_compare(capsys):
    parameters = {node: file_values('hexarotor', kind=DECLARED[node]) for node in NODES}
    agreed(parameters, {'mode': 'realtime'})
    assert capsys.readouterr().err == ''
    parameters['simulator'] = {}
    del parameters['controller']['vehicle.inertia']
    agreed(parameters, {'mode': 'realtime'})
    assert capsys.readouterr().err.splitlines() == [
        'bringup: warning: the controller does not declare vehicle.inertia: these cannot be '
        'compared',
        'bringup: warning: the simulator has no parameters: its mode and vehicle cannot be '
        'compared']
    with pytest.raises(CaRosError, match='no node declares the parameter mode'):
        agreed({node: {} for node in NODES}, {})


def test_values_are_those_of_the_allocator_then_the_controller():
    parameters = {
        'allocator': {'a': 1}, 'controller': {'a': 2, 'b': 2}, 'simulator': {'mode': 3, 'b': 3}}
    assert agreed(parameters, {}) == {'a': 1, 'b': 2, 'mode': 3}


def scenario(planned=(), mode='lockstep', waypoints=1, recorder=None, delay=0.1, words=None):
    """Return the scenario of a flight, with `simulator.failures` of the simulator."""
    trajectory = Trajectory(
        tuple(range(waypoints)), (Waypoint.of(0.0, 0.0, 1.0, 0.0),) * waypoints)
    failures = RotorFailures(tuple(planned), delay)
    vehicle = Vehicle.load('hexarotor')
    listeners = 'allocator', 'controller'
    return Scenario(recorder, trajectory, failures, words, mode, vehicle, listeners)


def test_a_plant_that_cannot_have_the_failures_is_refused():
    failing = [RotorFailure(1, 1.0)]
    for mode in ('lockstep', 'realtime'):
        scenario(mode=mode)
        with pytest.raises(CaRosError, match=r'not declare simulator\.failures, which --fail'):
            scenario(failing, mode)
        with pytest.raises(CaRosError, match=r"simulator is \['2@1'\], not \['1@1'\]"):
            scenario(failing, mode, words=['2@1'])
    with pytest.raises(CaRosError, match=r'^simulator\.failures: 7@1: the vehicle has 6 rotors'):
        scenario(words='7@1')
    # Those of a file are announced, too.
    found = scenario(delay=0.2, words='3@1=0.4').failures
    assert (str(found.failures[0]), found.announced_times) == ('3@1=0.4', [1_200_000_000])


def test_more_messages_than_the_nodes_can_keep_are_refused():
    scenario(mode='realtime', waypoints=3000)
    with pytest.raises(CaRosError, match=r'2999 waypoints and announcements .* up to 2000'):
        scenario(waypoints=3000)


def test_it_warns_of_a_program_that_cannot_learn_of_failures(graph, capsys, monkeypatch):
    monkeypatch.setattr(f'{Scenario.__module__}.HEARING', 0.5)
    recorder = graph.add_node(Recorder(context=graph.context))
    host(graph, 'allocator')
    flying = scenario([RotorFailure(1, 1.0)], recorder=recorder, words='1@1')
    flying.begin(lambda: graph.spin_until(lambda: True, 'a moment'))
    assert capsys.readouterr().err == (
        'bringup: warning: the controller does not subscribe to rotor_health/announced: it does '
        'not learn of rotor failures\n')


# Flights

PLANT = """
# Written by docs/plant.md alone, without parameters; the rigid body is ours.
import signal, sys
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from ca_ros import Vehicle
from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
from ca_ros.vehicle.state import NULL_STATE

stop = []
signal.signal(signal.SIGTERM, lambda number, _: stop.append(number))
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node('other_name', start_parameter_services=False)
body, state, time = RigidBody(Vehicle.load('hexarotor')), NULL_STATE, 0
deep = QoSProfile(depth=2000)
pose = node.create_publisher(PoseStamped, 'local_position/pose', deep)
velocity = node.create_publisher(TwistStamped, 'local_position/velocity_body', deep)
turning = node.create_publisher(Float64MultiArray, 'motor_speed', deep)

def publish_speeds(speeds):
    dimensions = [MultiArrayDimension(label='speed'), MultiArrayDimension(label=f'stamp {time}')]
    message = Float64MultiArray(data=speeds)
    message.layout.dim = dimensions
    turning.publish(message)

def publish():
    p, v = PoseStamped(), TwistStamped()
    for header in (p.header, v.header):
        header.stamp.sec, header.stamp.nanosec = divmod(time, 10**9)
    x, q, w = state[:3].tolist(), state[6:10].tolist(), state[10:].tolist()
    p.pose.position.x, p.pose.position.y, p.pose.position.z = x
    o = p.pose.orientation
    o.x, o.y, o.z, o.w = q
    v.twist.linear.x, v.twist.linear.y, v.twist.linear.z = velocity_in_body(state).tolist()
    v.twist.angular.x, v.twist.angular.y, v.twist.angular.z = w
    velocity.publish(v)
    pose.publish(p)

def receive(command):
    global state, time
    if command.layout.dim[1].label == f'stamp {time}':
        publish_speeds(command.data)
        state = body.step(state, list(command.data), 0.01)
        time += 10_000_000
        publish()
        timer.reset()

def repeat():
    if time == 0:
        publish_speeds([0.0] * 6)
    publish()

node.create_subscription(Float64MultiArray, 'command/motor_speed', receive, deep)
timer = node.create_timer(0.2, repeat)
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
"""


def test_a_plant_of_the_page_flies_as_our_simulator_does(graph, tmp_path):
    plant = tmp_path / 'plant.py'
    plant.write_text(PLANT, encoding='utf-8')
    flight = graph.start(
        'bringup', '--figures', 'none',
        '--plant', f"'{sys.executable}' '{plant}'", '--mode', 'lockstep',
        '--duration', '0.5', '--out', str(tmp_path))
    out, err = graph.outlive(flight)
    assert 'flight of 0.50 s (lockstep, 51 samples' in out, err
    assert [line for line in err.splitlines() if line.startswith('bringup: warning')] == [
        'bringup: warning: the simulator has no parameters: its mode and vehicle cannot be '
        'compared']
    expected = fly_offline('exact', 0.5).columns()
    flown = read(tmp_path)
    for name, column in expected.items():
        np.testing.assert_array_equal(flown[name], column, err_msg=name)


# Stamps

def test_the_simulator_says_which_stamp_it_expects_in_lockstep(graph):
    host(graph, 'simulator', '-p', 'mode:=lockstep')
    command = graph.publisher(Float64MultiArray, 'command/motor_speed')
    diagnostics = Diagnostics(graph)
    graph.connect('simulator')

    def said(label):
        return [text for _, text, _ in diagnostics.all('simulator')][-1:] == [
            f'rotor speeds with {label} are discarded: expected stamp 0; wrench and speeds must '
            'carry the stamp of the state that they answer']

    message = Float64MultiArray(data=[250.0] * 6)
    for label in ('', 'stamp 5'):
        message.layout.dim = [MultiArrayDimension(label=label)]
        graph.spin_until(
            partial(said, label or 'no stamp'), label, repeat=lambda: command.publish(message))
    message.layout.dim = [MultiArrayDimension(label='stamp 0')]
    command.publish(message)
    diagnostics.wait('simulator', lambda level, text, _: text == 'in flight', 'in flight')


class State:
    """Publishes the state of a vehicle at rest to a controller, and collects its wrenches."""

    def __init__(self, graph):
        self._pose = graph.publisher(PoseStamped, 'local_position/pose')
        self._velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
        self.wrenches = graph.listen(WrenchStamped, 'command/wrench')

    def send(self, pose_time, velocity_time):
        """Publish a pose and a velocity with these stamps [ns]."""
        pose, velocity = PoseStamped(), TwistStamped()
        pose.header.stamp.nanosec, velocity.header.stamp.nanosec = pose_time, velocity_time
        pose.pose.orientation.w = 1.0
        self._pose.publish(pose)
        self._velocity.publish(velocity)


def waypoint(height):
    """Return the message of a waypoint above the origin [m]."""
    message = PoseStamped()
    message.pose.position.z, message.pose.orientation.w = height, 1.0
    return message


def test_the_controller_gets_waypoints_kept_for_it_and_says_that_stamps_are_unequal(
        graph, capfd):
    standing = graph.publisher(PoseStamped, 'command/pose', STANDING)
    standing.publish(waypoint(1.0))
    state, diagnostics = State(graph), Diagnostics(graph)
    host(graph, 'controller', '-p', 'mode:=lockstep')
    graph.connect('controller')
    graph.spin_until(
        lambda: [text for _, text, _ in diagnostics.all('controller')][-1:] == [
            'no pose and velocity with the same stamp yet'], 'what it says',
        repeat=lambda: state.send(5, 3))
    state.send(6, 3)
    state.send(7, 7)
    graph.spin_until(lambda: state.wrenches, 'an answer')
    assert [wrench.header.stamp.nanosec for wrench in state.wrenches] == [7]

    def thrust():
        return state.wrenches[-1].wrench.force.z if state.wrenches else 0.0

    def send():
        # A late copy of a state has the answer that it had.
        stamp = next(stamps)
        state.send(stamp, stamp)

    stamps = count(8)
    # More and less than the weight of 9.81 N.
    graph.spin_until(lambda: thrust() > 10.0, 'the waypoint kept for it', repeat=send)
    volatile = graph.publisher(PoseStamped, 'command/pose')
    graph.connect('controller')
    volatile.publish(waypoint(-1.0))
    graph.spin_until(lambda: 0.0 < thrust() < 9.0, 'a later waypoint', repeat=send)
    standing.publish(waypoint(1.0))
    graph.spin_until(lambda: thrust() > 10.0, 'one more', repeat=send)
    assert 'the stamps 5 and 3: expected equal stamps' in capfd.readouterr().err
