"""A pilot over ROS 2: commands to PX4, waypoints to the controller, and failures of rotors."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from px4_msgs import msg
from rclpy.qos import DurabilityPolicy, QoSProfile
from sitl import MARK, Sitl
from std_msgs.msg import Float64MultiArray

from ca_ros.px4.bridge import TO_PX4, from_px4
from ca_ros.px4.messages import topic

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

STATUS = msg.VehicleStatus
OFFBOARD, HOLD = STATUS.NAVIGATION_STATE_OFFBOARD, STATUS.NAVIGATION_STATE_AUTO_LOITER
EXTERNAL = range(STATUS.NAVIGATION_STATE_EXTERNAL1, STATUS.NAVIGATION_STATE_MAX)

ARM = msg.VehicleCommand.VEHICLE_CMD_COMPONENT_ARM_DISARM
SET_NAV_STATE = msg.VehicleCommand.VEHICLE_CMD_SET_NAV_STATE


class Pilot:
    """Gives commands to PX4 and waypoints to the controller, over ROS 2.

    `lost` rotors stand still: start px4_bridge with `BROKEN` for that.
    """

    BROKEN = '/fmu/in/actuator_motors:=/broken/actuator_motors'
    """A remapping that leads the motors of px4_bridge through this node."""

    def __init__(self, sitl: Sitl) -> None:
        self._sitl = sitl
        self._node = rclpy.create_node('pilot')
        self.status: Any = None
        self.odometry: Any = None
        self.lost: set[int] = set()
        self._listen('vehicle_status', msg.VehicleStatus, 'status')
        self._listen('vehicle_odometry', msg.VehicleOdometry, 'odometry')
        self.answer: Any = None
        self._listen('vehicle_command_ack', msg.VehicleCommandAck, 'answer')
        self._commands = self._publisher('vehicle_command', msg.VehicleCommand)
        self._motors = self._publisher('actuator_motors', msg.ActuatorMotors)
        self._node.create_subscription(
            msg.ActuatorMotors, '/broken/actuator_motors', self._pass_motors, TO_PX4
        )
        self._waypoints = self._node.create_publisher(PoseStamped, '/command/pose', LATCHED)
        announced = '/rotor_health/announced'
        self._health = self._node.create_publisher(Float64MultiArray, announced, LATCHED)

    def close(self) -> None:
        """End the node."""
        self._node.destroy_node()

    def _listen(self, name: str, kind: Any, attribute: str) -> None:
        def keep(message: Any) -> None:
            setattr(self, attribute, message)

        self._node.create_subscription(kind, topic('out', name, kind), keep, from_px4(1))

    def _publisher(self, name: str, kind: Any) -> Any:
        return self._node.create_publisher(kind, topic('in', name, kind), TO_PX4)

    def _pass_motors(self, message: Any) -> None:
        for rotor in self.lost:
            message.control[rotor - 1] = np.nan
        self._motors.publish(message)

    # Waiting

    def fly(self, seconds: float) -> None:
        """Let simulated time pass [s]."""
        end = time.monotonic() + seconds / self._sitl.speed
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=left)

    def wait(self, what: str, done: Callable[[], bool], limit: float = 60.0) -> None:
        """Wait until something is so; raise a TimeoutError after a limit [s]."""
        end = time.monotonic() + limit / self._sitl.speed
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(f'{what}: not so after {limit:g} s')
            rclpy.spin_once(self._node, timeout_sec=0.05)

    def insist(self, what: str, done: Callable[[], bool], act: Callable[[], None]) -> None:
        """Repeat a command each second until something is so."""
        for _ in range(30):
            act()
            try:
                self.wait(what, done, 1.0)
            except TimeoutError:
                continue
            return
        raise TimeoutError(what)

    # Flying

    @property
    def height(self) -> float:
        """Return the height that PX4 estimates [m]."""
        return -float(self.odometry.position[2])

    @property
    def mode(self) -> int:
        """Return what PX4 calls the external mode of ca_ros; 0: there is none."""
        mask = 0 if self.status is None else int(self.status.valid_nav_states_mask)
        return next((state for state in EXTERNAL if mask >> state & 1), 0)

    def command(self, number: int, *values: float) -> None:
        """Send a command to PX4."""
        message = msg.VehicleCommand(
            command=number, source_system=255, from_external=True
        )
        for i, value in enumerate(values):
            setattr(message, f'param{i + 1}', float(value))
        self._commands.publish(message)

    def mark(self, *values: float) -> None:
        """Write a mark into PX4's log, once or twice."""
        self.answer = None
        self.insist(
            'marked', lambda: self.answer is not None and self.answer.command == MARK,
            lambda: self.command(MARK, *values),
        )

    def select(self, mode: int) -> None:
        """Select a mode of PX4."""
        self.insist(
            f'PX4 in mode {mode}', lambda: self.status.nav_state_user_intention == mode,
            lambda: self.command(SET_NAV_STATE, mode),
        )

    def arm(self) -> None:
        """Arm the motors."""
        self.insist(
            'armed', lambda: self.status.arming_state == STATUS.ARMING_STATE_ARMED,
            lambda: self.command(ARM, 1.0),
        )

    def waypoint(self, x: float, y: float, z: float) -> None:
        """Send a waypoint to the controller, east-north-up [m]."""
        message = PoseStamped()
        message.header.frame_id = 'map'
        position, attitude = message.pose.position, message.pose.orientation
        position.x, position.y, position.z = float(x), float(y), float(z)
        # The heading of SIH at its start, north.
        attitude.z = attitude.w = float(np.sqrt(0.5))
        self._waypoints.publish(message)

    def announce(self, rotors: int, lost: int) -> None:
        """Publish which rotor is lost."""
        health = [float(rotor != lost) for rotor in range(1, rotors + 1)]
        self._health.publish(Float64MultiArray(data=health))
