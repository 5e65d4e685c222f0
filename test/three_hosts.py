"""Three hosts on one network; `test_network.py` runs it in a process of its own.

Fast DDS keeps the interfaces that it has found first in a process, so that a process with other
tests before this one would not find the network.
"""

import ctypes
import math
import os
import shutil
import subprocess
from contextlib import ExitStack, contextmanager

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import DEADLINE, Graph
from nodes import fly_in_real_time

HOSTS = ('ground', 'controller', 'allocator', 'simulator')
NODES = HOSTS[1:]
IDLE = 40.0
"""Of each rotor [rad/s]."""

CLONE_NEWNET = 0x40000000


class Network:
    """Hosts that are joined by a switch, which is a host of its own."""

    def __init__(self, hosts):
        self.prefix = f'ca_ros_{os.getpid()}'
        self.hosts = hosts

    def __enter__(self):
        try:
            self._add('switch')
            self._run('-n', self.name('switch'), 'link', 'add', 'bridge', 'type', 'bridge',
                      'mcast_snooping', '0')
            self._run('-n', self.name('switch'), 'link', 'set', 'bridge', 'up')
            for i, host in enumerate(self.hosts, 1):
                self._add(host)
                self._run('-n', self.name('switch'), 'link', 'add', f'port{i}', 'type', 'veth',
                          'peer', 'name', 'eth0', 'netns', self.name(host))
                self._run('-n', self.name('switch'), 'link', 'set', f'port{i}', 'master',
                          'bridge', 'up')
                self._run('-n', self.name(host), 'address', 'add', f'10.0.0.{i}/24', 'dev', 'eth0')
                self._run('-n', self.name(host), 'link', 'set', 'eth0', 'up')
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for host in ('switch', *self.hosts):
            subprocess.run(
                ['ip', 'netns', 'delete', self.name(host)], stderr=subprocess.DEVNULL, check=False)

    def name(self, host):
        """Return the name of a host's namespace."""
        return f'{self.prefix}_{host}'

    def set_link(self, host, state):
        """Let the link of a host be up or down."""
        port = f'port{self.hosts.index(host) + 1}'
        self._run('-n', self.name('switch'), 'link', 'set', port, state)

    @contextmanager
    def on(self, host):
        """Do what follows on a host: its sockets, and those of the processes it starts."""
        with open('/proc/self/ns/net') as here, open(f'/run/netns/{self.name(host)}') as there:
            _enter(there)
            try:
                yield
            finally:
                _enter(here)

    def _add(self, host):
        self._run('netns', 'add', self.name(host))
        self._run('-n', self.name(host), 'link', 'set', 'lo', 'up')

    @staticmethod
    def _run(*arguments):
        subprocess.run(['ip', *arguments], check=True, capture_output=True, text=True)


def _enter(namespace):
    # Python has os.setns from 3.12 on.
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(namespace.fileno(), CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), 'setns')


@pytest.fixture
def network(monkeypatch):
    """Four hosts on one switch, for which DDS may leave this machine."""
    if not shutil.which('ip'):
        pytest.skip('no command ip: install iproute2')
    with ExitStack() as stack:
        try:
            network = stack.enter_context(Network(HOSTS))
        except subprocess.CalledProcessError as error:
            pytest.skip(f'no network namespaces on this machine: {error.stderr.strip()}')
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
        yield network


def height(pose):
    """Return how high a pose is [m]."""
    return pose.pose.position.z


def distance(pose, goal):
    """Return how far a pose is from a point [m]."""
    p = pose.pose.position
    return math.dist([p.x, p.y, p.z], goal)


@pytest.mark.slow
@pytest.mark.parametrize('cut', ['allocator', 'controller'])
def test_three_hosts_fly_to_the_waypoint_though_a_link_is_cut_in_flight(network, cut):
    def flight(factor):
        with Graph(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET') as graph:
            fly_though_a_link_is_cut(network, cut, graph, factor)

    fly_in_real_time(flight)


def fly_though_a_link_is_cut(network, cut, graph, factor):
    """Fly with nodes on three hosts, of which one is cut off for a while."""
    patience = DEADLINE / 2 / factor
    for node in NODES:
        with network.on(node):
            graph.start(
                node, '--vehicle', 'hexarotor', '--ros-args', '-p', 'simulator.time_step:=0.02',
                '-p', f'simulator.real_time_factor:={factor}',
                '-p', f'command_timeout:={0.1 / factor}')
    with network.on('ground'):
        waypoint = graph.publisher(PoseStamped, 'command/pose')
        poses = graph.listen(PoseStamped, 'local_position/pose')
        speeds = graph.listen(Float64MultiArray, 'motor_speed')
        diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
        for node in NODES:
            graph.connect(node)
    goal = PoseStamped()
    p = goal.pose.position
    p.x = p.y = p.z = 1.0
    waypoint.publish(goal)
    graph.spin_until(lambda: poses and height(poses[-1]) > 0.3, 'a flight', deadline=patience)

    speeds.clear()
    network.set_link(cut, 'down')
    graph.spin_until(
        lambda: speeds and set(speeds[-1].data) == {IDLE}, 'the motors told that no command comes')
    top = max(height(pose) for pose in poses)
    graph.spin_until(lambda: height(poses[-1]) < top - 1.0, 'a fall', deadline=patience)
    network.set_link(cut, 'up')

    # At the waypoint and at rest: a second within 2 cm of it.
    graph.spin_until(
        lambda: all(distance(pose, (1.0, 1.0, 1.0)) < 0.02 for pose in poses[-50:]),
        'at the waypoint in the end', deadline=patience)
    told = {
        status.message for array in diagnostics for status in array.status
        if status.name == ('simulator: simulation' if cut == 'allocator' else
                           'allocator: allocation')}
    assert any('no command' in message for message in told), told
