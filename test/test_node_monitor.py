"""The monitor over DDS, and the nodes that heed it."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger

from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.dynamic.ros_flight import fly_over_ros
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.rotor_failures import RotorFailure, RotorFailures
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.messages import speeds_message, stamp
from ca_ros.nodes.topics import STANDING
from ca_ros.testing import Diagnostics, wrench

HOVER = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)


SERVOS = [
    f'{part}.{name}' for part in ('simulator', 'detector')
    for name in ('motor_time_constant:=0.02', 'servo_time_constant:=0.03', 'servo_rate:=6.0')
]


@pytest.mark.slow
@pytest.mark.parametrize(('vehicle', 'changes', 'failure'), [
    pytest.param('hexarotor_realistic', [], '2@0.5', marks=pytest.mark.long),
    pytest.param('hexarotor_tilting', SERVOS, '2@0.5', marks=pytest.mark.long),
    ('hexarotor_tilting', SERVOS, '2@0.5=0.6rad'),
])
def test_a_flight_in_lockstep_is_the_one_offline_to_the_last_bit(vehicle, changes, failure):
    case = Case.load(vehicle, changes)
    failures = RotorFailures((RotorFailure.parse(failure),), None)
    detection = case.detection('exact')
    offline = fly(
        case.controller(), case.allocator('exact'), case.plant(), Waypoint.of(1, 1, 1, np.pi / 4),
        0.8, changes=case.failing('exact', failures), detection=detection)
    words = ['--fail', failure, '--announce', 'never', '--detect']
    flown = fly_over_ros(case, 'exact', 0.8, words)
    assert 0.5 < detection.found[0][0] / 1e9 < 0.6
    assert detection.detector.health.tolist() == [1.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    for name in ('position', 'attitude', 'velocity', 'angular_velocity', 'speeds', 'angles'):
        np.testing.assert_array_equal(getattr(flown, name), getattr(offline, name))


def health_message(*health):
    return Float64MultiArray(data=[float(share) for share in health])


class Allocator:
    """An allocator, and a publisher in place of the monitor."""

    def __init__(self, graph):
        self.graph, self.sent = graph, 0
        self.health = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)

    def start(self):
        process = self.graph.start('allocator', '--vehicle', 'hexarotor')
        self.parameters = self.graph.connect('allocator')
        return process

    def commands(self, condition, what):
        """Send the wrench of hover until the speeds that answer it meet a condition."""

        def met():
            self.sent += 1
            self.command.publish(wrench(HOVER, self.sent * 10**9, 'base_link'))
            return self.speeds and condition(np.array(self.speeds[-1].data))

        self.graph.spin_until(met, what)


def test_a_reset_gives_back_what_was_found_but_not_what_is_announced(graph):
    monitor = graph.start('monitor', '--vehicle', 'hexarotor')
    parameters = graph.connect('monitor')
    reports = graph.listen(Float64MultiArray, 'rotor_health', STANDING)
    pose = graph.publisher(PoseStamped, 'local_position/pose')
    velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
    command = graph.publisher(Float64MultiArray, 'command/motor_speed')
    measured = graph.publisher(Float64MultiArray, 'motor_speed/measured')
    sent = 0

    def flies(condition):
        def met():
            nonlocal sent
            sent += 1
            time = sent * 10_000_000
            header = Header(stamp=stamp(time))
            pose.publish(PoseStamped(header=header))
            velocity.publish(TwistStamped(header=header))
            command.publish(speeds_message(np.full(6, 250.0), time))
            measured.publish(speeds_message(250.0 * np.array([1, 0, 1, 1, 1, 1]), time))
            return bool(reports) and condition(list(reports[-1].data))
        return met

    graph.spin_until(flies(lambda health: health == [1, 0, 1, 1, 1, 1]), 'rotor 2 is lost')
    parameters.set({'rotors.health': [1.0, 1.0, 1.0, 1.0, 0.5, 1.0]})
    graph.spin_until(lambda: list(reports[-1].data) == [1, 0, 1, 1, 0.5, 1], 'both are known')
    client = graph.node.create_client(Trigger, 'monitor/reset')
    assert client.wait_for_service(10.0)
    answer = client.call_async(Trigger.Request())
    graph.spin_until(answer.done, 'reset')
    assert answer.result().success
    graph.spin_until(lambda: list(reports[-1].data) == [1, 1, 1, 1, 0.5, 1], 'as announced')
    assert monitor.poll() is None


def lost(*rotors):
    return lambda speeds: (np.flatnonzero(speeds == 0.0) + 1).tolist() == [*rotors]


def test_the_allocator_uses_the_least_health_and_knows_it_after_a_restart(graph):
    allocator = Allocator(graph)
    process = allocator.start()
    allocator.commands(lost(), 'six rotors turn')
    allocator.health.publish(health_message(1, 0, 1, 1, 1, 1))
    allocator.commands(lost(2), 'rotor 2 is lost')
    # Nonsense is refused, and what was sound before holds.
    def refused(count):
        return lambda *status: status[2].get('refused health') == str(count)

    for i, nonsense in enumerate(([1, 1], [1, 2, 1, 1, 1, 1], [1, np.nan, 1, 1, 1, 1])):
        allocator.health.publish(health_message(*nonsense))
        allocator.diagnostics.wait('allocator', refused(i + 1), 'refused')
    allocator.commands(lost(2), 'rotor 2 is still lost')
    # The parameter does not give it back.
    allocator.parameters.set({'rotors.health': [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]})
    allocator.commands(lost(1, 2), 'rotors 1 and 2 are lost')
    allocator.health.publish(health_message(1, 1, 1, 1, 1, 1))
    allocator.commands(lost(1), 'rotor 1 is lost, which the parameter says')
    allocator.health.publish(health_message(1, 1, 0, 1, 1, 1))
    allocator.commands(lost(1, 3), 'rotor 3 is lost')
    process.terminate()
    graph.outlive(process)
    allocator.speeds.clear()
    graph.start('allocator', '--vehicle', 'hexarotor')
    allocator.commands(lost(3), 'a new allocator knows of rotor 3')
    graph.node.destroy_publisher(allocator.health)

    def warned(level, message, _):
        return level > b'\0' and 'the monitor has ended: its last rotor_health holds' in message

    allocator.diagnostics.wait('allocator', warned, 'a warning that the monitor has ended')
    allocator.commands(lost(3), 'rotor 3 is still lost')
