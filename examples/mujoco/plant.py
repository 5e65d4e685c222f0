#!/usr/bin/env python3
"""A plant in MuJoCo: rotor speeds in, the vehicle's state out, as docs/plant.md describes.

    ca_ros bringup --plant "python3 examples/mujoco/plant.py" --mode lockstep --vehicle x8

The parameters are those of `simulator`; MuJoCo moves the vehicle, by RK4.
"""

import signal
import sys

import numpy as np
import rclpy
from body import MujocoBody
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from ca_ros import ParameterError, Vehicle
from ca_ros.nodes import messages, topics
from ca_ros.nodes.topics import offered, requested
from ca_ros.parameter_files import SimulatorSettings
from ca_ros.settings import REQUIRED, read, table
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.rigid_body import velocity_in_body
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, POSITION

UNUSED = {
    'command_timeout', 'timeout_action', 'simulator.real_time_factor', 'simulator.publish_clock',
}
DECLARED = {name: each for name, each in table(SimulatorSettings).items() if name not in UNUSED}
FAILURES = 'simulator.failures'

REPEAT = 0.2
"""Time after which an unanswered state is published again in lockstep [s]."""


class MujocoPlant(Node):
    """Steps the vehicle: by the clock in real time, once per answered state in lockstep."""

    def __init__(self) -> None:
        super().__init__('simulator')
        given = {}
        for name, each in DECLARED.items():
            default = None if each.default is REQUIRED else each.default
            default = list(default) if isinstance(default, tuple) else default
            descriptor = ParameterDescriptor(
                description=each.description, dynamic_typing=True, read_only=name != FAILURES
            )
            given[name] = self.declare_parameter(name, default, descriptor).value
        self.settings = settings = read(SimulatorSettings, given)
        vehicle = Vehicle.from_settings(settings.vehicle, settings.rotors)
        body = MujocoBody(body_of(vehicle, settings.simulator))
        self.plant = Plant(body, settings.simulator)
        n, self.step_ns = self.plant.body.vehicle.n, self.plant.time_step_ns
        self.speeds, self.resting = np.zeros(n), True
        mode = self.settings.mode
        self.lockstep = mode == 'lockstep'
        self.time = 0 if self.lockstep else self.get_clock().now().nanoseconds
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.due = self.steady.now().nanoseconds
        self.outputs = self.motor_speed, self.pose, self.velocity = [
            self.create_publisher(topic.kind, topic.name, offered(mode))
            for topic in (topics.SPEEDS, topics.POSE, topics.VELOCITY)
        ]
        command = topics.SPEED_COMMAND
        self.create_subscription(command.kind, command.name, self.receive, requested(mode))
        period = REPEAT if self.lockstep else self.step_ns / 1e9
        self.timer = self.create_timer(
            period, self.publish if self.lockstep else self.catch_up, clock=self.steady
        )
        self.add_on_set_parameters_callback(self.change)

    def change(self, changes: list[Parameter]) -> SetParametersResult:
        """Let other rotors fail, and no others."""
        try:
            for each in (each for each in changes if each.name == FAILURES):
                self.plant.failures = RotorFailures.read(each.value)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def receive(self, command: Float64MultiArray) -> None:
        """Take rotor speeds; in lockstep only those that answer the present state."""
        speeds = np.array(command.data)
        if speeds.shape != self.speeds.shape or not np.isfinite(speeds).all():
            self.get_logger().warning(f'dropped: rotor speeds {speeds}', throttle_duration_sec=1.0)
        elif not self.lockstep:
            # A timeout action does not start the flight.
            if not (self.resting and messages.answers_nothing(command)):
                self.speeds, self.resting = speeds, False
        elif messages.speeds_stamp(command) == self.time:
            self.speeds, self.resting = speeds, False
            self.step()
            self.timer.reset()
            if self.time % (500 * self.step_ns) == 0:
                # Readers may lag behind by the depth of the queues, 2000 steps.
                for output in self.outputs:
                    output.wait_for_all_acked(Duration(seconds=2.0))

    def catch_up(self) -> None:
        """Take the steps that are due in real time."""
        while self.due <= self.steady.now().nanoseconds:
            self.due += self.step_ns
            self.step()

    def step(self) -> None:
        """Take one step, and publish the state after it."""
        if self.resting:
            self.plant.measure()
        else:
            self.publish_speeds()
            try:
                self.plant.step(self.speeds)
            except FloatingPointError as error:
                self.get_logger().error(f'{error}: state held', throttle_duration_sec=1.0)
        self.time += self.step_ns
        self.publish()

    def publish_speeds(self) -> None:
        """Publish the speeds that count from the present state on."""
        self.motor_speed.publish(messages.speeds_message(self.speeds, self.time))

    def publish(self) -> None:
        """Publish the state."""
        if self.resting:
            self.publish_speeds()
        state = self.plant.measured
        pose, twist = messages.state_messages(
            state[POSITION],
            state[ATTITUDE],
            velocity_in_body(state),
            state[ANGULAR_VELOCITY],
            messages.stamp(self.time),
            self.settings.world_frame,
            self.settings.command_frame,
        )
        self.pose.publish(pose)
        self.velocity.publish(twist)


def main() -> int:
    """Run the node until a signal ends it."""
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = MujocoPlant()
    except ValueError as error:
        print(f'plant: {error}', file=sys.stderr)
        return 1
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
