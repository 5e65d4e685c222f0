"""What no sound sender would send: nothing unsound goes out, the next good command is served."""

import itertools
import math
import signal
import time
from collections import Counter

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray, Int8MultiArray, MultiArrayDimension

from ca_ros import AdmissibleSet
from ca_ros.testing import Diagnostics, counts, six, wrench
from ca_ros.vehicle.state import NULL_STATE
from nodes import (
    BODY,
    HOVER,
    LAW,
    REST,
    STEP,
    WAYPOINT,
    ControllerClient,
    SimulatorClient,
    expected,
    host,
    nanoseconds,
    pose_message,
    published,
    some_wrenches,
    state_array,
    twin,
    velocity_message,
)
from strategies import length

FUZZ = length(200, 500, 10_000)
"""So many messages each node gets."""

BATCH = 50
"""So many bad messages are sent between two good ones."""

FAULTS = math.nan, math.inf, -math.inf
ADMISSIBLE = AdmissibleSet(LAW.vehicle)
NUMBERS = (
    *FAULTS, 1e12, -1e12, 1e99, 1e101, -1e200, np.finfo(float).max,
    -np.finfo(float).max, 5e-324, -5e-324, 0.0, -0.0)
FRAMES = 'base_link', '', 'map', '/base_link', 'base_link ', 'base\nlink', 'ä', 10_000 * 'x'
SECONDS = -2**31, -1, 0, 1, 2**31 - 1
NANOSECONDS = 0, 999_999_999, 1_000_000_000, 2**32 - 1


def some_number(rng):
    """Draw a number that is mostly sound."""
    if rng.random() < 0.1:
        return float(rng.choice(NUMBERS))
    return float(rng.normal() * 10.0 ** rng.uniform(-3.0, 3.0))


def some_numbers(rng, size):
    """Draw some of them."""
    return [some_number(rng) for _ in range(size)]


def choose(rng, options):
    """Draw one of them, of its own type."""
    return options[rng.integers(len(options))]


def some_header(rng, header):
    """Draw stamp and frame."""
    header.frame_id = choose(rng, FRAMES)
    header.stamp.sec = choose(rng, SECONDS)
    header.stamp.nanosec = choose(rng, NANOSECONDS)


class Allocator:
    """Commands an allocator."""

    name = '/allocator'

    def __init__(self, graph):
        self.graph, self.sent, self.expected = graph, 0, []
        self.twin, self.undisturbed = twin(), twin()
        self.process = graph.start(
            'allocator', '--vehicle', 'hexarotor', '--ros-args', '-p', 'mode:=lockstep')
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.accounts = [
            graph.listen(WrenchStamped, f'allocator/{name}')
            for name in ('allocated_wrench', 'residual')]
        self.saturation = graph.listen(Int8MultiArray, 'allocator/saturation')
        self.diagnostics = Diagnostics(graph)
        graph.connect('allocator')
        self.good = itertools.cycle(some_wrenches(20))
        self.last = 10**9
        # The node may learn only after the first command that somebody listens to all of this.
        self.graph.spin_until(
            lambda: all((self.speeds, *self.accounts, self.saturation)), 'all accounts',
            repeat=self.begin)
        self.clear()

    def begin(self):
        """Send a good command, as if it were the first, when that before it is answered."""
        if self.sent and not self.speeds:
            return
        self.clear()
        self.send(WrenchStamped(), HOVER)

    def clear(self):
        """Forget what has been heard."""
        for messages in (self.expected, self.speeds, *self.accounts, self.saturation):
            messages.clear()

    def fuzz(self, rng):
        """Send a message with any faults; note the answer, if there should be one."""
        message = WrenchStamped()
        some_header(rng, message.header)
        self.send(message, some_numbers(rng, 6))

    def combine(self):
        """Send a message for each combination of a number with what is none."""
        for i, fault in itertools.product(range(6), FAULTS):
            wrench = np.where(np.arange(6) == i, fault, HOVER)
            self.send(WrenchStamped(), wrench)
            yield

    def send(self, message, wrench):
        """Send a wrench."""
        f, t = message.wrench.force, message.wrench.torque
        f.x, f.y, f.z, t.x, t.y, t.z = map(float, wrench)
        self.command.publish(message)
        self.sent += 1
        sound = all(abs(number) <= 1e100 for number in wrench)
        if sound and message.header.frame_id in ('', 'base_link'):
            stamp = message.header.stamp
            self.expected.append((
                f'stamp {stamp.sec * 10**9 + stamp.nanosec}',
                self.twin.allocate(np.array(wrench)[2:]).speeds.tolist()))

    def ask(self):
        """Send a good command and wait for its answer."""
        self.last += 1
        message = WrenchStamped()
        message.header.stamp.sec = self.last
        wrench = next(self.good)
        self.send(message, wrench)
        self.graph.spin_until(
            lambda: self.speeds and said(self.speeds[-1])[0] == self.expected[-1][0], 'an answer')
        assert said(self.speeds[-1]) == self.expected[-1]
        np.testing.assert_allclose(
            self.speeds[-1].data, self.undisturbed.allocate(wrench[2:]).speeds, rtol=1e-12)

    def settle(self):
        """Send a good command and check the answers to all: each is as if it were alone."""
        self.ask()
        assert list(map(said, self.speeds)) == self.expected
        self.graph.spin_until(
            lambda: all(
                len(messages) == len(self.speeds)
                for messages in (*self.accounts, self.saturation)), 'all accounts')
        for message in self.speeds:
            assert all(40.0 <= speed <= 400.0 for speed in message.data)
        for message in itertools.chain(*self.accounts):
            assert np.isfinite(six(message)).all()
        for message in self.saturation:
            assert {-1, 0, 1} >= set(message.data)
        self.clear()

    def inputs(self):
        """Return type and topic of each input, and a sound message for it."""
        return [(WrenchStamped, 'command/wrench', wrench(0.0, frame='base_link'))]


def said(message):
    """Return label and rotor speeds of an answer."""
    return message.layout.dim[1].label, message.data.tolist()


NONE = *FAULTS, -1.0, -5e-324, 400.1, 1e12, 1e300
"""What is no rotor speed [rad/s]."""


class Simulator(SimulatorClient):
    """Commands a simulator."""

    name = '/simulator'

    def __init__(self, graph):
        super().__init__(graph, 'lockstep')
        self.sent, self.present, self.time = 0, NULL_STATE, 0
        self.diagnostics = Diagnostics(graph)
        graph.connect('simulator')
        self.rng = np.random.default_rng(3)

    def fuzz(self, rng):
        """Send a message that is not to be followed."""
        speeds = some_numbers(rng, choose(rng, (6, 6, 6, 6, 0, 1, 5, 7, 12, 1000)))
        if rng.random() < 0.5:
            speeds = [abs(speed) for speed in speeds]
        label = choose(rng, (
            f'stamp {self.time}', f'stamp {self.time - 1}', f'stamp {self.time - STEP}',
            f'stamp {self.time + STEP}', 'stamp \N{SUPERSCRIPT TWO}', 'stamp -1', 'stamp 1e3',
            'stamp', '', 'no stamp', 'stamp ' + 30 * '9', 5000 * 'ä'))
        if label == f'stamp {self.time}' and len(speeds) == 6:
            speeds[rng.integers(6)] = choose(rng, NONE)
        self.send(speeds, *(choose(rng, (label, '')) for _ in range(rng.integers(4))))

    def combine(self):
        """Send a message for each combination of a number with what is none."""
        for i, fault in itertools.product(range(6), NONE):
            self.send(np.where(np.arange(6) == i, fault, 255.0), f'stamp {self.time}')
            yield

    def send(self, speeds, *labels):
        """Send rotor speeds."""
        message = Float64MultiArray(data=[float(speed) for speed in speeds])
        message.layout.dim = [MultiArrayDimension(label=label) for label in labels]
        self.command.publish(message)
        self.sent += 1

    def ask(self):
        """Send a good command and wait for the step that it makes; return the rotor speeds."""
        speeds = self.rng.uniform(200.0, 300.0) + self.rng.uniform(-1.0, 1.0, 6)
        self.send(speeds, f'stamp {self.time}')
        self.present = BODY.step(self.present, speeds, STEP / 1e9)
        self.time += STEP
        self.graph.spin_until(
            lambda: all(
                messages and nanoseconds(messages[-1]) == self.time
                for messages in (self.poses, self.velocities)), f'the state of {self.time} ns')
        state = state_array(self.poses[-1], self.velocities[-1])
        assert state.tobytes() == published(self.present).tobytes()
        return speeds

    def settle(self):
        """Send a good command; the step that it makes is the only one."""
        speeds = self.ask()
        for message in (*self.poses, *self.velocities):
            assert nanoseconds(message) in (self.time - STEP, self.time)

        def followed():
            return [message.data.tolist() for message in self.speeds if any(message.data)]

        self.graph.spin_until(followed, 'the rotor speeds of the step')
        assert followed() == [speeds.tolist()]
        for messages in (self.poses, self.velocities, self.speeds):
            messages.clear()

    def inputs(self):
        """Return type and topic of each input, and a sound message for it."""
        message = Float64MultiArray(data=[255.0] * 6)
        return [(Float64MultiArray, 'command/motor_speed', message)]


class Controller(ControllerClient):
    """Shows states and waypoints to a controller."""

    name = '/controller'

    def __init__(self, graph):
        super().__init__(graph)
        self.sent, self.diagnostics = 0, Diagnostics(graph)
        graph.connect('controller')
        self.waypoint.publish(pose_message(*WAYPOINT, 0))
        self.diagnostics.wait(
            self.name, lambda level, message, values: message == 'no state yet', 'a waypoint')
        self.rng = np.random.default_rng(4)

    def fuzz(self, rng):
        """Send a state, half of a state or a waypoint with any faults."""
        numbers = np.array(some_numbers(rng, 13))
        part = rng.integers(5)
        if part == 0:
            numbers[rng.integers(7)] = choose(rng, FAULTS)
            self.waypoint.publish(pose_message(numbers[:3], numbers[3:7], 0))
            return
        self.last += int(rng.integers(2))
        if part != 1:
            message = pose_message(numbers[:3], numbers[3:7], self.last)
            message.header.frame_id = choose(rng, FRAMES)
            self.send_pose(message)
        if part != 2:
            message = velocity_message(numbers[7:10], numbers[10:], self.last)
            message.header.stamp.nanosec = choose(rng, (0, 0, *NANOSECONDS))
            self.velocity.publish(message)

    def combine(self):
        """Send a message for each combination of a number with what is none."""
        state = np.concatenate(REST)
        for i, fault in itertools.product(range(13), FAULTS):
            self.send(np.where(np.arange(13) == i, fault, state))
            yield
        waypoint = np.concatenate(WAYPOINT)
        for i, fault in itertools.product(range(7), FAULTS):
            numbers = np.where(np.arange(7) == i, fault, waypoint)
            self.waypoint.publish(pose_message(numbers[:3], numbers[3:], 0))
            yield

    def send(self, state):
        """Send a state (13,): position, attitude, velocity, angular velocity."""
        self.last += 1
        self.send_pose(pose_message(state[:3], state[3:7], self.last))
        self.velocity.publish(velocity_message(state[7:10], state[10:], self.last))

    def send_pose(self, message):
        """Send a pose."""
        self.pose.publish(message)
        self.sent += 1

    def ask(self):
        """Send a good state and wait for its answer."""
        state = self.rng.normal(scale=2.0, size=13)
        self.send(state)
        self.graph.spin_until(
            lambda: self.wrenches and self.wrenches[-1].header.stamp.sec == self.last,
            f'the wrench of {self.last} s')
        parts = state[:3], state[3:7], state[7:10], state[10:]
        assert six(self.wrenches[-1]).tobytes() == expected(parts).tobytes()

    def settle(self):
        """Send a good state; all answers up to its own are admissible."""
        self.ask()
        for message in self.wrenches:
            wrench = six(message)
            assert np.isfinite(wrench).all()
            assert not wrench[:2].any()
            assert ADMISSIBLE.margin(wrench[2:]) >= -1e-9
        self.wrenches.clear()

    def inputs(self):
        """Return type and topic of each input, and a sound message for it."""
        return [
            (PoseStamped, 'command/pose', pose_message(*WAYPOINT, 0)),
            (PoseStamped, 'local_position/pose', pose_message(*REST[:2], 0)),
            (TwistStamped, 'local_position/velocity_body', velocity_message(*REST[2:], 0))]


def check_account(node):
    """What a node has received is served or dropped, with the reason; its output has no bug."""
    def complete(level, message, values):
        account = counts(values)
        dropped = sum(n for key, n in account.items() if key.startswith('dropped: '))
        others = sum(account[key] for key in ('served', 'rejected', 'repeated', 'unanswered'))
        return account['received'] == node.sent == others + dropped
    _, _, values = node.diagnostics.wait(node.name, complete, f'account of {node.sent}')
    return counts(values)


def check_log(node):
    """A node ends cleanly and has not said what only a bug says."""
    out, err = node.graph.end(node.process, signal.SIGINT)
    assert (node.process.returncode, out) == (0, ''), err
    for word in ('Traceback', 'Warning:', 'Error'):
        assert word not in err, err


NODES = Allocator, Simulator, Controller


@pytest.mark.slow
@pytest.mark.timeout(1200 + FUZZ // 20)
@pytest.mark.parametrize('kind', NODES)
def test_after_anything_the_next_good_message_is_answered_as_if_nothing_had_been(
        graph, kind, record_property):
    node, rng = kind(graph), np.random.default_rng(6)
    node.settle()
    for k in range(FUZZ):
        node.fuzz(rng)
        if k % BATCH == BATCH - 1:
            node.settle()
    # Each number that is none, alone.
    for _ in node.combine():
        node.settle()
    account = check_account(node)
    send_bytes(node, rng)
    check_log(node)
    record_property(f'{FUZZ} messages to {node.name}', dict(account))


def send_bytes(node, rng):
    """Send bytes that are no message; they end no node."""
    others = [
        (node.graph.publisher(kind, topic), serialize_message(message))
        for kind, topic, message in node.inputs()]
    for publisher, _ in others:
        node.graph.spin_until(publisher.get_subscription_count, 'matched')
    node.ask()
    for publisher, sound in others:
        # On its way a message is filled up to four bytes, and then may be one again.
        for size in range(4, len(sound) - 4):
            publisher.publish(sound[:size])
        for size in range(4, 200):
            publisher.publish(sound[:4] + rng.bytes(size))
        if 'pose' not in publisher.topic:
            for place in range(4, len(sound) - 3, 4):
                publisher.publish(sound[:place] + b'\xff\xff\xff\x7f' + sound[place + 4:])
        node.ask()


# Time

class Clock:
    """Sends commands with stamps around now to an allocator, and tells which were served."""

    def __init__(self, graph, mode, *options):
        self.graph, self.now, self.sent = graph, time.time_ns(), 0
        host(graph, 'allocator', '-p', f'mode:={mode}', *options)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)
        graph.connect('allocator')

    def send(self, offset, thrust=9.81, frame='base_link'):
        """Send a command that is so many nanoseconds younger than the beginning."""
        self.command.publish(wrench(thrust, self.now + offset, frame))
        self.sent += 1

    def served(self):
        """Return the offsets of the commands that were served [ns]."""
        labels = [message.layout.dim[1].label for message in self.speeds]
        return [
            int(label.removeprefix('stamp ')) - self.now
            for label in labels if label != 'no stamp']


def test_old_and_disordered_commands_are_dropped_as_the_policy_says(graph):
    clock = Clock(graph, 'lockstep', '-p', 'command_age_max:=1000.0', '-p', 'command_timeout:=1e3')
    rng, served, account, before = np.random.default_rng(9), [], Counter(), -math.inf
    for k in range(300):
        fate = choose(rng, ('good', 'good', 'old', 'future', 'disordered', 'numbers', 'frame'))
        # What is dropped must not count as the one before.
        offset = {
            'good': k * 1000, 'disordered': int(rng.integers(k * 1000 + 1)), 'old': -10**13,
            'future': 10**15, 'numbers': 10**15, 'frame': 10**15}[fate]
        clock.send(
            offset, math.nan if fate == 'numbers' else 9.81,
            'map' if fate == 'frame' else 'base_link')
        if fate in ('old', 'future'):
            account['dropped: age'] += 1
        elif fate in ('numbers', 'frame'):
            account[f'dropped: {fate}'] += 1
        else:
            account['out of order'] += offset < before
            before = offset
            served.append(offset)
    graph.spin_until(lambda: len(clock.served()) >= len(served), 'the answers')
    assert clock.served() == served
    _, _, values = clock.diagnostics.wait(
        '/allocator', lambda level, message, values: counts(values)['received'] == clock.sent,
        'all received')
    said = counts(values)
    names = 'dropped', 'out of order'
    assert {key: n for key, n in said.items() if key.startswith(names)} == account
    assert said['served'] == len(served)


@pytest.mark.parametrize(('mode', 'first'), [('realtime', 'served'), ('lockstep', 'rejected')])
def test_one_stamp_from_the_future_does_not_shut_out_all_that_follow(graph, mode, first):
    clock = Clock(graph, mode, '-p', 'allocation.exact.policy:=reject')
    future = 10**15
    clock.send(future, thrust=9.81 if first == 'served' else 1e3)
    if first == 'served':
        graph.spin_until(clock.served, 'an answer')
    offsets = itertools.count(1)
    graph.spin_until(
        lambda: future not in clock.served()[-1:] and clock.served(), 'another answer',
        repeat=lambda: clock.send(next(offsets)))
    assert clock.served()[-1] < future
