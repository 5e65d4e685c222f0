"""Rotor speeds to PX4 (ActuatorMotors), and its state or its set-points back.

Direct actuators bypass PX4's position, attitude and rate loops: nothing but your controller
stabilises the vehicle.  With ``bridge.px4_input: setpoints`` the speeds answer PX4's own rate loop
instead, and PX4 stabilises the vehicle.
"""

from functools import partial
from math import inf
from time import monotonic
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray, Header

from ca_ros.nodes import topics
from ca_ros.nodes.bridges.bridge import Bridge
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import speeds_stamp, stamp, state_messages, wrench_message
from ca_ros.nodes.topics import COMMAND
from ca_ros.px4 import frames
from ca_ros.settings import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

FRESH, BEAT = 0.2, 0.1  # age of a command that keeps offboard mode alive, and how often [s]


class Px4Bridge(Bridge):
    """Publishes ActuatorMotors, and OffboardControlMode while commands arrive."""

    def connect(self) -> None:
        from px4_msgs.msg import (
            ActuatorMotors,
            OffboardControlMode,
            VehicleOdometry,
            VehicleThrustSetpoint,
            VehicleTorqueSetpoint,
        )

        self._motors, self._mode, self._last = ActuatorMotors, OffboardControlMode, -inf
        motors = self.create_publisher(ActuatorMotors, 'fmu/in/actuator_motors', COMMAND)
        self.subscribe_stream(topics.SPEED_COMMAND, self.passes(self._convert, motors))
        if self.settings.bridge.px4_input == 'state':
            name = 'fmu/in/offboard_control_mode'
            self._alive = self.create_publisher(OffboardControlMode, name, COMMAND)
            self.create_timer(BEAT, self._beat, clock=self.steady)
            out = self.publish_stream(topics.POSE), self.publish_stream(topics.VELOCITY)
            passes = self.passes(self._state, *out)
            self.listen(VehicleOdometry, 'fmu/out/vehicle_odometry', passes)
        else:
            self._thrust: Any = None
            # As in PX4, each torque is allocated, with the newest thrust.
            name = 'fmu/out/vehicle_thrust_setpoint'
            self.listen(VehicleThrustSetpoint, name, partial(setattr, self, '_thrust'))
            passes = self.passes(self._wrench, self.publish_stream(topics.WRENCH))
            self.listen(VehicleTorqueSetpoint, 'fmu/out/vehicle_torque_setpoint', passes)

    def adopt(self, built: Vehicle) -> None:
        """Use the vehicle; raise a `ParameterError` if PX4 cannot have its rotors."""
        super().adopt(built)
        if built.n > frames.CONTROLS:
            raise ParameterError(f'{built.n} rotors, but PX4 has {frames.CONTROLS} motors at most')
        if (built.speed_min < 0.0).any():
            raise ParameterError('rotors reverse (rotors.speed_min < 0), which is not supported')
        self._units = frames.units(built)

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds // 1000

    def _convert(self, speeds: Float64MultiArray) -> Any:
        options, time = self.settings.bridge, speeds_stamp(speeds)
        found = frames.controls(
            np.array(speeds.data), self.vehicle, self.order, options.px4_output,
            options.px4_thrust_factor,
        )
        if time is not None:
            # Without one it is the timeout action, which must not hold off the fail-safe.
            self._last = monotonic()
        sample = (time or 0) // 1000
        return self._motors(timestamp=self._now(), timestamp_sample=sample, control=found)

    def _beat(self) -> None:
        # PX4 leaves offboard mode by its own fail-safe when this ceases.
        if monotonic() - self._last <= FRESH:
            self._alive.publish(self._mode(timestamp=self._now(), direct_actuator=True))

    def _state(self, odometry: Any) -> Any:
        # The agent has added the difference of the clocks.
        time = stamp(odometry.timestamp_sample * 1000)
        names = self.settings.world_frame, self.settings.command_frame
        return state_messages(*frames.state(odometry), time, *names)

    def _wrench(self, torque: Any) -> Any:
        time = torque.timestamp_sample
        if self._thrust is None or abs(self._thrust.timestamp_sample - time) > frames.APART:
            raise ValueError(f'a torque without a thrust within {frames.APART / 1000:g} ms')
        found = frames.wrench(self._thrust.xyz, torque.xyz, self._units)
        header = Header(stamp=stamp(time * 1000), frame_id=self.settings.command_frame)
        return wrench_message(found, header)


ABOUT = "Pass command/motor_speed on to PX4, and PX4's state or set-points back."
main = partial(run, 'px4_bridge', Px4Bridge, ABOUT)
