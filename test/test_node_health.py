"""The health that an allocator obeys, under messages that come close together."""

import time

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray

from ca_ros import Vehicle
from ca_ros.nodes.topics import STANDING
from ca_ros.testing import Diagnostics, wrench
from strategies import length

VEHICLES = length(['hexarotor', 'hexarotor_tilting'],
                  ['hexarotor', 'hexarotor_tilting', 'tricopter', 'hexarotor_gimbals'])
PAIRS = length(12, 60)
APART = 0.001, 0.002, 0.004  # time between two messages [s]
FLOOD = length(1000, 20000)  # messages of a flood
RATE = 2000.0  # at most so many a second [Hz]


class Flown:
    """An allocator that is sent wrenches of hover, and the publisher of its health."""

    def __init__(self, graph, vehicle):
        self.graph, self.sent, self.answers = graph, 0, {}
        self.weight, self.n = Vehicle.load(vehicle).weight, Vehicle.load(vehicle).n
        self.health = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)
        self.process = graph.start('allocator', '--vehicle', vehicle)
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
def test_of_two_messages_the_newer_one_holds_however_close_they_come(graph, vehicle):
    flown, older = Flown(graph, vehicle), []
    for pair in range(PAIRS):
        one, two = pair % flown.n + 1, (pair + 1) % flown.n + 1
        flown.lose(one)
        time.sleep(APART[pair % len(APART)])
        flown.lose(two)
        if not flown.settled(two):
            older.append(pair)
    assert older == []


def test_a_loss_that_comes_while_a_parameter_is_set_holds(graph):
    flown, lost = Flown(graph, 'hexarotor_tilting'), []
    for pair in range(PAIRS):
        rotor = pair % flown.n + 1
        asked = flown.set('allocation.exact.residual_slack', 1e-9 * (pair % 2 + 1))
        time.sleep(APART[pair % len(APART)])
        flown.lose(rotor)
        graph.spin_until(asked.done, 'an answer')
        if not flown.settled(rotor):
            lost.append(pair)
    assert lost == []


@pytest.mark.parametrize('vehicle', VEHICLES)
def test_a_flood_of_health_ends_no_node_and_the_last_message_holds(graph, vehicle):
    flown, sent, asked = Flown(graph, vehicle), 0, []

    def send():
        nonlocal sent
        flown.lose(sent % flown.n + 1)
        sent += 1
        if sent % 50 == 0:
            asked.append(flown.set('rotors.health', 1.0 - 0.001 * (sent % 3)))

    flood = graph.node.create_timer(1.0 / RATE, send)
    graph.spin_until(lambda: sent >= FLOOD, 'a flood')
    flood.cancel()
    flown.lose(2)
    assert flown.settled(2)
    assert flown.process.poll() is None
    assert any(each.done() for each in asked)
