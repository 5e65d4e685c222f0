"""What the nodes say of themselves on /diagnostics (REP 107)."""

import itertools
import re
import signal
import struct
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, Wrench, WrenchStamped
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from ca_ros import Vehicle, make_allocator
from ca_ros.testing import BEST_EFFORT, RELIABLE, Diagnostics, Graph, counts, wrench
from nodes import host, separate

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
TRANSIENT_LOCAL = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

SUBJECTS = {
    'allocator': 'allocation', 'simulator': 'simulation', 'controller': 'control'}
STREAMS = {
    'allocator': (WrenchStamped, 'command/wrench'),
    'simulator': (Float64MultiArray, 'command/motor_speed'),
    'controller': (PoseStamped, 'local_position/pose')}
OUTPUTS = {
    'allocator': (Float64MultiArray, 'command/motor_speed'),
    'simulator': (TwistStamped, 'local_position/velocity_body'),
    'controller': (WrenchStamped, 'command/wrench')}
HEALTH = dict.fromkeys(('allocator', 'controller'), (Float64MultiArray, 'rotor_health'))
HOVER, BEYOND = 9.81, 1e3
ROOT = Path(__file__).resolve().parent.parent


class Said:
    """What a node says of itself."""

    def __init__(self, graph, name, namespace='', diagnostics=None):
        self.graph, self.kind, self.name = graph, name, f'{namespace}/{name}'
        self.diagnostics = diagnostics or Diagnostics(graph)

    def wait(self, level, words, what=lambda values: True):
        """Wait until the newest level is this, and its message has these words; return values."""
        return self.diagnostics.wait(
            self.name, lambda now, message, values: now == level and words in message
            and what(values), f'{words}')[2]

    def said_since(self, begun):
        """Return what it has said later than a time, by the node's own clock."""
        return [
            status for array in self.diagnostics.arrays for status in array.status
            if status.name.startswith(f'{self.name[1:]}: ')
            and (array.header.stamp.sec, array.header.stamp.nanosec) > (begun.sec, begun.nanosec)]


class Node(Said):
    """A node of a test's own, and a publisher of what it listens to."""

    def __init__(self, graph, name, *options, start=host):
        super().__init__(graph, name)
        self.process = start(graph, name, *options)
        self.stream = graph.publisher(*STREAMS[name])
        graph.connect(name)

    def send(self, thrust):
        """Send a thrust [N] to an allocator."""
        self.stream.publish(wrench(thrust))


def fly(node, thrust=HOVER):
    """Have an allocator get commands so fast that none is missed; return the timer."""
    return node.graph.node.create_timer(0.02, lambda: node.send(thrust))


# All three nodes at once, each in a namespace of its own, at rest

@pytest.fixture(scope='module')
def nodes():
    """Return a node of each kind, which no other publisher or subscription knows."""
    with Graph() as graph:
        diagnostics = Diagnostics(graph)
        for name in SUBJECTS:
            # In one process a topic has one type.
            start = separate if name == 'allocator' else host
            start(
                graph, name, '-r', f'__ns:=/{name}s',
                '-p', 'mode:=lockstep', '-p', f'vehicle.name:=Kestrel {len(name)}')
        nodes = [Said(graph, name, f'/{name}s', diagnostics) for name in SUBJECTS]
        for node in nodes:
            node.wait(STALE, '')
        yield nodes


@contextmanager
def ends(nodes, make, topics):
    """Make an end of a topic of each node; return the topics' full names, end it at last.

    `make` takes a node of ROS, the topic's type and its name, and returns what is to be destroyed.
    """
    ros = nodes[0].graph.node
    names = [f'/{node.kind}s/{topics[node.kind][1]}' for node in nodes]
    made = [
        make(ros, topics[node.kind][0], name) for node, name in zip(nodes, names, strict=True)]
    try:
        yield names
    finally:
        for end in made:
            if isinstance(end, Publisher):
                ros.destroy_publisher(end)
            else:
                ros.destroy_subscription(end)


def reliable(ros, kind, topic):
    return ros.create_publisher(kind, topic, RELIABLE)


def best_effort(ros, kind, topic):
    return ros.create_publisher(kind, topic, BEST_EFFORT)


def another_type(ros, kind, topic):
    return ros.create_publisher(Wrench, topic, RELIABLE)


def transient_local(ros, kind, topic):
    return ros.create_subscription(kind, topic, [].append, TRANSIENT_LOCAL)


def test_each_node_says_once_a_second_what_it_is_about(nodes):
    for node in nodes:
        node.graph.spin_until(
            lambda node=node: len(node.diagnostics.all(node.name)) >= 4, 'four diagnoses')
        arrays = [
            array for array in node.diagnostics.arrays
            if any(status.name.startswith(f'{node.name[1:]}: ') for status in array.status)]
        for array in arrays:
            [status] = array.status
            assert status.name == f'{node.name[1:]}: {SUBJECTS[node.kind]}'
            assert status.hardware_id == f'Kestrel {len(node.kind)}'
        times = [array.header.stamp.sec + array.header.stamp.nanosec / 1e9 for array in arrays]
        assert times[0] > 0.0
        # More than once a second on a change alone.
        steps = np.diff(times)[[a.status[0].message == b.status[0].message
                                for a, b in itertools.pairwise(arrays)]]
        assert np.median(steps) > 0.9


@pytest.mark.parametrize('topics', [STREAMS, OUTPUTS], ids=['input', 'output'])
def test_a_second_publisher_is_said_until_it_goes(nodes, topics):
    graph = nodes[0].graph
    with ExitStack() as stack:
        # Of what it publishes itself, a node is the first publisher.
        for _ in range(2 if topics is STREAMS else 1):
            names = stack.enter_context(ends(nodes, reliable, topics))
        # The nodes learn of them when we do, or so.
        graph.spin_until(
            lambda: all(graph.node.count_publishers(name) == 2 for name in names),
            'second publishers')
        begun = graph.node.get_clock().now().to_msg()
        for node, name in zip(nodes, names, strict=True):
            node.wait(WARN, f'2 publishers on {name}')
            # By the node's own clock, which says something each second: within two.
            said = node.said_since(begun)
            first = next(i for i, status in enumerate(said) if status.level == WARN)
            assert first <= 2
    for node in nodes:
        node.wait(STALE, '')


@pytest.mark.parametrize(('make', 'topics', 'words', 'kinds'), [
    (best_effort, STREAMS, 'offers another quality of service: ', SUBJECTS),
    (best_effort, HEALTH, 'offers another quality of service: ', HEALTH),
    (another_type, STREAMS, 'offers another type', ['allocator']),
    (transient_local, OUTPUTS, 'asks for another quality of service: ', SUBJECTS)])
def test_an_end_that_does_not_match_is_said(nodes, make, topics, words, kinds):
    some = [node for node in nodes if node.kind in kinds]
    with ends(some, make, topics) as names:
        for node, name in zip(some, names, strict=True):
            node.wait(WARN, f'{name} {words}')
    for node in some:
        node.wait(STALE, '')


def large(kind):
    """Return a message for a node that is too large, as CDR."""
    if kind == 'simulator':
        # 5000 entries of the layout and no speeds, for which rclpy would take long.
        entry = struct.pack('<IIII', 1, 0, 1, 1)
        return b'\0\1\0\0' + struct.pack('<I', 5000) + 5000 * entry + struct.pack('<II', 0, 0)
    message = STREAMS[kind][0]()
    message.header.frame_id = 40000 * 'x'
    return serialize_message(message)


def test_large_messages_are_dropped_and_counted_before_they_are_converted(nodes):
    ros = nodes[0].graph.node
    streams = [
        reliable(ros, STREAMS[node.kind][0], f'/{node.kind}s/{STREAMS[node.kind][1]}')
        for node in nodes]
    messages = [large(node.kind) for node in nodes]

    def send():
        for stream, message in zip(streams, messages, strict=True):
            stream.publish(message)

    timer = ros.create_timer(0.1, send)
    for node in nodes:
        node.wait(WARN, 'dropped in a second', lambda values: 'dropped: size' in values)
    ros.destroy_timer(timer)
    for stream in streams:
        ros.destroy_publisher(stream)
    for node in nodes:
        node.wait(STALE, '')


# Nodes of a test's own

def test_levels_latencies_and_losses_of_the_allocator_are_said(graph):
    node = Node(graph, 'allocator', '-p', 'command_timeout:=0.5')
    node.wait(STALE, 'no command yet')
    for thrust, level, words in ((HOVER, OK, 'EXACT'), (BEYOND, WARN, 'PRIORITIZED')) * 2:
        timer = fly(node, thrust)
        node.wait(level, words)
        timer.cancel()
        node.wait(ERROR, 'no command: idle')
    # More than once a second: it is said on change, too.  Where the machine stands still for as
    # long as the time-out, the error comes once more.
    said = [(level, message) for level, message, _ in node.diagnostics.all(node.name)]
    changes = [
        status for status, _ in itertools.groupby(said) if status != (ERROR, 'no command: idle')]
    assert [status for status, _ in itertools.groupby(changes)][1:] == [
        (OK, 'EXACT'), (WARN, 'PRIORITIZED')] * 2
    parameters = graph.connect('allocator')
    timer = fly(node)
    values = node.wait(OK, 'EXACT', lambda values: counts(values)['served'] >= 100)
    latencies = [float(values[f'latency {name} [us]']) for name in ('p50', 'p99', 'max')]
    assert 0.0 < latencies[0] <= latencies[1] <= latencies[2]
    assert values['method'] == 'exact'
    assert values['engine'] == make_allocator('exact', Vehicle.load('hexarotor')).engine
    assert 'hover margin' in values['audit']
    # A loss is an error for as long as it lasts.
    assert parameters.set_atomically({'rotors.health': [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]}).successful
    values = node.wait(ERROR, 'lost')
    assert 'lost' in values['audit']
    assert parameters.set_atomically({'rotors.health': 1.0}).successful
    values = node.wait(OK, 'EXACT')
    assert 'lost' not in values['audit']
    timer.cancel()


def test_the_first_commands_wait_for_no_import(graph):
    """Importing a module takes a tenth of a second, in which a vehicle has no commands."""
    with pytest.MonkeyPatch.context() as changes:
        changes.setenv('PYTHONPROFILEIMPORTTIME', '1')
        node = Node(graph, 'allocator', start=separate)
    node.wait(STALE, 'no command yet')
    _, begun = graph.output(node.process)
    timer = fly(node, BEYOND)
    node.wait(WARN, 'PRIORITIZED', lambda values: counts(values)['served'] >= 10)
    timer.cancel()
    _, ended = graph.output(node.process)
    imported = [line for line in ended[len(begun):].splitlines() if 'import time' in line]
    assert 'import time' in begun
    assert not imported


def test_commands_that_a_newer_one_replaced_are_counted(graph):
    node = Node(graph, 'allocator', start=separate)
    sent = 0

    def send(count):
        nonlocal sent
        sent += count
        for _ in range(count):
            node.send(HOVER)

    send(1)
    node.wait(OK, 'EXACT')
    # While the node is stopped, each command replaces the one before.
    node.process.send_signal(signal.SIGSTOP)
    send(400)
    node.process.send_signal(signal.SIGCONT)

    def account():
        account = counts(node.diagnostics.all(node.name)[-1][2])
        return account['received'], account['lost: command/wrench']

    # That the last one was lost is known with the next.
    graph.spin_until(
        lambda: sum(account()) == sent, 'all are accounted for', repeat=lambda: send(1))
    assert account()[1] > 10


def test_the_simulator_says_whether_it_rests_flies_or_is_left_alone(graph):
    node = Node(graph, 'simulator', '-p', 'command_timeout:=0.5', '-p', 'timeout_action:=stop',
                start=separate)
    node.wait(STALE, 'no command yet')
    timer = graph.node.create_timer(
        0.02, lambda: node.stream.publish(Float64MultiArray(data=[255.0] * 6)))
    node.wait(OK, 'in flight')
    timer.cancel()
    node.wait(ERROR, 'no command: stop')
    node.stream.publish(Float64MultiArray(data=[255.0] * 5))
    values = node.wait(ERROR, 'no command: stop', lambda values: 'dropped: length' in values)
    account = counts(values)
    assert account['received'] == account['served'] + account['dropped: length']
    timer.reset()
    node.wait(OK, 'in flight')
    timer.cancel()
    _, err = graph.end(node.process, signal.SIGINT)
    assert err.index('no command for 0.5 s: stop') < err.index('commands have returned')


def test_the_controller_says_what_it_waits_for(graph):
    node = Node(graph, 'controller')
    waypoint = graph.publisher(PoseStamped, 'command/pose')
    velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
    graph.connect('controller')
    node.wait(STALE, 'no waypoint yet')
    message = PoseStamped()
    message.pose.orientation.w = 1.0
    waypoint.publish(message)
    node.wait(STALE, 'no state yet')

    def send():
        node.stream.publish(message)
        velocity.publish(TwistStamped())

    timer = graph.node.create_timer(0.02, send)
    node.wait(OK, 'under way')
    timer.cancel()
    assert counts(node.wait(ERROR, 'no state'))['timeouts'] == 1
    message.header.stamp.sec = 1
    for words, what in (
            ('no pose and velocity with the same stamp', send),
            ('no velocity', lambda: node.stream.publish(message))):
        other = graph.node.create_timer(0.02, what)
        node.wait(ERROR, words)
        other.cancel()
    message.header.stamp.sec = 0
    timer.reset()
    node.wait(OK, 'under way')


def test_the_file_for_diagnostic_aggregator_has_a_group_for_each_subject(graph):
    # The parser of ROS, as a node of the aggregator's name would use it.
    file = ROOT / 'config' / 'diagnostics' / 'analyzers.yaml'
    node = rclpy.create_node(
        'analyzers', context=graph.context, automatically_declare_parameters_from_overrides=True,
        cli_args=['--ros-args', '--params-file', str(file)])
    found = node.get_parameters_by_prefix('')
    node.destroy_node()
    kinds = {found[name].value for name in found if name.endswith('.type')}
    assert kinds == {'diagnostic_aggregator/GenericAnalyzer'}
    groups = [found[name].value for name in found if name.endswith('.contains')]
    sources = [*(ROOT / 'ca_ros' / 'nodes').glob('*.py'), ROOT / 'ca_ros' / 'px4' / 'bridge.py']
    subjects = {
        subject for source in sources
        for subject in re.findall(r"\bDiagnostics\(self, '(\w+)'", source.read_text())}
    assert subjects > {*SUBJECTS.values()}
    for subject in subjects:
        name = f'uav1/node: {subject}'
        assert sum(any(part in name for part in parts) for parts in groups) == 1, name
