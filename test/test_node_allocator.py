"""The allocator node, over DDS."""

import math
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped

from ca_ros import SlewLimited, Status
from ca_ros.allocation import ALLOCATORS
from ca_ros.nodes import topics
from ca_ros.nodes.messages import read_wrench
from ca_ros.nodes.mode import RealTime
from ca_ros.nodes.stream import STALL_MIN, Streams
from ca_ros.testing import BEST_EFFORT, Graph, wrench
from nodes import GAMMA, HOVER, AllocatorClient, host, some_wrenches, twin
from strategies import HEXAROTOR

HOVER_SPEED = math.sqrt(1.0 * 9.81 / (6 * 2.5e-5))
"""m g / 6 = k_f omega^2: 255.73 rad/s."""


def start(graph, *arguments):
    """Start an allocator in lockstep, where it gets each message, in order."""
    host(graph, 'allocator', '-p', 'mode:=lockstep', *arguments)
    return AllocatorClient(graph)


@pytest.fixture(scope='module')
def client():
    """Share an allocator that no test changes."""
    with Graph() as graph:
        yield start(graph)


@pytest.fixture(scope='module')
def shared():
    """Share an allocator that tests change."""
    with Graph() as graph:
        yield start(graph)


@pytest.fixture
def changing(shared):
    """Return the shared allocator, as it was at its start, without what was heard."""
    result = shared.parameters.set_atomically({
        'allocation.method': 'exact', 'allocation.exact.policy': 'prioritize',
        'rotors.health': 1.0})
    assert result.successful, result.reason
    shared.twin = twin()
    shared.ask(HOVER)
    shared.speeds.clear()
    return shared


# Answers

def test_the_layout_says_what_the_numbers_are(client):
    client.ask(HOVER)
    rows, columns = client.speeds[-1].layout.dim
    assert (rows.label, rows.size, columns.size) == ('rotor speed [rad/s]', 6, 1)
    assert len(client.speeds[-1].data) == rows.size * columns.size
    assert client.speeds[-1].layout.data_offset == 0


def test_answers_equal_those_without_ros_to_the_last_bit(client):
    for numbers in some_wrenches(100):
        speeds = client.ask(numbers)
        assert speeds.tobytes() == client.expected.speeds.tobytes()
        assert np.all((speeds >= 40.0) & (speeds <= 400.0))


def test_allocated_wrench_and_residual_sum_to_the_command(client):
    for numbers in some_wrenches(10):
        allocated, residual = client.account(numbers)
        speeds = client.ask(numbers)
        np.testing.assert_allclose(allocated[2:], GAMMA @ (2.5e-5 * speeds**2), atol=1e-12)
        assert not allocated[:2].any()
        np.testing.assert_allclose(
            allocated + residual, numbers, rtol=0.0, atol=1e-15 * np.abs(numbers).max() + 1e-14)


@pytest.mark.parametrize(('thrust', 'sign'), [(1e3, 1), (9.81, 0), (-1e3, -1)])
def test_saturation_says_which_bound_each_rotor_is_at(client, thrust, sign):
    # It is said only when the node has learned that somebody listens.
    client.graph.spin_until(
        lambda: client.saturation and client.saturation[-1].data.tolist() == [sign] * 6,
        f'saturation {sign}', repeat=lambda: client.ask((0.0, 0.0, thrust, 0.0, 0.0, 0.0)))


def test_the_diagnostics_say_what_limits_each_axis(graph):
    client = start(graph)
    client.ask((0.0, 0.0, 9.81, 0.0, 0.0, 3.0))
    values = client.diagnose()[1]
    assert values['roll served [%]'] == '100.0'
    assert float(values['yaw served [%]']) < 50.0
    assert 'rotor' in values['yaw limited by']
    assert float(values['margin of the last demand']) < 0.0
    least = {key: values[f'least yaw served {key}'] for key in ('[%]', 'at [ns]', 'limited by')}
    assert least == {'[%]': values['yaw served [%]'], 'at [ns]': f'{client.sent}000000007',
                     'limited by': values['yaw limited by']}
    # A lesser cut of another axis does not change it; an attainable wrench neither.
    client.ask((0.0, 0.0, 9.81, 0.0, 0.0, 2.9))
    client.ask((0.0, 0.0, 1e3, 0.0, 0.0, 0.0))
    values = client.diagnose()[1]
    assert {key: values[f'least yaw served {key}'] for key in least} == least
    assert values['least thrust served limited by'].endswith('at their maximum, together')
    assert not any(key.startswith('least roll') for key in values)


def test_rotors_with_rates_go_no_further_than_they_reach(graph):
    client = start(graph, '-p', 'rotors.acceleration_max:=300.0')
    slow, last = SlewLimited(client.twin, 300.0), HEXAROTOR.idle_speeds
    for numbers in (HOVER, *some_wrenches(20)):
        # The stamps are a second apart, of which a tenth counts.
        expected = slow.allocate(np.array(numbers)[2:], last, 0.1).speeds
        last = client.ask(numbers)
        assert last.tobytes() == expected.tobytes()
    assert client.diagnose()[0].message == 'RATE_LIMITED'
    # A second wrench with the stamp of the last one is answered from the same command.
    client.sent -= 1
    client.speeds.clear()
    assert client.ask(numbers).tobytes() == last.tobytes()
    # At time 0 a flight begins again, with rotors that have been idle.
    client.command.publish(wrench(numbers, 0, 'base_link'))
    graph.spin_until(lambda: client.speeds[-1].layout.dim[1].label == 'stamp 0', 'an answer')
    first = slow.allocate(np.array(numbers)[2:], HEXAROTOR.idle_speeds, 0.1).speeds
    assert np.array(client.speeds[-1].data).tobytes() == first.tobytes() != last.tobytes()


def test_wrenches_without_stamps_count_from_their_arrival(graph):
    host(graph, 'allocator', '-p', 'rotors.acceleration_max:=300.0')
    client = AllocatorClient(graph)

    def hovers():
        client.command.publish(wrench(HOVER, 0, 'base_link'))
        return client.speeds and abs(client.speeds[-1].data[0] - HOVER_SPEED) < 1e-9

    graph.spin_until(hovers, 'the speeds of hover')
    # From 40 rad/s at 300 rad/s^2.
    assert len({message.data[0] for message in client.speeds}) > 3


# Parameters

def test_the_method_can_be_set_on_the_running_node(changing):
    client = changing
    for method in ALLOCATORS:
        [result] = client.parameters.set({'allocation.method': method})
        assert result.successful, result.reason
        client.twin = twin(method)
        for numbers in (HOVER, *some_wrenches(5)):
            client.send(numbers)
            if client.expected.status is not Status.REJECTED:
                assert client.ask(numbers).tobytes() == client.expected.speeds.tobytes()
        client.ask(HOVER)
        assert client.diagnose()[1]['method'] == method


def test_a_rejected_wrench_moves_no_rotor(changing):
    client = changing
    [result] = client.parameters.set({'allocation.exact.policy': 'reject'})
    assert result.successful, result.reason
    client.ask(HOVER)
    # The rotors keep the speeds of hover, and that is what is said of them.
    far = 1e3 * np.array(HOVER)
    allocated, residual = client.account(far)
    np.testing.assert_allclose(allocated, HOVER, atol=1e-9)
    np.testing.assert_allclose(residual, far - HOVER, atol=1e-9)
    assert client.diagnose()[0].message == 'REJECTED'
    client.ask(HOVER)
    assert len(client.speeds) == 2


def test_nothing_but_rejected_wrenches_is_as_bad_as_none_but_called_by_its_name(graph):
    client = start(graph, '-p', 'allocation.exact.policy:=reject', '-p', 'mode:=realtime')
    client.ask(HOVER)
    beyond = graph.node.create_timer(0.01, lambda: client.send(1e3 * np.array(HOVER)))
    graph.spin_until(
        lambda: client.speeds[-1].data.tolist() == [40.0] * 6, 'the timeout action')
    graph.spin_until(
        lambda: client.diagnostics
        and client.diagnostics[-1].status[0].message == 'only rejected commands: idle',
        'the reason')
    beyond.cancel()
    graph.spin_until(
        lambda: client.diagnostics[-1].status[0].message == 'no command: idle', 'another reason')


def test_a_flight_that_begins_with_rejected_wrenches_is_not_left_to_itself(graph):
    client = start(
        graph, '-p', 'allocation.exact.policy:=reject', '-p', 'mode:=realtime',
        '-p', 'timeout_action:=hold')
    beyond = graph.node.create_timer(0.01, lambda: client.send(1e3 * np.array(HOVER)))
    graph.spin_until(lambda: client.speeds, 'the timeout action')
    beyond.cancel()
    assert client.speeds[0].data.tolist() == [40.0] * 6


def test_health_can_be_set_on_the_running_node(changing):
    client = changing
    for health in ([1.0, 1.0, 1.0, 0.0, 1.0, 1.0], [1.0, 0.6, 1.0, 1.0, 1.0, 1.0], 1.0):
        [result] = client.parameters.set({'rotors.health': health})
        assert result.successful, result.reason
        client.twin = twin(health=health)
        for numbers in (HOVER, *some_wrenches(5)):
            speeds = client.ask(numbers)
            assert speeds.tobytes() == client.expected.speeds.tobytes()
            lost = np.broadcast_to(health, 6) == 0.0
            assert not speeds[lost].any()
            assert np.all((speeds[~lost] >= 40.0) & (speeds[~lost] <= 400.0))
    # A lost rotor is not at its minimum; the loss does not hide the status of the answers.
    [result] = client.parameters.set({'rotors.health': [1.0, 1.0, 1.0, 0.0, 1.0, 1.0]})
    client.graph.spin_until(
        lambda: client.saturation[-1:]
        and client.saturation[-1].data.tolist() == [-1, -1, 0, -2, 0, -1], 'a lost rotor',
        repeat=lambda: client.ask((0.0, 0.0, -1e3, 0.0, 0.0, 0.0)))
    status, values = client.diagnose()
    assert status.level == DiagnosticStatus.ERROR
    assert 'lost' in status.message
    assert status.message.endswith('; PRIORITIZED')
    assert values['lost rotors'] == '4'


def test_a_change_of_health_counts_from_the_next_command_on_and_loses_none(changing):
    client, first = changing, changing.sent + 1
    healths = [[1.0, 1.0, 1.0, 0.0, 1.0, 1.0], [1.0, 0.6, 1.0, 1.0, 1.0, 1.0], 1.0] * 5
    expected = []
    for health, following in zip(healths, [*healths[1:], None], strict=True):
        [result] = client.parameters.set({'rotors.health': health})
        assert result.successful, result.reason
        client.twin = twin(health=health)
        speeds = client.ask(HOVER)
        assert speeds.tobytes() == client.expected.speeds.tobytes()
        expected.append({speeds.tobytes()})
        # These are not waited for: the next change may overtake some of them.
        later = None if following is None else twin(health=following)
        for numbers in some_wrenches(5):
            client.send(numbers)
            answers = [client.expected, *([later.allocate(numbers[2:])] if later else [])]
            expected.append({answer.speeds.tobytes() for answer in answers})
    client.graph.spin_until(
        lambda: len(client.speeds) >= client.sent + 1 - first, 'an answer to each command')
    labels = [message.layout.dim[1].label for message in client.speeds]
    assert labels == [f'stamp {number}000000007' for number in range(first, client.sent + 1)]
    for message, answers in zip(client.speeds, expected, strict=True):
        assert np.array(message.data).tobytes() in answers


# Faults of a method, and stalls

OWN = """
import numpy as np

from ca_ros.allocation import Allocation
from ca_ros.allocation import PseudoInverse
from ca_ros.allocation import Status


class Own(PseudoInverse):
    def _set_up(self):
        super()._set_up()
        if self.problem.vehicle.health[0] == 0.5:
            raise RuntimeError('no such vehicle')

    def _allocate(self, u):
        if u[0] == 0.0:
            raise ZeroDivisionError('no thrust')
        if u[0] < 1e3:
            answer = super()._allocate(u)
            return Allocation(self.problem, u, answer.thrusts, answer.status.name)
        if u[0] == 3e4:
            return Allocation(self.problem, u[:2], np.ones(6), Status.INEXACT)
        if u[0] == 4e4:
            return Allocation(self.problem, u, np.ones(6), 'FINE')
        return None if u[0] == 1e4 else Allocation(self.problem, u, np.full(6, 1.0j), Status.EXACT)
"""


def test_a_fault_of_a_method_costs_one_command_and_a_refused_change_none(graph, tmp_path):
    (tmp_path / 'own.py').write_text(OWN)
    graph.start(
        'allocator', '--vehicle', 'hexarotor', '--ros-args', '-p', 'allocation.method:=own:Own',
        cwd=tmp_path)
    client = AllocatorClient(graph)
    client.twin = twin('pseudo_inverse')
    # Also if the method answers no command at all, or not with a sound allocation.
    for thrust in (0.0, 1e4, 2e4, 3e4, 4e4):
        failing = graph.node.create_timer(0.01, lambda thrust=thrust: client.command.publish(
            wrench(thrust)))
        graph.spin_until(
            lambda: client.speeds and client.speeds[-1].data.tolist() == [40.0] * 6
            and client.diagnostics
            and client.diagnostics[-1].status[0].message.startswith(
                'only commands that the method fails to answer: idle'), 'the timeout action')
        failing.cancel()
        assert client.ask(HOVER).tobytes() == client.expected.speeds.tobytes()
    graph.spin_until(
        lambda: any('dropped: answer' in {pair.key for pair in array.status[0].values}
                    for array in client.diagnostics), 'the count')
    [result] = client.parameters.set({'rotors.health': 0.5})
    assert (result.successful, result.reason) == (
        False, 'rotors.health: RuntimeError: no such vehicle')
    assert client.ask(HOVER).tobytes() == client.expected.speeds.tobytes()


def test_after_a_stall_only_the_newest_of_what_waits_is_received(graph):
    publisher = graph.publisher(WrenchStamped, 'command/wrench')
    received, counts = [], Counter()
    streams = Streams(graph.node, RealTime(), lambda *_: None, counts)
    streams.subscribe(topics.WRENCH, lambda command: received.append(command.sec), read_wrench)
    graph.spin_until(streams.subscriptions[0].get_publisher_count, 'matched')

    def arrive():
        """As the middleware hands over what the kernel has kept: while the node takes it."""
        for second in (1, 2, 3):
            publisher.publish(wrench(HOVER, second * 10**9))
            time.sleep(0.005)

    for second in (1, 2):
        streams.note_stall()
        publisher.publish(wrench(HOVER, second * 10**9))
        graph.spin_until(lambda second=second: received == [*range(1, second + 1)], 'each')
    # Where the machine stalls, too, the newest may arrive too late.
    for _ in range(5):
        received.clear()
        time.sleep(1.5 * STALL_MIN)
        with ThreadPoolExecutor(1) as pool:
            pool.submit(arrive)
            graph.spin_until(lambda: received[-1:] == [3], 'the newest')
        if received == [3]:
            break
    assert received == [3]
    # They count as those that a newer one has replaced.
    assert counts['lost: command/wrench'] >= 2


# Names and quality of service

def test_allocators_in_two_namespaces_do_not_meet_and_best_effort_is_enough(graph):
    for namespace in ('/uav1', '/uav2'):
        host(graph, 'allocator', '-r', f'__ns:={namespace}', '-p', 'command_timeout:=1000.0')
    one, two = (AllocatorClient(graph, namespace, BEST_EFFORT) for namespace in ('/uav1', '/uav2'))
    for numbers in some_wrenches(3):
        assert one.ask(numbers).tobytes() == one.expected.speeds.tobytes()
    assert two.speeds == two.allocated == []
    np.testing.assert_allclose(two.ask(HOVER), [HOVER_SPEED] * 6, rtol=1e-12)
    assert (len(one.speeds), len(two.speeds)) == (6, 1)
    names = [name for name, _ in graph.node.get_topic_names_and_types()]
    assert '/uav1/command/wrench' in names
    assert '/command/wrench' not in names
