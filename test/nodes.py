"""What the tests of nodes share: flights, load, and clients of each node."""

import json
import math
import os
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray, Int8MultiArray, MultiArrayDimension

from ca_ros import Vehicle, control_allocation_matrix
from ca_ros.allocation.settings import allocator_of
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.controller import ControllerNode
from ca_ros.nodes.executable import parse
from ca_ros.nodes.monitor import MonitorNode
from ca_ros.nodes.simulator import SimulatorNode
from ca_ros.nodes.viewer import ViewerNode
from ca_ros.parameter_files import FileSettings
from ca_ros.problem.audit import audit
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import table
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
from ca_ros.testing import DEADLINE, RELIABLE, Diagnostics, six, wrench
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, NULL_STATE, POSITION
from strategies import settings_of

# Flights

GOAL = 1.0, 1.0, 1.0, math.radians(45.0)
"""The default of bringup: x, y, z [m], heading [rad]."""


def fly_offline(method, duration, goal=GOAL, start=(0.0, 0.0, 0.0)):
    """Return the flight without ROS from rest at a point to a waypoint."""
    settings = settings_of({'allocation.method': method})
    vehicle = audit(Vehicle.load('hexarotor')).vehicle
    state = NULL_STATE.copy()
    state[POSITION] = start
    return fly(
        Controller(vehicle, settings.controller),
        allocator_of(settings.allocation, VehicleProblem(vehicle)), RigidBody(vehicle),
        Waypoint.of(*goal), duration, state=state)


def read(folder):
    """Return flight.csv as an array with named columns."""
    return np.genfromtxt(folder / 'flight.csv', delimiter=',', names=True)


def fly_over_ros(graph, folder, case, duration, *words):
    """Fly a case with `bringup` in lockstep, with further words; return flight.csv."""
    names = table(FileSettings)
    own = {name: value for name, value in case.parameters.items() if name in names}
    file = folder / 'vehicle.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': own}}), encoding='utf-8')
    process = graph.start(
        'bringup', '--figures', 'none', '--mode', 'lockstep', '--duration', repr(duration),
        '--out', str(folder), '--vehicle', str(file), *words, exit_codes=(0, 1))
    out, err = graph.outlive(process)
    assert 'within bounds' in out, out + err
    return folder / 'flight.csv'


def ended(graph, process, code):
    """Wait until a process ends with an exit code; return its output and its errors."""
    out, err = graph.outlive(process)
    assert process.returncode == code, out + err
    return out, err


PACES = 1.0, 0.3, 0.1
"""Real time factors; with the last a loop of nodes keeps up even where it is starved."""

STARVED = 0.25
"""What others must have had of the processors' time for a flight to be repeated more slowly."""


def taken():
    """Return what others than this process and its children have had of the processors [s]."""
    ticks = list(map(int, Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]))
    # All but idle and waiting for input and output; with what the hypervisor gave to others.
    busy = (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf('SC_CLK_TCK')
    own = sum(os.times()[:4])
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            own += sum(child.cpu_times()[:2])
    return busy - own


def fly_in_real_time(flight):
    """Fly, and more slowly if that fails where others had the processors.

    `flight` takes the real time factor.  A vehicle whose loop is starved falls, in real time; but
    on a machine that had time for it there is no excuse.
    """
    for factor in PACES:
        begun, before = time.monotonic(), taken()
        try:
            return flight(factor)
        except AssertionError as error:
            share = (taken() - before) / (time.monotonic() - begun) / os.cpu_count()
            print(f'others had {share:.0%} of the processors during: {error}')
            if share < STARVED or factor == PACES[-1]:
                raise


# Commands that end by themselves

RUNS = """
import contextlib, io, json, sys
import ca_ros_cli

runs = []
for sys.argv in json.loads(sys.stdin.read()):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        with contextlib.redirect_stderr(io.StringIO()) as err:
            try:
                code = ca_ros_cli.main(sys.argv)
            except SystemExit as end:
                code = end.code
    runs.append((code, out.getvalue(), err.getvalue()))
json.dump(runs, sys.stdout)
"""


def run_all(ways):
    """Run command lines one after the other; return exit code, output and errors of each.

    All in one process: a process for each would take minutes.
    """
    run = subprocess.run(
        [sys.executable, '-c', RUNS], input=json.dumps([[*way] for way in ways]),
        capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def refused(cases):
    """Each (command line, words) ends with an exit code and one line with these words."""
    for (way, words), (code, out, err) in zip(
            cases, run_all([way for way, _ in cases]), strict=True):
        assert (bool(code), out) == (True, ''), way
        assert len(err.splitlines()) == 1, err
        assert err.startswith(f'{way[0]}: '), err
        assert [word for word in words if word not in err] == [], err


# Nodes in the process of the test

KINDS = {'allocator': AllocatorNode, 'controller': ControllerNode, 'simulator': SimulatorNode}
OBSERVERS = {'monitor': MonitorNode, 'viewer': ViewerNode}


def separate(graph, name, *words):
    """Start a node of the hexarotor as a process of its own; return it."""
    return graph.start(name, '--vehicle', 'hexarotor', '--ros-args', *words)


def host(graph, name, *words):
    """Let a node of the hexarotor work whenever the test waits; return it.

    A process of its own takes ten times as long.  `words`: further arguments for ROS.
    """
    kind = (KINDS | OBSERVERS)[name]
    ros = parse(name, '', ['--vehicle', 'hexarotor', '--ros-args', *words], kind.declared)
    return graph.add_node(
        kind(name, context=graph.context, cli_args=ros, use_global_arguments=False))


# Load

FLOOD = """
import sys, time
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

name, number = sys.argv[1], float(sys.argv[2])
rclpy.init()
if name == 'allocator':
    topic, message = 'command/wrench', WrenchStamped()
    message.wrench.force.z = number
else:
    topic, message = 'command/motor_speed', Float64MultiArray(data=[number] * 6)
publisher = rclpy.create_node('flood').create_publisher(type(message), topic, 1)
encoded = serialize_message(message)
while not publisher.get_subscription_count():
    time.sleep(0.01)
begun, sent = time.monotonic(), 0
while rclpy.ok():
    if sent < 1e4 * (time.monotonic() - begun):
        publisher.publish(encoded)
        sent += 1
"""


def start_flood(graph, name, number):
    """Flood an allocator or a simulator with commands of this thrust [N] or speed [rad/s]."""
    return graph.start(sys.executable, '-c', FLOOD, name, str(number))


@contextmanager
def busy_processors():
    """Keep each processor busy with a process of its own."""
    processes = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass'])
        for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def stolen():
    """Return the processor time that went to other virtual machines [s]."""
    ticks = Path('/proc/stat').read_text(encoding='ascii').split(maxsplit=9)[8]
    return int(ticks) / os.sysconf('SC_CLK_TCK')


STALL = 0.03
"""For so long a virtual machine may stand still, and nobody in it is the wiser [s]."""


def stood_still(pid):
    """Return how long a process and this one have waited for a processor [s]."""
    waited = 0
    for each in (pid, os.getpid()):
        for path in Path(f'/proc/{each}/task').glob('*/schedstat'):
            # A thread may just have ended.
            with suppress(OSError):
                waited += int(path.read_text().split()[1])
    return waited / 1e9 + stolen()


# An allocator

HOVER = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)

VEHICLE = Vehicle.load('hexarotor')

GAMMA = control_allocation_matrix(VEHICLE)


class AllocatorClient:
    """Commands wrenches, gathers the answers, and asks an allocator without ROS the same."""

    def __init__(self, graph, namespace='', qos=RELIABLE):
        self.graph, self.sent, self.twin = graph, 0, twin()
        self.command = graph.publisher(WrenchStamped, f'{namespace}/command/wrench', qos)
        self.speeds = graph.listen(Float64MultiArray, f'{namespace}/command/motor_speed')
        own = f'{namespace}/allocator'
        self.allocated = graph.listen(WrenchStamped, f'{own}/allocated_wrench')
        self.residual = graph.listen(WrenchStamped, f'{own}/residual')
        self.saturation = graph.listen(Int8MultiArray, f'{own}/saturation')
        self.diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
        self.parameters = graph.connect(own)

    def send(self, numbers):
        """Send a wrench (6,), force before torque, with a stamp that no other has."""
        self.sent += 1
        message = wrench(numbers, self.sent * 10**9 + 7, 'base_link')
        self.command.publish(message)
        rows = [AXES.index(axis) for axis in self.twin.problem.axes]
        self.expected = self.twin.allocate(np.array(numbers)[rows])
        return message.header

    def ask(self, numbers):
        """Send a wrench; return the rotor speeds that answer it."""
        self.send(numbers)
        label = f'stamp {self.sent}000000007'
        self.graph.spin_until(
            lambda: self.speeds and self.speeds[-1].layout.dim[1].label == label,
            f'an answer to {numbers}')
        return np.array(self.speeds[-1].data)

    def account(self, numbers):
        """Send a wrench; return what was allocated and the residual."""
        headers = []
        # The node may learn only after the first command that somebody listens to these.
        self.graph.spin_until(
            lambda: headers and all(
                reports and reports[-1].header == headers[-1]
                for reports in (self.allocated, self.residual)),
            f'an account of {numbers}', repeat=lambda: headers.append(self.send(numbers)))
        return six(self.allocated[-1]), six(self.residual[-1])

    def diagnose(self):
        """Return the diagnosis after the last command, and its values by key."""
        def newest():
            status = self.diagnostics[-1].status[0] if self.diagnostics else DiagnosticStatus()
            return status, {pair.key: pair.value for pair in status.values}
        self.graph.spin_until(
            lambda: newest()[1].get('received') == str(self.sent), 'a diagnosis')
        return newest()


def twin(method='exact', health=1.0):
    """Return the allocator that the node should be the equal of."""
    report = audit(VEHICLE.with_health(np.broadcast_to(health, (VEHICLE.n,))))
    return allocator_of(settings_of({'allocation.method': method}).allocation, report)


def some_wrenches(size):
    """Draw wrenches in the admissible set and as many out of it, with forces that are lost."""
    rng = np.random.default_rng(1)
    inside = rng.uniform(VEHICLE.thrust_min, VEHICLE.thrust_max, (size, 6)) @ GAMMA.T
    outside = rng.normal(size=(size, 4)) * 10.0 ** rng.uniform(1.0, 6.0, (size, 1))
    return np.hstack([rng.normal(size=(2 * size, 2)), np.vstack([inside, outside])])


# A controller

LAW = Controller(
    audit(Vehicle.load('hexarotor')).vehicle, settings_of({}).controller)

WAYPOINT = (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)

REST = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


class ControllerClient:
    """Sends waypoints and states and gathers the wrenches."""

    def __init__(self, graph, start=separate):
        self.graph, self.last = graph, 0
        # In lockstep it gets each message, in order.
        self.process = start(graph, 'controller', '-p', 'mode:=lockstep')
        self.waypoint = graph.publisher(PoseStamped, 'command/pose', QoSProfile(depth=1))
        self.pose = graph.publisher(PoseStamped, 'local_position/pose')
        self.velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
        self.wrenches = graph.listen(WrenchStamped, 'command/wrench')
        self.unallocated = graph.listen(WrenchStamped, 'controller/unallocated')
        self.log = graph.listen(Log, '/rosout')
        self.diagnostics = Diagnostics(graph)
        self.parameters = graph.connect('controller')

    def new_stamp(self):
        """Return a stamp [s] that no other state has."""
        self.last += 1
        return self.last

    def send_waypoint(self, position, attitude):
        """Send a waypoint and wait until the node has taken it."""
        self.waypoint.publish(pose_message(position, attitude, 0))
        assert self.waypoint.wait_for_all_acked(Duration(seconds=DEADLINE))
        self.settle()

    def send(self, position, attitude, velocity, angular_velocity):
        """Send a state; return its stamp [s]."""
        stamp = self.new_stamp()
        self.pose.publish(pose_message(position, attitude, stamp))
        self.velocity.publish(velocity_message(velocity, angular_velocity, stamp))
        return stamp

    def settle(self):
        """Let the node answer something else, so that it comes to what was sent before."""
        self.parameters.get('mode')

    def ask(self, *state):
        """Send a state; return the wrench that answers it."""
        stamp = self.send(*state)
        self.graph.spin_until(lambda: stamp in self.stamps(), f'the wrench of {stamp} s')
        return six(self.wrenches[-1])

    def stamps(self):
        """Return the stamps of the wrenches [s]."""
        return [message.header.stamp.sec for message in self.wrenches]


def pose_message(position, attitude, stamp):
    """Return a pose."""
    message = PoseStamped()
    message.header.stamp.sec = stamp
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = map(float, position)
    q.x, q.y, q.z, q.w = map(float, attitude)
    return message


def velocity_message(velocity, angular_velocity, stamp):
    """Return a velocity in the body frame."""
    message = TwistStamped()
    message.header.stamp.sec = stamp
    v, w = message.twist.linear, message.twist.angular
    v.x, v.y, v.z = map(float, velocity)
    w.x, w.y, w.z = map(float, angular_velocity)
    return message


def expected(state, waypoint=WAYPOINT):
    """Return what the law answers without ROS."""
    parts = [np.array(part) for part in (*state, *waypoint)]
    return np.concatenate([np.zeros(2), LAW.wrench(*parts[:4], Waypoint(*parts[4:]))])


# A simulator

STEP = 10_000_000
"""[ns]"""

BODY = RigidBody(Vehicle.load('hexarotor'))


class SimulatorClient:
    """Commands rotor speeds and gathers what the vehicle does."""

    def __init__(self, graph, mode, *arguments, start=separate):
        self.graph = graph
        self.process = start(
            graph, 'simulator', '-p', f'mode:={mode}', '-p', 'timeout_action:=hold', *arguments)
        self.command = graph.publisher(Float64MultiArray, 'command/motor_speed')
        self.poses = graph.listen(PoseStamped, 'local_position/pose')
        self.velocities = graph.listen(TwistStamped, 'local_position/velocity_body')
        self.speeds = graph.listen(Float64MultiArray, 'motor_speed')
        graph.connect('simulator')

    def send(self, speeds, stamp=None):
        """Send rotor speeds that answer the state of a time [ns], or of none."""
        message = Float64MultiArray(data=[float(speed) for speed in speeds])
        if stamp is not None:
            message.layout.dim = [MultiArrayDimension(label=f'stamp {stamp}')]
        self.command.publish(message)

    def state(self, stamp):
        """Wait for the state of a time [ns]: position, attitude, velocities as one array."""
        def seen():
            return [
                [m for m in messages if nanoseconds(m) == stamp]
                for messages in (self.poses, self.velocities)]
        self.graph.spin_until(lambda: all(seen()), f'the state at {stamp} ns')
        return state_array(seen()[0][-1], seen()[1][-1])


def nanoseconds(message):
    """Return the stamp of a message [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def state_array(pose, velocity):
    """Return what is published of a state as one array."""
    p, q = pose.pose.position, pose.pose.orientation
    v, w = velocity.twist.linear, velocity.twist.angular
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z])


def published(state):
    """Return what should be published of a state (13,)."""
    return np.concatenate([
        state[POSITION], state[ATTITUDE], velocity_in_body(state), state[ANGULAR_VELOCITY]])
