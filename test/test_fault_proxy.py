"""The fault proxy node: what it passes on, and flights through it."""

import math
import re

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped

from ca_ros.nodes.fault_proxy import PREFIX, FaultProxyNode
from ca_ros.nodes.link_faults import LINK_CORRUPTIONS, FaultSettings, corrupted
from ca_ros.settings import table
from ca_ros.testing import BEST_EFFORT, DEADLINE, six, wrench
from nodes import fly_in_real_time, refused, run_all
from strategies import length


class Proxy:
    """A proxy of one topic, both ends of which are the test's."""

    def __init__(self, graph, kind, topic, **parameters):
        self.graph, self.kind = graph, kind
        values = [f'{name}:={value}' for name, value in parameters.items()]
        graph.add_node(FaultProxyNode(context=graph.context, use_global_arguments=False, cli_args=[
            '--ros-args', *(word for value in values for word in ('-p', value))]))
        self.sent = 0
        self.input = graph.publisher(kind, topic)
        self.received = graph.listen(kind, f'{PREFIX}{topic}')
        self.diagnostics = graph.listen(DiagnosticArray, '/diagnostics')
        self.parameters = graph.connect('fault_proxy')
        self.topic = topic

    def send(self, messages):
        """Send messages; return when all have been taken."""
        for message in messages:
            self.input.publish(message)
        self.sent += len(messages)
        self.graph.spin_until(lambda: self.counts().get('received') == self.sent, 'all received')

    def status(self):
        """Return the newest status of the topic."""
        found = [
            status for array in self.diagnostics for status in array.status
            if status.name == f'fault_proxy: {self.topic}']
        return found[-1] if found else None

    def counts(self):
        """Return the newest counts of the topic."""
        status = self.status()
        return {value.key: int(value.value) for value in status.values} if status else {}


def wrenches(n):
    """Return n wrenches that tell each other apart."""
    return [wrench((k + 1, 0, 0, 0, 0, -k - 1), frame='base_link') for k in range(n)]


def number(message):
    """Return which of the `wrenches` one is."""
    return round(-message.wrench.torque.z) - 1


def test_without_faults_every_message_passes_unchanged(graph):
    proxy = Proxy(graph, WrenchStamped, 'command/wrench')
    messages = wrenches(200)
    proxy.send(messages)
    graph.spin_until(lambda: len(proxy.received) == 200, 'all messages')
    assert proxy.received == messages
    assert proxy.counts() == {'received': 200, 'passed': 200, 'on their way': 0}
    assert (proxy.status().level, proxy.status().message) == (DiagnosticStatus.OK, 'no faults')
    # A publisher that does not match is said.
    wrong = graph.node.create_publisher(WrenchStamped, 'command/wrench', BEST_EFFORT)
    graph.spin_until(lambda: 'quality of service' in proxy.status().message, 'word of it')
    assert proxy.status().level == DiagnosticStatus.WARN
    graph.node.destroy_publisher(wrong)
    graph.spin_until(lambda: proxy.status().message == 'no faults', 'the end of it')


def test_the_fates_are_those_of_the_seed(graph):
    given = {'drop': 0.2, 'duplicate': 0.2, 'corrupt': 0.2}
    proxy = Proxy(graph, WrenchStamped, 'command/wrench', seed=5.0, **given,
                  corruptions='[not_a_number, infinite, huge, sign, frame]')
    messages = wrenches(200)
    corruptions = LINK_CORRUPTIONS['command/wrench']
    faults = FaultSettings(topics='command/wrench', seed=5, **given, corruptions=corruptions)
    fates = [faults.fate(k) for k in range(len(messages))]
    expected = []
    for message, fate in zip(messages, fates, strict=True):
        wrong = fate.corruption and corrupted(six(message).tolist(), fate.corruption, fate.place)
        frame = 'corrupted' if fate.corruption == 'frame' else 'base_link'
        expected += [(frame, wrong or six(message).tolist())] * fate.copies
    proxy.send(messages)
    graph.spin_until(lambda: len(proxy.received) >= len(expected), 'what should come')
    assert repr([(m.header.frame_id, six(m).tolist()) for m in proxy.received]) == repr(expected)
    counts = proxy.counts()
    assert counts['dropped'] == sum(fate.copies == 0 for fate in fates)
    assert counts['received'] - counts['dropped'] + counts['duplicated'] == counts['passed']
    assert proxy.status().level == DiagnosticStatus.WARN
    assert 'drop 0.2' in proxy.status().message


def test_a_link_is_cut_and_mended_and_wrong_values_change_nothing(graph):
    proxy = Proxy(graph, WrenchStamped, 'command/wrench')
    assert proxy.parameters.set_atomically({'drop': [1.0, 0.0, 0.0, 0.0]}).successful
    proxy.send(wrenches(20))
    assert proxy.counts()['dropped'] == 20
    for wrong in ({'drop': 1.5}, {'drop': [0.1, 0.2]}, {'delay': math.nan}, {'delay': -1.0},
                  {'drop': 0.0, 'corruptions': ['rust']}, {'drop': 'much'}):
        result = proxy.parameters.set_atomically(wrong)
        assert not result.successful
        assert any(name in result.reason for name in wrong), result.reason
    for fixed in ({'topics': ['command/wrench']}, {'seed': 1.0}):
        assert not proxy.parameters.set_atomically(fixed).successful
    proxy.send(wrenches(20))
    assert proxy.counts()['dropped'] == 40
    assert proxy.parameters.set_atomically({'drop': 0.0, 'delay': 0.05}).successful
    # Delayed messages come in order, and overtaken ones do not.
    proxy.send(wrenches(50))
    graph.spin_until(lambda: len(proxy.received) == 50, 'all messages')
    assert [number(m) for m in proxy.received] == list(range(50))
    assert proxy.counts()['delayed'] == 50
    proxy.received.clear()
    assert proxy.parameters.set_atomically({'delay': 0.0, 'reorder': 0.3}).successful
    proxy.send(wrenches(50))
    graph.spin_until(lambda: len(proxy.received) >= 49, 'all messages, but perhaps the last')
    order = [number(m) for m in proxy.received]
    assert order != sorted(order)
    assert set(order) >= set(range(49))


@pytest.mark.slow
def test_wrong_parameters_are_refused_in_one_line_and_its_help_names_all_and_the_remaps():
    wrong = 'drop:=1.5', 'dorp:=0.1', 'corruptions:=[rust]'
    refused([(('fault_proxy', '--ros-args', '-p', word), [word.split(':')[0]]) for word in wrong])
    [(_, out, err)] = run_all([('fault_proxy', '--help')])
    assert err == ''
    assert [name for name in table(FaultSettings) if f'  {name} ' not in out] == []
    assert [topic for topic in LINK_CORRUPTIONS if f'-r {topic}:={PREFIX}{topic}' not in out] == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(('faults', 'delay'), [
    ('drop:=0.1', 0.005), *length([], [
        # Of four links with 30 % a quarter of the answers is left.
        ('drop:=0.3', 0.0), ('reorder:=0.1', 0.0), ('corrupt:=0.01', 0.0)])])
def test_bringup_flies_through_faults_in_one_command(graph, tmp_path, faults, delay):
    diagnostics = graph.listen(DiagnosticArray, '/diagnostics')

    def flight(factor):
        diagnostics.clear()
        process = graph.start(
            'bringup', '--figures', 'none',
            '--faults', f'{faults} delay:={delay / factor} seed:=3',
            '--namespace', 'uav1', '--duration', '1', '--out', str(tmp_path),
            '--waypoint', '0', '0', '0', '--heading', '0',
            '--ros-args', '-p', 'command_timeout:=1000.0',
            '-p', f'simulator.real_time_factor:={factor}')
        graph.spin_until(
            lambda: any(
                status.name.startswith('uav1/fault_proxy')
                and faults.replace(':=', ' ') in status.message
                for array in diagnostics for status in array.status), 'its diagnostics')
        out, err = graph.outlive(process, DEADLINE / factor)
        assert process.returncode == 0, out + err
        assert 'reached' in out
        if delay:
            [line] = re.findall(
                r'faults        dropped (\d+), delayed (\d+), of (\d+) messages', out)
            dropped, delayed, received = map(int, line)
            assert dropped + delayed == received > 350
            # Six standard deviations.
            assert abs(dropped - 0.1 * received) < 6.0 * math.sqrt(0.09 * received)
        assert 'Traceback' not in err
        assert graph.alive() == []

    fly_in_real_time(flight)
