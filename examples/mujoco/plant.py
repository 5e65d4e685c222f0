#!/usr/bin/env python3
"""A plant in MuJoCo: rotor speeds in, the vehicle's state out, as docs/plant.md describes.

    bringup --plant "python3 examples/mujoco/plant.py" --mode lockstep --vehicle x8

The vehicle comes from the parameter file of the other nodes.  The rotors follow their commands at
once.  Between two states MuJoCo takes one step of RK4, where `simulator` takes one of Euler.
"""

from __future__ import annotations

import signal
import sys

import mujoco
import numpy as np
import rclpy
from model import mjcf
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
from ca_ros.nodes.parameters import SIMULATOR
from ca_ros.nodes.qos import offered, requested
from ca_ros.schema import REQUIRED
from ca_ros.vehicle.parameters import SIMULATED

CHANGEABLE = 'rotors.health', 'simulator.hold_at'
USED = {*SIMULATED, *CHANGEABLE, 'simulator.time_step', 'mode', 'world_frame', 'command_frame'}


class Plant(Node):
    """Steps the vehicle: by the clock in real time, once per answered state in lockstep."""

    def __init__(self) -> None:
        super().__init__('simulator')
        self.parameters = {}
        for name in USED:
            declared = SIMULATOR[name]
            default = None if declared.default is REQUIRED else declared.default
            descriptor = ParameterDescriptor(
                dynamic_typing=True, read_only=name not in CHANGEABLE
            )
            value = self.declare_parameter(name, default, descriptor).value
            if value is not None:
                self.parameters[name] = value
        self.vehicle = Vehicle.from_parameters(self.parameters)
        self.step_ns = round(self.parameters['simulator.time_step'] * 1e9)
        self.model = mujoco.MjModel.from_xml_string(mjcf(self.vehicle, self.step_ns / 1e9))
        self.data = mujoco.MjData(self.model)
        self.speeds, self.resting, self.held = np.zeros(self.vehicle.n), True, False
        mode = self.parameters['mode']
        self.lockstep = mode == 'lockstep'
        self.time = 0 if self.lockstep else self.get_clock().now().nanoseconds
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.now = lambda: steady.now().nanoseconds
        self.due = self.now() + self.step_ns
        self.outputs = self.motor_speed, self.pose, self.velocity = [
            self.create_publisher(topic.kind, topic.name, offered(mode))
            for topic in (topics.SPEEDS, topics.POSE, topics.VELOCITY)
        ]
        command = topics.SPEED_COMMAND
        self.create_subscription(command.kind, command.name, self.receive, requested(mode))
        period = 0.2 if self.lockstep else self.step_ns / 1e9
        self.timer = self.create_timer(period, self.tick, clock=steady)
        self.add_on_set_parameters_callback(self.change)

    def receive(self, command: Float64MultiArray) -> None:
        """Take rotor speeds; in lockstep only those that answer the present state."""
        speeds = np.array(command.data)
        if speeds.shape != (self.vehicle.n,) or not np.isfinite(speeds).all():
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
                # The recorder may lag behind by the depth of the queues, 2000 steps.
                for output in self.outputs:
                    output.wait_for_all_acked(Duration(seconds=2.0))

    def tick(self) -> None:
        """Publish an unanswered state again in lockstep; take the steps that are due otherwise."""
        if self.lockstep:
            self.publish()
        while not self.lockstep and self.due <= self.now():
            self.due += self.step_ns
            self.step()

    def step(self) -> None:
        """Take one step, and publish the state after it."""
        self.motor_speed.publish(messages.speeds_message(self.speeds, self.time))
        if not self.resting:
            self.data.ctrl[:] = self.vehicle.thrusts(self.speeds)
            mujoco.mj_step(self.model, self.data)
        self.time += self.step_ns
        self.publish()

    def publish(self) -> None:
        """Publish the state, unless lockstep is to wait here for a change of parameters."""
        hold = round(self.parameters['simulator.hold_at'] * 1e9)
        self.held = self.lockstep and 0 < hold <= self.time
        if self.held:
            return
        if self.resting:
            self.motor_speed.publish(messages.speeds_message(self.speeds, self.time))
        position, quaternion = self.data.qpos[:3], self.data.qpos[3:]
        inverse, velocity = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(inverse, quaternion)
        mujoco.mju_rotVecQuat(velocity, self.data.qvel[:3], inverse)
        pose, twist = messages.state_messages(
            position,
            np.roll(quaternion, -1),
            velocity,
            self.data.qvel[3:],
            messages.stamp(self.time),
            self.parameters['world_frame'],
            self.parameters['command_frame'],
        )
        self.pose.publish(pose)
        self.velocity.publish(twist)

    def change(self, changes: list[Parameter]) -> SetParametersResult:
        """Take over a new health of the rotors, or a new time to wait at."""
        parameters = {**self.parameters, **{each.name: each.value for each in changes}}
        try:
            self.vehicle = Vehicle.from_parameters(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.parameters = parameters
        if self.held:
            self.publish()
        return SetParametersResult(successful=True)


def main() -> int:
    """Run the node until a signal ends it."""
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Plant()
    except (ValueError, mujoco.FatalError) as error:
        print(f'plant: {error}', file=sys.stderr)
        return 1
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
