"""Commands that cease, in the allocator and in the simulator."""

import math
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray

from ca_ros.nodes.stream import TICK
from ca_ros.nodes.watchdog import Watchdog
from ca_ros.testing import Diagnostics, counts, wrench
from nodes import STALL, host, separate, start_flood, stolen, stood_still
from strategies import length, sixteen_rotors

TIMEOUTS = length(3, 6, 150)
"""So many times in a row each watchdog has to be in time."""

TIMEOUT = 0.05
"""[s]"""

STEP = 0.01
"""Of the simulator, which shows its rotor speeds so often [s]."""

CHANGES = 0.25
"""How long two changes of parameters may take at most, for 16 rotors and six axes [s]."""

ACTIONS = 'idle', 'stop', 'hold'
NAMES = 'allocator', 'simulator'


class Watched:
    """An allocator or a simulator that gets commands now and then."""

    def __init__(self, graph, name, *options, start=separate):
        self.graph, self.name, self.timeouts, self.speed = graph, f'/{name}', 0, 255.0
        self.allocates = name == 'allocator'
        self.process = start(graph, name, '-p', f'command_timeout:={TIMEOUT}', *options)
        if self.allocates:
            self.command = graph.publisher(WrenchStamped, 'command/wrench')
            self.heard = graph.listen(Float64MultiArray, 'command/motor_speed')
        else:
            self.command = graph.publisher(Float64MultiArray, 'command/motor_speed')
            self.heard = graph.listen(Float64MultiArray, 'motor_speed')
        self.diagnostics = Diagnostics(graph)
        self.parameters = graph.connect(name)

    def send(self, speed=None):
        """Command a speed of all rotors [rad/s]."""
        speed = self.speed if speed is None else speed
        if self.allocates:
            message = wrench(6 * 2.5e-5 * speed**2)
        else:
            message = Float64MultiArray(data=[speed] * 6)
        self.sent = time.monotonic()
        self.command.publish(message)

    def told(self, action):
        """Tell whether the newest speeds heard are those of a timeout action."""
        speed = {'idle': 40.0, 'stop': 0.0, 'hold': self.speed}[action]
        return bool(self.heard) and (
            not self.allocates or fallen_back(self.heard[-1])) and np.allclose(
            self.heard[-1].data, speed, rtol=1e-12, atol=0.0)

    def fly(self):
        """Command a speed that has not been commanded before, until it is followed."""
        self.heard.clear()
        self.sends = 0

        def send():
            # Each time another: an answer to the one before would not be the last.
            self.speed += 0.01
            self.sends += 1
            self.send()

        self.graph.spin_until(
            lambda: self.heard and np.allclose(self.heard[-1].data, self.speed, rtol=1e-12)
            and not (self.allocates and fallen_back(self.heard[-1])),
            f'{self.name} follows', repeat=send)

    def wait_for(self, action):
        """Wait until the rotors are told what to do, once more if they have been."""
        self.heard.clear()
        self.graph.spin_until(lambda: self.told(action), f'{self.name}: {action}')

    def wait_for_timeout(self, action):
        """Wait until the node has said that it is over, one time more than before."""
        self.timeouts += 1
        said = DiagnosticStatus.ERROR, f'no command: {action}'
        *_, values = self.diagnostics.wait(
            self.name,
            lambda *now: now[:2] == said and counts(now[2])['timeouts'] >= self.timeouts,
            f'time-out {self.timeouts}: {said}')
        # One more than was asked for is the machine's, which stood still for longer.
        self.timeouts = counts(values)['timeouts']

    def wait_a_while(self):
        """Wait for much longer than the time-out, by the node's own clock."""
        before = len(self.diagnostics.all(self.name))
        self.graph.spin_until(
            lambda: len(self.diagnostics.all(self.name)) >= before + 2, 'two diagnoses')


def fallen_back(message):
    """Tell whether rotor speeds of the allocator answer no command."""
    return message.layout.dim[1].label == 'no stamp'


def work(pid):
    """Return how long the threads of a process have worked, or waited for a processor [s]."""
    total = 0
    for path in Path(f'/proc/{pid}/task').glob('*/schedstat'):
        worked, waited, _ = path.read_text().split()
        total += int(worked) + int(waited)
    return total / 1e9


@pytest.mark.slow
@pytest.mark.timeout(1200 + TIMEOUTS)
@pytest.mark.parametrize('name', NAMES)
def test_the_rotors_are_told_in_time_again_and_again(graph, name, record_property):
    """In time is: within the time-out and one period.

    What is measured here also holds what the machine did to both processes in the meantime, which
    the kernel tells, but for short stalls of the machine itself.  Who is late begins a new row.
    """
    node, delays, row = Watched(graph, name), [], 0
    period = TICK if node.allocates else TICK + STEP
    while row < TIMEOUTS:
        action = ACTIONS[row % 3]
        assert node.parameters.set_atomically({'timeout_action': action}).successful
        before = work(node.process.pid) + work(os.getpid()) + stolen()
        node.fly()
        if node.sends > 1:
            # The machine stood still, and there was a time-out before this flight.
            node.wait_a_while()
            node.timeouts = counts(node.diagnostics.all(node.name)[-1][2])['timeouts']
            continue
        if name == 'simulator' and action == 'hold':
            node.wait_for_timeout(action)
        else:
            node.wait_for(action)
        delay = time.monotonic() - node.sent - TIMEOUT
        load = work(node.process.pid) + work(os.getpid()) + stolen() - before
        assert delay > 0.0, 'too early'
        row = row + 1 if delay <= period + load + STALL else 0
        delays.append(delay)
        assert len(delays) < 5 * TIMEOUTS, f'late: {np.round(delays, 3)}'
        if name == 'allocator' or action != 'hold':
            node.wait_for_timeout(action)
        for _ in range(3):
            node.wait_for(action)
    p50, highest = (1e3 * np.percentile(delays, (50, 100))).tolist()
    record_property(f'{name}: time-outs in a row', TIMEOUTS)
    record_property(f'{name}: of how many', len(delays))
    record_property(f'{name}: after the time-out, p50 [ms]', round(p50, 1))
    record_property(f'{name}: after the time-out, max [ms]', round(highest, 1))


@pytest.mark.slow
@pytest.mark.parametrize('name', length(['allocator'], NAMES))
def test_a_flood_of_what_is_dropped_delays_nothing_for_long(graph, name):
    node = Watched(graph, name)
    timer = graph.node.create_timer(TICK, node.send)
    flood = start_flood(graph, name, math.nan)
    node.diagnostics.wait(
        node.name, lambda level, message, values: counts(values)['dropped: numbers'] > 1000,
        'a flood')
    timer.cancel()
    for _ in range(20):
        node.wait_for('idle')
    assert flood.poll() is None
    graph.end(flood, signal.SIGTERM)
    node.fly()
    node.wait_for('idle')


@pytest.mark.slow
@pytest.mark.timeout(1200 + TIMEOUTS)
def test_a_client_that_keeps_setting_parameters_does_not_postpone_it(
        graph, tmp_path, record_property):
    path = tmp_path / 'sixteen.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': sixteen_rotors()}}))
    process = graph.start('allocator', '--vehicle', str(path))
    command = graph.publisher(WrenchStamped, 'command/wrench')
    heard = graph.listen(Float64MultiArray, 'command/motor_speed')
    graph.connect('/allocator')
    client = graph.node.create_client(SetParameters, '/allocator/set_parameters')
    graph.spin_until(client.service_is_ready, 'the service')
    changes = SetParameters.Request(parameters=[
        Parameter('rotors.health', value=1.0 - 0.01 * i).to_parameter_msg() for i in range(5)])
    hover, requests, delays = wrench(39.24), [], []

    def answer():
        """Return the place of the last command's answer among the messages; keep setting."""
        waiting = sum(not request.done() for request in requests)
        requests.extend(client.call_async(changes) for _ in range(waiting, 2))
        label = f'stamp {hover.header.stamp.sec}000000000'
        return next((i for i, x in enumerate(heard) if x.layout.dim[1].label == label), None)

    def send():
        hover.header.stamp.sec += 1
        command.publish(hover)

    while len(delays) < max(3, TIMEOUTS // 5):
        for _ in range(3):
            send()
            graph.spin_until(lambda: answer() is not None, 'an answer', repeat=send)
        heard.clear()
        send()
        sent, before = time.monotonic(), stood_still(process.pid)
        graph.spin_until(
            lambda: (i := answer()) is not None and any(map(fallen_back, heard[i:])),
            'the timeout action')
        delays.append(time.monotonic() - sent)
        assert delays[-1] <= (
            0.1 + TICK + CHANGES + STALL + stood_still(process.pid) - before), delays
    assert any(request.done() for request in requests)
    p50, highest = (1e3 * np.percentile(delays, (50, 100))).tolist()
    record_property('while parameters are set: last command to action, p50 [ms]', round(p50))
    record_property('while parameters are set: last command to action, max [ms]', round(highest))


@pytest.mark.parametrize('name', NAMES)
def test_time_out_and_action_can_be_set_while_commands_are_missing(graph, name):
    node = Watched(graph, name, start=host)
    # Before the first command nothing is over.
    node.send(math.nan)
    node.wait_a_while()
    assert {level for level, _, values in node.diagnostics.all(node.name)[1:]} <= {
        DiagnosticStatus.STALE, DiagnosticStatus.WARN}
    assert not any(any(message.data) for message in node.heard)
    node.fly()
    node.wait_for('idle')
    # To hold is to change nothing, be it what another action left.
    for action, left in (('stop', 'stop'), ('hold', 'stop'), ('idle', 'idle'), ('hold', 'idle')):
        assert node.parameters.set_atomically({'timeout_action': action}).successful
        for _ in range(5):
            node.wait_for(left)
    node.wait_for_timeout('hold')
    assert node.parameters.set_atomically({'command_timeout': 1000.0}).successful
    # More patience brings no command back.
    node.wait_a_while()
    assert node.diagnostics.all(node.name)[-1][:2] == (
        DiagnosticStatus.ERROR, 'no command: hold')
    node.wait_for('idle')
    node.fly()
    node.heard.clear()
    node.wait_a_while()
    if node.allocates:
        assert node.heard == []
    else:
        assert {tuple(message.data) for message in node.heard} == {(node.speed,) * 6}
    assert node.parameters.set_atomically(
        {'command_timeout': 2.0 * TIMEOUT, 'timeout_action': 'stop'}).successful
    node.wait_for('stop')
    node.wait_for_timeout('stop')


@pytest.mark.parametrize('name', length(['simulator'], NAMES))
def test_ros_time_that_stands_still_or_jumps_changes_nothing(graph, name):
    node = Watched(graph, name, '-p', 'use_sim_time:=true', start=host)
    clock = graph.publisher(Clock, '/clock')

    def set_clock(seconds):
        clock.publish(Clock(clock=Time(sec=seconds)))

    for seconds in (1000, 10, 2_000_000):
        graph.spin_until(
            lambda seconds=seconds: node.diagnostics.arrays
            and node.diagnostics.arrays[-1].header.stamp == Time(sec=seconds),
            f'ROS time {seconds} s', repeat=lambda seconds=seconds: set_clock(seconds))
        node.fly()
        node.wait_for('idle')
        node.wait_for_timeout('idle')


@pytest.mark.parametrize('name', length(['allocator'], [*NAMES, 'controller', 'fault_proxy']))
def test_what_rclpy_cannot_convert_is_dropped_and_ends_no_node(graph, name):
    vehicle = () if name == 'fault_proxy' else ('--vehicle', 'hexarotor')
    process = graph.start(name, *vehicle, '--ros-args', '-p', 'use_sim_time:=true')
    clock = graph.publisher(Clock, '/clock')
    parameters = graph.connect(f'/{name}')
    client = graph.node.create_client(SetParameters, f'/{name}/set_parameters')
    wrong = ParameterMessage(name='use_sim_time', value=ParameterValue(type=99))
    for _ in range(3):
        clock.publish(Clock(clock=Time(sec=-5)))
        request = client.call_async(SetParameters.Request(parameters=[wrong]))
        graph.spin_until(request.done, 'an answer')
        clock.publish(Clock(clock=Time(sec=5)))
        assert parameters.get('use_sim_time') == [True]
    _, err = graph.end(process, signal.SIGTERM)
    assert process.returncode == 0
    assert 'Clock: Seconds value must not be negative' in err


def test_a_rotor_that_is_lost_while_others_hold_stands_still(graph):
    node = Watched(graph, 'allocator', '-p', 'timeout_action:=hold', start=host)
    node.fly()
    node.wait_for('hold')
    lost = node.speed * np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    for health in ([1.0, 1.0, 1.0, 0.0, 1.0, 1.0], 1.0):
        assert node.parameters.set_atomically({'rotors.health': health}).successful
        # What was heard before may still be on its way.
        graph.spin_until(
            lambda: node.heard and np.allclose(node.heard[-1].data, lost), 'the timeout action')
        node.heard.clear()
        graph.spin_until(lambda: len(node.heard) >= 5, 'the timeout action, again and again')
        for message in node.heard:
            np.testing.assert_allclose(message.data, lost)
    node.fly()


def test_a_command_that_nobody_looked_at_ends_one_pause_and_begins_another():
    watchdog = Watchdog(timeout=0.0)
    pauses = []
    for _ in range(3):
        watchdog.feed()
        while not watchdog.over:
            pass
        pauses += [(watchdog.check(), watchdog.begun) for _ in range(2)]
    assert pauses == [(True, True), (True, False)] * 3


def test_in_lockstep_time_may_stand_still(graph):
    node = Watched(graph, 'allocator', '-p', 'mode:=lockstep', start=host)
    node.fly()
    node.heard.clear()
    node.wait_a_while()
    assert node.heard == []
    assert node.diagnostics.all(node.name)[-1][:2] == (DiagnosticStatus.OK, 'EXACT')
