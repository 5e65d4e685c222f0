"""The health that an allocator obeys, under messages that come close together, and how soon."""

import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64MultiArray

from ca_ros import Vehicle
from ca_ros.nodes.topics import STANDING
from ca_ros.testing import Diagnostics, wrench
from strategies import LONG, length, sixteen_rotors

SIXTEEN = 'sixteen rotors'

VEHICLES = length(
    ['hexarotor', 'hexarotor_tilting', SIXTEEN],
    ['hexarotor', 'rov', 'hexarotor_tilting', 'tricopter', 'omnidirectional_gimbals', SIXTEEN])
PAIRS = length(12, 60)
APART = 0.001, 0.002, 0.004  # time between two messages [s]
FLOOD = length(0.7, 10.0)  # time of a flood [s]
RATES = length([2000.0], [100.0, 1000.0, 5000.0])  # of the messages of a flood, at most [Hz]

CHANGES = length(6, 30, 200)  # of which that time is measured

LATENCY_MAX = 0.005  # median from a message of health to the first command that obeys it [s]


class Flown:
    """An allocator that is sent wrenches of hover, and the publisher of its health."""

    def __init__(self, graph, folder, vehicle, *words):
        self.graph, self.sent, self.answers = graph, 0, {}
        file = vehicle
        if vehicle == SIXTEEN:
            file = str(folder / 'sixteen.yaml')
            Path(file).write_text(yaml.safe_dump({'/**': {'ros__parameters': sixteen_rotors()}}))
        self.vehicle = Vehicle.load(file)
        self.weight, self.n = self.vehicle.weight, self.vehicle.n
        self.health = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)
        self.process = graph.start('allocator', '--vehicle', file, *words)
        self.parameters = graph.connect('allocator')
        graph.spin_until(self.health.get_subscription_count, 'the health has a reader')
        self.setting = graph.node.create_client(SetParameters, 'allocator/set_parameters')
        asked = []
        # Before the node has discovered the client, an answer may be lost.
        graph.spin_until(
            lambda: any(each.done() for each in asked), 'an answer to the client',
            repeat=lambda: asked.append(self.set('rotors.health', 1.0)))

    def lose(self, *rotors):
        """Publish that these rotors are lost, and no others."""
        health = np.ones(self.n)
        health[np.array(rotors, int) - 1] = 0.0
        self.health.publish(Float64MultiArray(data=health.tolist()))

    def rest(self):
        """Send a wrench; return the rotors that stand still in the newest answer, from 1."""
        self.sent += 1
        message = wrench(self.weight, self.sent * 10**9, 'base_link')
        label = f'stamp {self.sent * 10**9}'
        self.graph.spin_until(
            lambda: self.speeds and self.speeds[-1].layout.dim[1].label == label,
            'an answer', repeat=lambda: self.command.publish(message))
        speeds = np.array(self.speeds[-1].data)
        return (np.flatnonzero(speeds == 0.0) + 1).tolist()

    def set(self, name, value):
        """Ask for a change of a parameter; return the future of the answer."""
        return self.setting.call_async(SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))

    def settled(self, *rotors):
        """Tell whether after all that was sent exactly these rotors are lost."""
        found = []
        for _ in range(5):
            found = self.rest()
            if found == [*rotors]:
                return True
            time.sleep(0.02)
        return False


@pytest.mark.parametrize('vehicle', VEHICLES)
def test_of_two_messages_the_newer_one_holds_however_close_they_come(
        graph, tmp_path, vehicle):
    flown, older = Flown(graph, tmp_path, vehicle), []
    for pair in range(PAIRS):
        one, two = pair % flown.n + 1, (pair + 1) % flown.n + 1
        flown.lose(one)
        time.sleep(APART[pair % len(APART)])
        flown.lose(two)
        if not flown.settled(two):
            older.append(pair)
    assert older == []


def test_a_loss_that_comes_while_a_parameter_is_set_holds(graph, tmp_path):
    flown, lost = Flown(graph, tmp_path, 'hexarotor_tilting'), []
    for pair in range(PAIRS):
        rotor = pair % flown.n + 1
        asked = flown.set('allocation.exact.residual_slack', 1e-9 * (pair % 2 + 1))
        time.sleep(APART[pair % len(APART)])
        flown.lose(rotor)
        graph.spin_until(asked.done, 'an answer')
        if not flown.settled(rotor):
            lost.append(pair)
    assert lost == []


@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('vehicle', VEHICLES)
def test_a_flood_of_health_ends_no_node_and_the_last_message_holds(
        graph, tmp_path, vehicle, rate):
    """Beside changes of parameters, and for one vehicle of the voltage."""
    words = ['--ros-args', '-p', 'rotors.speed_max_per_volt:=25.0', '-p',
             'rotors.battery_voltage:=16.0'] if vehicle == 'hexarotor' else []
    flown, sent, asked = Flown(graph, tmp_path, vehicle, *words), 0, []
    battery = graph.publisher(BatteryState, 'battery')

    def send():
        nonlocal sent
        flown.lose(sent % flown.n + 1)
        battery.publish(BatteryState(voltage=15.0 + sent % 10 / 5.0))
        sent += 1
        if sent % 50 == 0:
            asked.append(flown.set('rotors.health', 1.0 - 0.001 * (sent % 3)))

    flood, end = graph.node.create_timer(1.0 / rate, send), time.monotonic() + FLOOD
    graph.spin_until(lambda: time.monotonic() > end, 'a flood')
    flood.cancel()
    flown.lose(2)
    assert flown.settled(2)
    assert flown.process.poll() is None
    assert any(each.done() for each in asked)
    if words:
        battery.publish(BatteryState(voltage=14.0))
        flown.diagnostics.wait(
            'allocator', lambda *status: status[2].get('voltage in use [V]') == '14',
            'the last voltage')


@pytest.mark.parametrize('vehicle', length(['hexarotor_tilting'], [
    'hexarotor', 'hexarotor_tilted', 'octorotor', 'x8', 'rov', 'hexarotor_tilting', 'tricopter',
    'omnidirectional_gimbals', 'azimuth_boat']))
def test_the_first_command_after_a_message_of_health_obeys_it_soon(
        graph, tmp_path, vehicle, record_property):
    flown, rate = Flown(graph, tmp_path, vehicle), 500.0
    came, sent, delays, periods = [], None, [], []

    def receive(message):
        came.append((time.perf_counter(), np.array(message.data) == 0.0))

    graph.node.create_subscription(Float64MultiArray, 'command/motor_speed', receive, 10)
    stamps = count(1)
    timer = graph.node.create_timer(1.0 / rate, lambda: flown.command.publish(
        wrench(flown.weight, next(stamps) * 10**6, 'base_link')))
    graph.spin_until(lambda: len(came) > 100, 'commands')
    for k in range(CHANGES):
        lost = k % flown.n
        until = time.monotonic() + 0.05
        graph.spin_until(lambda until=until: time.monotonic() > until, 'a while')
        came.clear()
        sent, before = time.perf_counter(), time.monotonic()
        flown.lose(lost + 1)
        graph.spin_until(
            lambda lost=lost: came and came[-1][1][lost], 'a command that obeys')
        assert time.monotonic() - before < 1.0
        delays.append(next(at for at, resting in came if resting[lost]) - sent)
        periods += np.diff([at for at, _ in came]).tolist()
    timer.cancel()
    for name, rank in (('p50', 50), ('p99', 99), ('worst', 100)):
        record_property(f'{vehicle}: from a message of health to the first command that obeys it, '
                        f'{name} [ms]', round(1e3 * float(np.percentile(delays, rank)), 1))
    record_property(f'{vehicle}: longest time between two commands meanwhile [ms]',
                    round(1e3 * float(max(periods, default=0.0)), 1))
    if LONG == 'soak':
        assert np.median(delays) < LATENCY_MAX
