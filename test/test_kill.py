"""Nodes that are killed in flight with kill -9: bringup brings them back, the flight goes on."""

import math
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import DEADLINE, Graph
from ca_ros_cli import NODES
from nodes import ended, fly_in_real_time, fly_offline
from strategies import length

KILLS = length(1, 1, 50)
"""So often each node is killed."""

SHORT = '--duration', '1', '--waypoint', '0', '0', '0', '--heading', '0'
"""A flight that is at its waypoint from the start."""


LOOPBACK = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(Path(__file__).with_name('loopback.xml')),
}
"""Keeps to this machine by its loopback: the range LOCALHOST would bring in shared memory."""


@pytest.fixture
def graph():
    """Give a test a graph on the loopback."""
    with Graph(**LOOPBACK) as graph:
        yield graph


class Flight:
    """A flight of bringup that does not end by itself, and what the vehicle does."""

    def __init__(self, graph, folder, *arguments):
        self.graph = graph
        self.process = graph.start(
            'bringup', '--respawn', '--figures', 'none', '--out', str(folder), *arguments)
        self.poses = graph.listen(PoseStamped, 'local_position/pose')

    def node(self, name):
        """Return the process of a node, if there is one."""
        for child in psutil.Process(self.process.pid).children():
            try:
                if name in child.cmdline():
                    return child
            except psutil.Error:
                pass
        return None

    def kill(self, name):
        """Kill a node; return when all that end with it have been started again."""
        names = [name, 'controller'] if name == 'simulator' else [name]
        self.graph.spin_until(lambda: all(map(self.node, names)), f'{names}: running')
        victims = [self.node(each) for each in names]
        self.poses.clear()
        victims[0].kill()
        self.graph.spin_until(
            lambda: not {None, *victims} & {self.node(each) for each in names},
            f'{names}: started again')
        self.poses.clear()

    def wait(self, condition, what, deadline=DEADLINE):
        """Wait until the newest pose fulfils a condition; forget the older ones."""
        def fulfilled():
            del self.poses[:-1]
            return bool(self.poses) and condition(self.poses[-1])
        try:
            self.graph.spin_until(fulfilled, what, deadline=deadline)
        except AssertionError as error:
            raise AssertionError(f'{error}; last seen: {self.poses[-1:]}') from None
        return self.poses[-1]

    def wait_for_waypoint(self, deadline):
        """Wait until the vehicle is where it should go, from however deep it has fallen."""
        self.wait(lambda pose: distance(pose) <= 0.001, 'at the waypoint', deadline)


def distance(message):
    """Return how far a pose is from the waypoint (1, 1, 1) [m]."""
    p = message.pose.position
    return math.dist([p.x, p.y, p.z], [1.0, 1.0, 1.0])


def time_of(message):
    """Return the stamp of a message [s]."""
    return message.header.stamp.sec + message.header.stamp.nanosec / 1e9


def shared_memory(graph):
    """Return what Fast DDS has in shared memory for the ports of a graph's domain."""
    first = 7400 + 250 * graph.domain
    ports = {f'fastrtps_port{port}' for port in range(first, first + 250)}
    return {path.name for path in Path('/dev/shm').iterdir() if path.name in ports}


def end(flight, graph, before):
    """Interrupt a flight; nothing is left behind."""
    flight.process.send_signal(signal.SIGINT)
    out, err = graph.outlive(flight.process)
    assert flight.process.returncode == 130, out + err
    assert 'Traceback' not in err, err
    assert graph.alive() == []
    assert shared_memory(graph) <= before
    return err


def check_lines(err, kills):
    """Each kill is said in one line."""
    lines = [line for line in err.splitlines() if line.startswith('bringup: the ')]
    assert len(lines) == sum(kills.values())
    for name, count in kills.items():
        own = [line for line in lines if f'the {name} ended' in line]
        assert len(own) == count
        assert all('-9' in line and 'started again' in line for line in own), own
        assert all(('begins again' in line) == (name == 'simulator') for line in own), own


@pytest.mark.long
@pytest.mark.timeout(3600 + 400 * KILLS)
def test_in_real_time_the_vehicle_comes_back_to_its_waypoint(tmp_path):
    def flight(factor):
        with Graph(**LOOPBACK) as graph:
            come_back(graph, tmp_path, factor)

    fly_in_real_time(flight)


def come_back(graph, folder, factor):
    """Kill each node, and see the vehicle leave its waypoint and come back to it."""
    before, deadline = shared_memory(graph), DEADLINE / factor
    # On a small planet, lest it fall so far that the way back takes minutes; and not in haste, for
    # there only the weight slows down who climbs.  The motors idle long before a node is back.
    flight = Flight(
        graph, folder, '--duration', '1e6', '--ros-args', '-p', 'vehicle.gravity:=2.0',
        '-p', 'controller.speed_max:=6.0', '-p', 'command_timeout:=0.2',
        '-p', f'simulator.real_time_factor:={factor}')
    flight.wait_for_waypoint(deadline)
    for _ in range(KILLS):
        for name in NODES:
            flight.kill(name)
            flight.wait(lambda pose: distance(pose) > 0.002, f'{name}: missed')
            flight.wait_for_waypoint(deadline)
    check_lines(end(flight, graph, before), dict.fromkeys(NODES, KILLS))


@pytest.mark.slow
@pytest.mark.timeout(1200 + 120 * KILLS)
def test_in_lockstep_no_step_is_lost(graph, tmp_path):
    duration, before = length(4.0, 20.0 + KILLS, 300.0), shared_memory(graph)
    flight = Flight(
        graph, tmp_path, '--mode', 'lockstep', '--duration', str(duration), '--tolerance', '1')
    flight.wait(lambda pose: pose.pose.position.z > 0.1, 'a flight')
    for _ in range(KILLS):
        # With the simulator the flight begins again.
        for name in reversed(NODES):
            flight.kill(name)
            first = time_of(flight.wait(lambda _: True, f'after the {name}: a pose'))
            flight.wait(
                lambda pose, first=first: time_of(pose) > first, f'after the {name}: another')
    out, err = graph.outlive(flight.process)
    assert flight.process.returncode == 0, out + err
    check_lines(err, dict.fromkeys(NODES, KILLS))
    assert all(f'{name} {KILLS}' in out for name in NODES), out
    fly_offline('exact', duration).write_csv(tmp_path / 'offline.csv')
    assert (tmp_path / 'flight.csv').read_bytes() == (tmp_path / 'offline.csv').read_bytes()
    assert graph.alive() == []
    assert shared_memory(graph) <= before


@pytest.mark.long
def test_what_is_killed_leaves_no_shared_memory_behind(graph, tmp_path, monkeypatch):
    # As a user would start it: all that keeps Fast DDS from using it is bringup itself.
    monkeypatch.delenv('FASTDDS_BUILTIN_TRANSPORTS')
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE')
    flight = graph.start(
        'bringup', '--respawn', '--figures', 'none', '--mode', 'lockstep', *SHORT,
        '--out', str(tmp_path))
    victims = []

    def there():
        victims.clear()
        for process in graph.alive():
            with suppress(psutil.Error):
                if 'allocator' in process.cmdline() and process.num_threads() > 5:
                    victims.append(process)
        return victims

    while not there():
        # The threads are those of the middleware.
        assert flight.poll() is None
        time.sleep(0.01)
    mapped = {part.path for part in victims[0].memory_maps()}
    victims[0].kill()
    out, _ = ended(graph, flight, 0)
    assert 'allocator 1' in out
    assert [path for path in mapped if path.startswith('/dev/shm/fastrtps')] == []


@pytest.mark.timeout(600 + 60 * KILLS)
def test_nothing_flies_on_when_bringup_is_killed(graph, tmp_path):
    told = graph.listen(Float64MultiArray, 'command/motor_speed')
    for _ in range(KILLS):
        flight = graph.start(
            'bringup', '--faults', '', '--duration', '1e6', '--out', str(tmp_path))
        told.clear()
        graph.spin_until(lambda: len(told) > 10, 'a flight')
        assert len(graph.alive()) == 5
        graph.end(flight, signal.SIGKILL)
        graph.spin_until(lambda: graph.alive() == [], 'all nodes have ended')
        graph.spin_until(lambda: set(told[-1].data) == {40.0}, 'the last command is idle')


def test_a_node_that_cannot_start_ends_it(graph, tmp_path):
    # Each start may take its time here.
    patient = (
        'from ca_ros.bringup import bringup, flight; flight.Processes.STARTING = 1e6; '
        'flight.Processes.ATTEMPTS = 2; '
        'flight.PROGRESS_TIMEOUT = flight.NOTICE = 1e6; '
        'raise SystemExit(bringup.main())')
    flight = graph.start(
        sys.executable, '-c', patient,
        '--respawn', '--out', str(tmp_path),
        '--ros-args', '-p', 'allocator:command_timeout:=-1.0')
    _, err = ended(graph, flight, 1)
    assert 'Traceback' not in err
    own = [line for line in err.splitlines() if line.startswith('allocator: ')]
    assert len(own) == 2, err
    assert all('command_timeout' in line for line in own)
    said = [line for line in err.splitlines() if line.startswith('bringup: ')]
    assert said == [
        'bringup: the allocator ended with exit code 1 and is started again',
        'bringup: the allocator ended with exit code 1']
    assert graph.alive() == []
