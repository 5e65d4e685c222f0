"""The cases of test_px4_rules.py once more, through the node that speaks with PX4."""

from functools import partial

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray

import test_px4_rules as cases
from ca_ros.nodes import topics
from ca_ros.nodes.messages import nanoseconds, pose_arrays, speeds_message, twist_arrays
from ca_ros.parameter_files import Px4NodeSettings
from ca_ros.px4.frames import State
from ca_ros.px4.messages import topic
from fake_px4 import MESSAGES, converted
from strategies import file_values

px4 = pytest.importorskip(
    'px4_msgs.msg',
    reason='px4_msgs is not installed: docs/px4.md, "Messages", says how to build it in minutes')

FROM_PX4 = QoSProfile(
    depth=5, reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.TRANSIENT_LOCAL)
TO_PX4 = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


class WiredLoop(cases.Loop):
    """The same loop with DDS between PX4, the bridge and the nodes, in steps.

    Each step ends when all messages have arrived.
    """

    def __init__(self, graph, interface):
        self.graph = graph
        super().__init__(interface)

    def make_rules(self):
        self.bridge = bridge = bridge_of(self.graph, interface=self.interface)
        for timer in bridge.timers:
            # The test calls it, in the time of PX4.
            timer.cancel()
        rules = bridge.rules
        rules._clock = lambda: self.px4.time
        self.counts = dict.fromkeys(('heard', 'sent', 'states', 'restarts', 'commands'), (0, 0))
        rules.receive = self.noted('heard', rules.receive)
        rules.command = self.noted('commands', rules.command)
        for name, kind in ('send', 'sent'), ('pass_state', 'states'), ('pass_restart', 'restarts'):
            setattr(bridge, name, self.announced(kind, getattr(bridge, name)))
        create = self.graph.publisher
        self.to_bridge = {
            name: create(kind, topic('out', name, kind), FROM_PX4)
            for name, kind in rules.heard.items()}
        self.speeds = create(Float64MultiArray, topics.SPEED_COMMAND.name)
        listen = self.graph.node.create_subscription
        ends = [
            listen(kind, topic('in', name, kind), partial(self.arrived, name), TO_PX4)
            for name, kind in rules.sent.items()]
        restart = topics.STATE_RESTART
        ends.append(listen(
            restart.kind, restart.name, self.noted('restarts', self.take_restart), 10))
        for given in topics.POSE, topics.VELOCITY:
            ends.append(listen(given.kind, given.name, self.take_state, 10))
        self.halves = {}
        matched = [each.get_subscription_count for each in (*self.to_bridge.values(), self.speeds)]
        matched += [each.get_publisher_count for each in ends]
        self.graph.spin_until(lambda: all(each() for each in matched), 'both ends')
        return rules

    # Each message is announced where it starts, and noted when it was taken

    def announced(self, kind, function):
        def announce(*given):
            self.count(kind, 1, 0)
            return function(*given)
        return announce

    def noted(self, kind, function):
        def note(*given):
            try:
                return function(*given)
            finally:
                self.count(kind, 0, 1)
        return note

    def count(self, kind, announced, taken):
        before, after = self.counts[kind]
        self.counts[kind] = before + announced, after + taken

    def settle(self):
        self.graph.spin_until(
            lambda: all(there == taken for there, taken in self.counts.values()), 'all messages')

    # What PX4 and the nodes take

    def arrived(self, name, message):
        own = converted(message, MESSAGES)
        self.sent.append((name, own))
        self.px4.receive(name, own)
        self.count('sent', 0, 1)

    def take_restart(self, message):
        self.pass_restart(nanoseconds(message.stamp))

    def take_state(self, message):
        time = nanoseconds(message.header.stamp)
        self.halves.setdefault(time, []).append(message)
        if len(self.halves[time]) == 2:
            both = self.halves.pop(time)
            pose, twist = sorted(both, key=lambda each: hasattr(each, 'twist'))
            self.pass_state(State(*pose_arrays(pose), *twist_arrays(twist)), time)
            self.count('states', 0, 1)

    def command(self, speeds, answers):
        self.count('commands', 1, 0)
        # The stamp 0 is that of a controller that sets none.
        self.speeds.publish(speeds_message(np.asarray(speeds), 0 if answers else None))

    def step(self):
        for name, message in self.px4.step():
            self.count('heard', 1, 0)
            self.to_bridge[name].publish(converted(message, px4))
        self.settle()
        self.rules.tick()
        super().time_out()
        self.settle()


@pytest.fixture(params=['mode', 'offboard'])
def loop(request, graph):
    return WiredLoop(graph, request.param)


globals().update({name: getattr(cases, name) for name in (
    'test_it_hovers_and_px4_does_not_believe_that_it_has_landed',
    'test_without_the_thrust_this_px4_would_disarm_in_the_air',
    'test_the_pilot_takes_over',
    'test_the_controller_is_killed',
    'test_the_allocator_ends',
    'test_the_agent_is_killed_and_comes_back',
    'test_the_pilot_takes_over_while_the_agent_is_away',
    'test_no_state_is_passed_on_while_px4_is_disarmed',
    'test_a_changed_reset_counter_is_a_restart',
)})


def bridge_of(graph, **values):
    from ca_ros.px4.bridge import Px4Bridge

    given = file_values('hexarotor', kind=Px4NodeSettings)
    given |= {f'px4.{name}': value for name, value in values.items()}
    return graph.add_node(Px4Bridge(
        context=graph.context, use_global_arguments=False,
        parameter_overrides=[Parameter(name, value=value) for name, value in given.items()]))


def test_set_points_become_wrenches_and_speeds_motors(graph):
    bridge_of(graph, interface='setpoints', simulation=True)
    wrenches = graph.listen(topics.WRENCH.kind, topics.WRENCH.name)
    motors = graph.listen(px4.ActuatorMotors, 'fmu/in/actuator_motors', TO_PX4)
    thrust = graph.publisher(
        px4.VehicleThrustSetpoint, 'fmu/out/vehicle_thrust_setpoint', FROM_PX4)
    torque = graph.publisher(
        px4.VehicleTorqueSetpoint, 'fmu/out/vehicle_torque_setpoint', FROM_PX4)
    speeds = graph.publisher(Float64MultiArray, topics.SPEED_COMMAND.name)
    down = np.float32([0.0, 0.0, -0.5])

    def send():
        thrust.publish(px4.VehicleThrustSetpoint(timestamp_sample=7000, xyz=down))
        torque.publish(px4.VehicleTorqueSetpoint(timestamp_sample=7000))
        speeds.publish(speeds_message(np.full(6, 200.0), 7_000_000))

    graph.spin_until(lambda: wrenches and motors, 'a wrench and motors', send)
    # Half of six times four newton.
    assert wrenches[0].wrench.force.z == pytest.approx(12.0)
    assert nanoseconds(wrenches[0].header.stamp) == 7_000_000
    assert motors[0].control[:6] == pytest.approx(0.25)


def test_messages_of_another_branch_are_named(graph):
    bridge = bridge_of(graph)
    graph.publisher(px4.VehicleStatus, 'fmu/out/vehicle_status', FROM_PX4)
    text = 'PX4 has /fmu/out/vehicle_status: px4_msgs is not of its branch'
    graph.spin_until(lambda: bridge._other_versions() == text, 'another version')
