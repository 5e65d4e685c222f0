"""The monitor's Imu: the specific force for its states, and a motion where no state comes."""

from typing import Any

from rclpy.node import Node

from ca_ros.arrays import Array
from ca_ros.detection.force_check import ForceCheck
from ca_ros.detection.inertial import LATE, SpecificForces, Standby, ahead_by
from ca_ros.nodes import messages, topics
from ca_ros.nodes.diagnostics import WARN, Diagnostics, Level
from ca_ros.nodes.mode import RealTime
from ca_ros.vehicle.state import STATE_MAX
from ca_ros.vehicle.vehicle import Vehicle

ALONE = f'states have stopped: {topics.IMU} serves alone'
AHEAD = f'{topics.IMU} {ahead_by(LATE)}; failures may be named later'
UNUSED = 'comes, but is not used: detector.imu_position, its place, is not set'

Sample = tuple[int, Array, tuple[Array, Array], Array]
"""Stamp [ns], attitude (4,), velocity and angular velocity (3,), specific force (3,)."""


class Imu:
    """What `imu` says beside the states, and alone where the clock counts and no state comes.

    `used`: whether there is one, by `detector.imu_position`.
    """

    def __init__(
        self, used: bool, vehicle: Vehicle, mode: RealTime, diagnostics: Diagnostics
    ) -> None:
        self.used, self._mode, self._diagnostics = used, mode, diagnostics
        self._forces, self._standby = SpecificForces(), Standby(vehicle.gravity)
        self._late = self._wrong = False
        self._check = ForceCheck(vehicle)
        self.command = self._check.command

    @property
    def alone(self) -> bool:
        """Whether it is to serve alone."""
        return self._mode.clocked and self._standby.alone

    @property
    def fault(self) -> str:
        """Why it is not used; empty if it is, or there is to be none."""
        fault = self._forces.fault or self._check.fault
        return f'{topics.IMU} is not used: {fault}' if fault else ''

    def hear(self, time: int, attitude: Array, velocity: Array) -> None:
        """Take a state: its stamp [ns], attitude (4,) and velocity (3,) in the body [m/s]."""
        self._standby.hear(attitude, velocity)
        if self.used:
            self._check.state(time, attitude, velocity)

    def lacks(self, time: int) -> bool:
        """Return whether a state [ns] waits for the message of its stamp."""
        return self.used and not self._mode.clocked and self._forces.time != time

    def missing(self) -> str:
        """Return what to say if there is to be one, and none has come, or it is wrong."""
        if self.used and self._forces.time is None:
            return f', no {topics.IMU} either'
        return f' ({self.fault})' if self.fault else ''

    def turns_wrong(self) -> bool:
        """Return whether it has just shown that its specific force is wrong, used until now."""
        before, self._wrong = self._wrong, bool(self._check.fault)
        return self._wrong and not before

    def level(self, stated: bool) -> Level | None:
        """Return what is wrong with it, or with the states; `stated`: whether one has come."""
        if self.fault:
            return WARN, self.fault
        if self.alone and stated:
            return WARN, ALONE
        return (WARN, AHEAD) if self._late else None

    def values(self, node: Node) -> dict[str, object]:
        """Return what the diagnostics say of it; log once if it comes without its place."""
        if self.used:
            return {f'{topics.IMU} ahead of the states [ms]': f'{self._forces.ahead / 1e6:.0f}'}
        if not node.count_publishers(node.resolve_topic_name(topics.IMU)):
            return {}
        node.get_logger().warning(f'{topics.IMU}: {UNUSED}', once=True)
        return {topics.IMU: UNUSED}

    def force(self, start: int | None, end: int) -> Array | None:
        """Return the mean specific force (3,) between two states [ns]; None if it is unknown."""
        if not self.used or start is None:
            return None
        force = self._forces.mean(start, end)
        if fault := self.fault:
            force = None
            self._diagnostics.warn('unused', fault)
        self._diagnostics.counts['states without a specific force'] += force is None
        late, self._late = self._late, self._forces.ahead > LATE
        if self._late and not late and not fault:
            self._diagnostics.warn('late', AHEAD)
        return force

    def take(self, message: Any) -> Sample | None:
        """Take a message; return it with the motion that it carries on, None if it is wrong."""
        time = messages.nanoseconds(message.header.stamp)
        angular_velocity, force = messages.imu_arrays(message)
        if not all((abs(each) <= STATE_MAX).all() for each in (angular_velocity, force)):
            self._diagnostics.drop('imu', f'{topics.IMU}: expected numbers up to {STATE_MAX:g}')
            return None
        self._forces.add(time, force)
        self._check.add(time, force)
        attitude, velocity = self._standby.sense(time, angular_velocity, force)
        return time, attitude, (velocity, angular_velocity), force
