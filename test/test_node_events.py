"""What holds from a stamp on: waypoints and announced failures, and whose word counts."""

import re
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from ca_ros import ParameterError, Vehicle
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.executable import parse
from ca_ros.nodes.messages import announcement, read_announcement, speeds_message, stamp
from ca_ros.nodes.mode import DEPTH, Lockstep, RealTime
from ca_ros.nodes.topics import STANDING
from ca_ros.testing import Diagnostics, wrench
from nodes import ControllerClient, expected, host, pose_message

NAMES = {'monitor': 'rotor_health', 'announced': 'rotor_health/announced'}
STEP = 10_000_000  # [ns]
AT_REST = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
LEVEL = 0.0, 0.0, 0.0, 1.0


# The mode alone

def test_in_lockstep_a_message_holds_from_its_stamp_on_and_in_real_time_at_once():
    for mode, seen in ((Lockstep(), [0, 0, 0, 1, 3]), (RealTime(), [3, 3, 3, 3, 3])):
        done = []
        # A copy of a message counts once.
        for time in (30, 20, 50, 20):
            assert mode.take(time, 'waypoint', partial(done.append, time))
        found = []
        for time in (0, 10, 19, 20, 60):
            mode.advance(time)
            found.append(len({*done}))
        assert found == seen
        if not mode.clocked:
            assert done == [20, 30, 50]
        assert mode.values() == {}


def test_in_lockstep_a_message_without_a_stamp_or_of_the_past_holds_at_once():
    mode, done = Lockstep(), []
    mode.take(0, 'waypoint', lambda: done.append('no stamp'))
    mode.advance(30)
    mode.take(30, 'waypoint', lambda: done.append('present'))
    mode.take(31, 'waypoint', lambda: done.append('future'))
    assert done == ['no stamp', 'present']
    assert mode.values() == {'kept for their stamps': '1, the first from 3.1e-08 s on'}
    # After a reset the same stamp comes again.
    mode.advance(0)
    mode.advance(31)
    assert done[2:] == ['future']


def test_in_lockstep_no_more_messages_are_kept_than_a_queue_holds():
    mode = Lockstep()
    assert all(mode.take(1 + i, 'waypoint', int) for i in range(DEPTH))
    assert not mode.take(DEPTH + 1, 'waypoint', int)
    assert mode.take(DEPTH, 'waypoint', int)


# Over ROS

class Rotors:
    """An allocator in lockstep, and those who speak of the health of its rotors."""

    def __init__(self, graph, vehicle, *words):
        self.graph, self.vehicle = graph, Vehicle.load(vehicle)
        self.publishers = {
            who: graph.node.create_publisher(Float64MultiArray, name, STANDING)
            for who, name in NAMES.items()}
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.tilts = len(self.vehicle.servos)
        if self.tilts:
            self.angles = graph.listen(Float64MultiArray, 'command/tilt_angle')
        self.diagnostics = Diagnostics(graph)
        ros = parse('allocator', '', ['--vehicle', vehicle, '--ros-args', *words],
                    AllocatorNode.declared)
        self.node = graph.add_node(
            AllocatorNode(context=graph.context, cli_args=ros, use_global_arguments=False))
        graph.connect('allocator')
        for who, publisher in self.publishers.items():
            graph.spin_until(publisher.get_subscription_count, f'{who} is heard')

    def say(self, who, health, stuck=None, time=None):
        """Say what the health is, and wait until the node has it."""
        message = speeds_message(np.array(health, float), time)
        if who == 'announced':
            message = announcement(np.array(health, float), stuck or {}, time)
        self.publishers[who].publish(message)
        self.graph.spin_until(
            lambda: self.publishers[who].wait_for_all_acked(), f'{who} is received')

    def at(self, time):
        """Send a wrench of hover for a state [ns]; return which rotors stand still, from 1."""
        label = f'stamp {time}'
        message = wrench(self.vehicle.weight, time, 'base_link')

        def answered(messages):
            return messages and messages[-1].layout.dim[1].label == label

        self.graph.spin_until(
            lambda: answered(self.speeds) and (not self.tilts or answered(self.angles)),
            f'an answer to {time}', repeat=lambda: self.command.publish(message))
        return (np.flatnonzero(np.array(self.speeds[-1].data) == 0.0) + 1).tolist()


def lost(*rotors):
    """Return a health of six rotors of which some are lost."""
    return [0.0 if i + 1 in rotors else 1.0 for i in range(6)]


def test_an_announcement_holds_from_its_stamp_on_whatever_the_monitor_says(graph):
    rotors = Rotors(graph, 'hexarotor', '-p', 'mode:=lockstep')
    rotors.say('announced', lost(2, 3), time=5 * STEP)
    rotors.say('announced', lost(2), time=3 * STEP)
    rotors.diagnostics.wait(
        'allocator', lambda *status: status[2].get('kept for their stamps', '').startswith('2, '),
        'what it keeps')
    assert [rotors.at(k * STEP) for k in range(3)] == [[], [], []]
    # All ones of the monitor do not cancel it.
    rotors.say('monitor', lost())
    assert [rotors.at(k * STEP) for k in (3, 4, 5)] == [[2], [2], [2, 3]]
    rotors.say('monitor', lost(4))
    assert rotors.at(6 * STEP) == [2, 3, 4]
    # Without a stamp at once; the newest of each source holds.
    rotors.say('announced', lost(1))
    assert rotors.at(7 * STEP) == [1, 4]
    rotors.say('monitor', lost())
    assert rotors.at(8 * STEP) == [1]
    rotors.say('announced', lost())
    assert rotors.at(9 * STEP) == []


def test_in_real_time_an_announcement_holds_at_once_whatever_its_stamp(graph):
    rotors = Rotors(graph, 'hexarotor')
    rotors.say('announced', lost(2), time=10**18)
    rotors.diagnostics.wait(
        'allocator', lambda *status: status[2]['lost rotors'] == '2', 'the lost rotor')
    rotors.say('monitor', lost())
    assert rotors.at(STEP) == [2]


NONSENSE = (
    ([1.0] * 5, 'the health of 6 rotors'), ([1.0] * 6 + [2.0], 'pairs of what sticks'),
    ([1.0] * 6 + [1.5, 0.1], 'pairs of what sticks'), ([1.0] * 6 + [np.inf, 0.1], 'pairs of what'),
    ([2.0] * 6, 'in [0, 1]'), ([np.nan] * 6, 'in [0, 1]'),
    ([1.0] * 6 + [7.0, 0.1], 'rotor: 7 has no'), ([1.0] * 6 + [2.0, np.nan], 'angle: expected'))


def test_servos_stick_as_announced_and_what_is_no_announcement_is_refused(graph):
    rotors = Rotors(graph, 'hexarotor_tilting', '-p', 'mode:=lockstep')
    rotors.say('announced', lost(), {2: 0.3})
    rotors.at(0)
    assert rotors.angles[-1].data[1] == 0.3
    for count, (numbers, words) in enumerate(NONSENSE):
        with pytest.raises(ParameterError, match=re.escape(words)):
            rotors.node.belief.current.check(*read_announcement(
                Float64MultiArray(data=numbers), 6))
        rotors.publishers['announced'].publish(Float64MultiArray(data=numbers))
        rotors.diagnostics.wait(
            'allocator', lambda *status, count=count: status[2].get('refused health') == str(
                count + 1), words)
    rotors.at(STEP)
    assert rotors.angles[-1].data[1] == 0.3
    rotors.say('announced', lost())
    rotors.at(2 * STEP)
    assert rotors.angles[-1].data[1] != 0.3


def test_a_waypoint_holds_from_its_stamp_on(graph):
    client = ControllerClient(graph, start=host)
    here, there = ((0.0, 0.0, 0.0), LEVEL), ((1.0, 0.5, 2.0), LEVEL)
    message = pose_message(*there, 0)
    message.header.stamp = stamp(3 * 10**9)
    client.waypoint.publish(message)
    client.send_waypoint(*here)
    for second, goal in ((1, here), (2, here), (3, there), (4, there)):
        found = client.ask(*AT_REST)
        assert client.last == second
        np.testing.assert_array_equal(found, expected(AT_REST, goal))


def test_of_the_waypoints_kept_for_it_a_late_controller_flies_to_the_newest(graph):
    kept = graph.publisher(PoseStamped, 'command/pose', STANDING)
    kept.publish(pose_message((1.0, 0.0, 0.0), LEVEL, 0))
    client = ControllerClient(graph, start=host)
    graph.spin_until(lambda: client.process.waypoint, 'the waypoint')
    found = client.ask(*AT_REST)
    np.testing.assert_array_equal(found, expected(AT_REST, ((1.0, 0.0, 0.0), LEVEL)))
