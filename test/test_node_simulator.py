"""The simulator node, over DDS."""

import math
import signal
import time

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock as ClockBase
from rclpy.clock_type import ClockType
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from std_srvs.srv import Trigger

from ca_ros.nodes import simulator
from ca_ros.nodes.messages import speeds_message
from ca_ros.settings import read
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.testing import Diagnostics, counts
from ca_ros.vehicle.state import NULL_STATE
from nodes import BODY, STEP, SimulatorClient, host, nanoseconds, published, state_array
from strategies import EVERY_EFFECT

REST = published(NULL_STATE)


class HandClock(ClockBase):
    """A steady clock that a test sets [ns]."""

    time = 10**9

    def now(self):
        """Return the time that was set."""
        return Time(nanoseconds=self.time, clock_type=self.clock_type)


def test_with_every_effect_a_reset_repeats_the_flight_to_the_last_bit(graph):
    words = [word for name, value in EVERY_EFFECT.items() for word in ('-p', f'{name}:={value}')]
    client = SimulatorClient(
        graph, 'lockstep', *words, '-p', 'simulator.publish_clock:=true', start=host)
    clock = graph.listen(Clock, '/clock')
    odometry = graph.listen(Odometry, 'local_position/odometry')
    reset = graph.node.create_client(Trigger, 'simulator/reset')
    settings = read(PlantSettings, EVERY_EFFECT, 'simulator.')
    body = body_of(BODY.vehicle, settings)
    for _ in range(2):
        plant, rng = Plant(body, settings), np.random.default_rng(0)
        assert client.state(0).tobytes() == published(plant.measured).tobytes()
        for i in range(30):
            speeds = rng.uniform(200.0, 350.0, 6)
            client.send(speeds, i * STEP)
            plant.step(speeds)
            assert client.state((i + 1) * STEP).tobytes() == published(plant.measured).tobytes()
        graph.spin_until(lambda: odometry and nanoseconds(odometry[-1]) == 30 * STEP, 'odometry')
        times = [each.clock.sec * 10**9 + each.clock.nanosec for each in clock]
        assert {*times} >= {i * STEP for i in range(1, 31)}
        both, pose, velocity = odometry[-1], client.poses[-1], client.velocities[-1]
        assert (both.header, both.pose.pose) == (pose.header, pose.pose)
        assert (both.child_frame_id, both.twist.twist) == ('base_link', velocity.twist)
        assert (pose.header.frame_id, velocity.header.frame_id) == ('map', 'base_link')
        client.poses.clear()
        client.velocities.clear()
        odometry.clear()
        graph.spin_until(reset.service_is_ready, 'the service')
        answer = reset.call_async(Trigger.Request())
        graph.spin_until(answer.done, 'the reset')
        assert answer.result().success


BAD_COMMANDS = [
    [], [255.0] * 5, [255.0] * 7,
    *([255.0, 255.0, fault, 255.0, 255.0, 255.0]
      for fault in (math.nan, math.inf, -math.inf, -1.0, -5e-324)),
]


def test_real_time_rests_until_the_first_command_and_keeps_to_its_grid(graph):
    client = SimulatorClient(graph, 'realtime', start=host)
    for speeds in BAD_COMMANDS:
        client.send(speeds)
    graph.spin_until(lambda: len(client.poses) >= 50 <= len(client.velocities), 'states at rest')
    for pose, velocity in zip(client.poses, client.velocities, strict=False):
        assert state_array(pose, velocity).tobytes() == REST.tobytes()
    client.send([300.0] * 6)
    graph.spin_until(lambda: client.poses[-1].pose.position.z > 0.1, 'a climb')
    grid = nanoseconds(client.poses[0])
    for messages in (client.poses, client.velocities):
        stamps = np.array([nanoseconds(message) for message in messages])
        assert not ((stamps - grid) % STEP).any()
        assert np.all(np.diff(stamps) > 0)
    labels = [message.layout.dim[1].label for message in client.speeds]
    assert not any((int(label.removeprefix('stamp ')) - grid) % STEP for label in labels)
    assert {tuple(message.data) for message in client.speeds} == {(0.0,) * 6, (300.0,) * 6}


@pytest.mark.parametrize('after', [0.0, 0.2, 0.5, 0.9])
def test_each_call_of_the_timer_takes_one_step_from_the_first_command_on(
        graph, monkeypatch, after):
    """The calls are late by up to 0.7 of a period; `after` is when the first command comes."""
    clock = HandClock(clock_type=ClockType.STEADY_TIME)
    monkeypatch.setattr(simulator, 'STEADY', clock)
    node = host(graph, 'simulator', '-p', 'mode:=realtime')
    [timer] = [each for each in node.timers if each.timer_period_ns == STEP]
    [commands] = [each for each in node.subscriptions if each.topic_name.endswith('motor_speed')]
    steps, step = [], node.plant.step
    node.plant.step = lambda command: steps.append(command) or step(command)
    begun, rng = clock.time, np.random.default_rng(0)
    for i in range(1, 60):
        late = round(rng.uniform(0.0, 0.7) * STEP)
        clock.time = begun + i * STEP + late
        timer.callback()
        assert len(steps) == max(0, i - 20)
        if i >= 20:
            clock.time = begun + i * STEP + max(late, round(after * STEP))
            data = serialize_message(speeds_message(np.full(6, 255.0), i))
            commands.callback(data, {})


def test_after_a_stop_the_stamps_agree_with_the_clock_again(graph):
    client = SimulatorClient(graph, 'realtime')
    client.send([300.0] * 6)
    graph.spin_until(lambda: len(client.poses) >= 20, 'states')
    client.process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    client.process.send_signal(signal.SIGCONT)

    def lag():
        """Return how old the newest stamp is [s]."""
        return (time.time_ns() - nanoseconds(client.poses[-1])) / 1e9

    # What was sent before may still be on its way.
    graph.spin_until(lambda: lag() < 0.2, 'a stamp of now', deadline=30.0)
    assert lag() > -0.1
    stamps = [nanoseconds(pose) for pose in client.poses]
    assert np.diff(stamps).min() >= STEP
    assert np.diff(stamps).max() > 1e9
    # The vehicle has not moved in the time that was left out.
    heights = [pose.pose.position.z for pose in client.poses]
    assert np.abs(np.diff(heights)).max() < 0.2


def test_simulated_time_passes_at_the_real_time_factor(graph):
    factor = 0.05
    client = SimulatorClient(
        graph, 'realtime', '-p', f'simulator.real_time_factor:={factor}', start=host)

    def risen():
        """Return the times of the states in the air [ns]."""
        return [nanoseconds(pose) for pose in client.poses if pose.pose.position.z > 0.0]

    start = time.monotonic()
    client.send([300.0] * 6)
    graph.spin_until(lambda: len(risen()) >= 10, 'a climb')
    # Never faster, however late the states are heard of; slower where the machine stands still.
    assert time.monotonic() - start >= 9 * STEP * 1e-9 / factor
    assert set(np.diff(risen())) == {STEP}
    # After a reset the vehicle rests at its start, and the time goes on.
    reset = graph.node.create_client(Trigger, 'simulator/reset')
    graph.spin_until(reset.service_is_ready, 'the service')
    answer, before = reset.call_async(Trigger.Request()), nanoseconds(client.poses[-1])
    graph.spin_until(answer.done, 'the reset')
    client.poses.clear()
    graph.spin_until(lambda: len(client.poses) >= 3, 'states')
    assert {pose.pose.position.z for pose in client.poses} == {0.0}
    assert nanoseconds(client.poses[0]) >= before
    client.send([300.0] * 6)
    graph.spin_until(risen, 'another climb')


def test_a_vehicle_at_rest_is_not_set_going_by_a_timeout_action(graph):
    # As an allocator sends it that has outlived the simulator before this one.
    diagnostics = Diagnostics(graph)
    client = SimulatorClient(graph, 'realtime', '-p', 'simulator.velocity_noise:=0.1', start=host)
    idle = Float64MultiArray(data=[40.0] * 6)
    idle.layout.dim = [MultiArrayDimension(label='no stamp')]
    for _ in range(5):
        client.command.publish(idle)
    diagnostics.wait(
        '/simulator', lambda *now: counts(now[2])['dropped: rest'] > 0, 'what it has heard')
    client.poses.clear()
    graph.spin_until(lambda: len(client.poses) >= 20, 'poses')
    assert {pose.pose.position.z for pose in client.poses} == {0.0}
    # Each state has noise of its own.
    heard = [message.twist.linear.z for message in client.velocities]
    assert len({*heard}) == len(heard) > 1
    graph.spin_until(
        lambda: client.poses[-1].pose.position.z > 0.0, 'a flight',
        repeat=lambda: client.send([300.0] * 6))
    # In flight it is followed.
    client.speeds.clear()
    graph.spin_until(
        lambda: client.speeds and client.speeds[-1].data.tolist() == [40.0] * 6, 'idle',
        repeat=lambda: client.command.publish(idle))


def test_rotors_fail_at_times_of_the_flight_and_as_they_are_set_in_flight(graph):
    given = "simulator.failures:=['1@0.02', '2@0.03=0.4']"
    client = SimulatorClient(graph, 'lockstep', '-p', given, start=host)
    parameters = graph.connect('simulator')
    speeds, expected = np.full(6, 250.0), NULL_STATE

    def step(stamp, *health):
        nonlocal expected
        client.send(speeds, stamp)
        vehicle = BODY.vehicle.with_health([*health, *[1.0] * (6 - len(health))])
        expected = RigidBody(vehicle).step(expected, speeds, STEP / 1e9)
        assert client.state(stamp + STEP).tobytes() == published(expected).tobytes()

    client.state(0)
    for k, health in enumerate([(1.0,), (1.0,), (0.0,), (0.0, 0.4)]):
        step(k * STEP, *health)
    for wrong, words in (('7@1', '7@1: the vehicle has 6 rotors'), ('1', 'expected ROTOR@TIME'),
                         ('1@1=0.4rad', 'no rotor of this vehicle tilts')):
        (result,) = parameters.set({'simulator.failures': wrong})
        assert not result.successful
        assert result.reason.startswith('simulator.failures: ')
        assert words in result.reason
    # All that is set holds, and nothing else; what is due already fails at once.
    (result,) = parameters.set({'simulator.failures': ['3@0', '1@0.06']})
    assert result.successful, result.reason
    for k, health in ((4, (1.0, 1.0, 0.0)), (5, (1.0, 1.0, 0.0)), (6, (0.0, 1.0, 0.0))):
        step(k * STEP, *health)
    # The health is that of the start.
    (result,) = parameters.set({'rotors.health': 0.5})
    assert not result.successful


def test_three_nodes_fly_in_frames_of_other_names(graph):
    frames = '-p', 'command_frame:=uav1/base_link', '-p', 'world_frame:=odom'
    for name in ('simulator', 'controller', 'allocator'):
        host(graph, name, '-r', '__ns:=/uav1', '-p', 'mode:=lockstep', *frames)
    waypoint = graph.publisher(PoseStamped, '/uav1/command/pose')
    poses = graph.listen(PoseStamped, '/uav1/local_position/pose')
    velocities = graph.listen(TwistStamped, '/uav1/local_position/velocity_body')
    wrenches = graph.listen(WrenchStamped, '/uav1/command/wrench')
    for name in ('simulator', 'controller', 'allocator'):
        graph.connect(f'/uav1/{name}')
    message = PoseStamped()
    message.header.frame_id = 'odom'
    message.pose.position.z = message.pose.orientation.w = 1.0
    graph.spin_until(
        lambda: poses and nanoseconds(poses[-1]) >= 20 * STEP, 'steps',
        repeat=lambda: waypoint.publish(message))
    assert {pose.header.frame_id for pose in poses} == {'odom'}
    for messages in (velocities, wrenches):
        assert {message.header.frame_id for message in messages} == {'uav1/base_link'}
