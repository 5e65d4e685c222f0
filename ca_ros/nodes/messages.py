"""Conversion of ROS messages from and to arrays."""

import re
from array import array
from collections.abc import Iterable, Mapping
from struct import Struct
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError

TILT_ANGLE = 'tilt angle [rad]'  # label of the angles of servos
NO_STAMP = 'no stamp'  # label of rotor speeds that answer no command

DIGITS = re.compile('[0-9]{1,19}')
ARM = re.compile('arm ([0-9]{1,4}) ([0-9]{1,4})')
START, RESET = 'start', 'reset'
ORIGIN = re.compile(f'({START}|{RESET}) [0-9]{{1,19}}')
TIME_MAX = 2**31 * 1_000_000_000  # the end of the stamps of ROS [ns]

HEADER, NUMBERS = Struct('<iII'), Struct('<6d')  # stamp, length of the frame; six numbers


class WrenchCommand(NamedTuple):
    """What a WrenchStamped holds: its stamp, its frame, and force before torque [N, N m]."""

    sec: int
    nanosec: int
    frame: str
    wrench: tuple[float, ...]

    @property
    def time(self) -> int:
        """The stamp [ns]."""
        return self.sec * 1_000_000_000 + self.nanosec

    @property
    def header(self) -> Header:
        """The header; its nanoseconds may be more than a second."""
        return Header(stamp=Time(sec=self.sec, nanosec=self.nanosec), frame_id=self.frame)


def stamp(nanoseconds: int) -> Time:
    """Return the message of a time stamp [ns]."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def nanoseconds(time: Time) -> int:
    """Return a time stamp in nanoseconds."""
    return time.sec * 1_000_000_000 + time.nanosec


def speeds_message(
    speeds: Array, time: int | None, label: str = 'rotor speed [rad/s]'
) -> Float64MultiArray:
    """Return rotor speeds (n,) [rad/s] as n rows of one column, labelled with the time [ns].

    The type has no header, so a label carries the stamp: of the command that the speeds answer, or
    of the state from which they take effect.  Speeds that answer no command have no stamp.
    """
    n, message = len(speeds), Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label=label, size=n, stride=n),
        MultiArrayDimension(size=1, stride=1),
    ]
    return fill_speeds(message, speeds, time)


def fill_speeds(message: Float64MultiArray, speeds: Array, time: int | None) -> Float64MultiArray:
    """Refill a `speeds_message`, in a quarter of the time that a new message takes."""
    message.data = array('d', speeds.tobytes())
    message.layout.dim[1].label = NO_STAMP if time is None else f'stamp {time}'
    return message


def health_message(
    health: Array, arms: Iterable[tuple[int, int]], origin: str
) -> Float64MultiArray:
    """Return the health (n,) of rotors, as a `speeds_message` to be filled.

    For each arm of which one rotor has failed, and which one is unknown, the layout has a further
    dimension with a label such as 'arm 1 2': see `Vehicle.with_health`.  The label of the last one
    is the origin: `START` or `RESET` and the time since which the monitor has found this [ns].
    """
    message = speeds_message(health, None, 'rotor health')
    labels = [*(f'arm {i} {j}' for i, j in arms), origin]
    message.layout.dim += [MultiArrayDimension(label=each, size=1, stride=1) for each in labels]
    return message


def failed_arms(message: Float64MultiArray) -> tuple[tuple[int, int], ...]:
    """Return the arms of a `health_message`."""
    found = (ARM.fullmatch(dimension.label) for dimension in message.layout.dim)
    return tuple((int(arm[1]), int(arm[2])) for arm in found if arm)


def origin_of(message: Float64MultiArray) -> str:
    """Return the origin of a `health_message`; empty if it has none."""
    labels = (dimension.label for dimension in message.layout.dim)
    return next(filter(ORIGIN.fullmatch, labels), '')


def speeds_stamp(message: Float64MultiArray) -> int | None:
    """Return the time stamp [ns] of a `speeds_message`; None if it has none.

    A number that no stamp of a header can have is none.
    """
    for dimension in message.layout.dim:
        word, _, number = dimension.label.partition(' ')
        if word == 'stamp' and DIGITS.fullmatch(number) and (time := int(number)) < TIME_MAX:
            return time
    return None


def stamp_of(message: Any) -> int | None:
    """Return the time stamp [ns] of rotor speeds or of a message with a header."""
    if isinstance(message, Float64MultiArray):
        return speeds_stamp(message)
    return nanoseconds(message.header.stamp)


def announcement(health: Array, stuck: Mapping[int, float], time: int | None) -> Float64MultiArray:
    """Return what is announced of the rotors: their health (n,), then the servos that stick.

    `stuck` has by rotor, from 1, the angle [rad]: a pair of numbers for each follows the health.
    `time` is the stamp from which it holds [ns]; None: at once.
    """
    pairs = [float(x) for pair in stuck.items() for x in pair]
    label = 'rotor health, then rotor and angle [rad] of each stuck servo'
    return speeds_message(np.append(health, pairs), time, label)


def read_announcement(
    message: Float64MultiArray, n: int, kind: str = 'rotors'
) -> tuple[Array, dict[int, float]]:
    """Return what an `announcement` says of n rotors or other effectors.

    Raises a ParameterError if it is none.
    """
    numbers = np.array(message.data)
    health, pairs = numbers[:n], numbers[n:]
    whole = all(map(float.is_integer, pairs[::2].tolist()))
    if len(health) < n or len(pairs) % 2 or not whole:
        raise ParameterError(
            f'{numbers}: expected the health of {n} {kind}, then pairs of what sticks, from 1 on, '
            'and where')
    return health, {int(rotor): angle for rotor, angle in pairs.reshape(-1, 2).tolist()}


def answers_nothing(message: Float64MultiArray) -> bool:
    """Return whether a `speeds_message` is a timeout action or a last command."""
    return any(dimension.label == NO_STAMP for dimension in message.layout.dim)


def state_messages(
    position: Array, attitude: Array, velocity: Array, angular_velocity: Array, time: Time,
    world: str, body: str,
) -> tuple[PoseStamped, TwistStamped]:
    """Return a pose in the world frame and a velocity in the body frame."""
    pose = pose_message(position, attitude, Header(stamp=time, frame_id=world))
    twist = TwistStamped(header=Header(stamp=time, frame_id=body))
    v, w = twist.twist.linear, twist.twist.angular
    v.x, v.y, v.z = velocity.tolist()
    w.x, w.y, w.z = angular_velocity.tolist()
    return pose, twist


def pose_message(position: Array, attitude: Array, header: Header) -> PoseStamped:
    """Return a pose: position (3,) [m] and attitude x, y, z, w (4,)."""
    message = PoseStamped(header=header)
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = position.tolist()
    q.x, q.y, q.z, q.w = attitude.tolist()
    return message


def wrong_frame(frame: str, expected: str, parameter: str) -> str | None:
    """Return how a frame differs from a parameter; None if it does not, or one is empty."""
    if frame == expected or not frame or not expected:
        return None
    return f'in {frame!r:.99}: expected {expected} (parameter {parameter})'


def pose_arrays(message: PoseStamped) -> tuple[Array, Array]:
    """Return position (3,) [m] and attitude x, y, z, w (4,)."""
    p, q = message.pose.position, message.pose.orientation
    return np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])


def twist_arrays(message: TwistStamped) -> tuple[Array, Array]:
    """Return velocity (3,) [m/s] and angular velocity (3,) [rad/s]."""
    v, w = message.twist.linear, message.twist.angular
    return np.array([v.x, v.y, v.z]), np.array([w.x, w.y, w.z])


def imu_arrays(message: Any) -> tuple[Array, Array]:
    """Return angular velocity (3,) [rad/s] and specific force (3,) [m/s^2] of an Imu."""
    w, f = message.angular_velocity, message.linear_acceleration
    return np.array([w.x, w.y, w.z]), np.array([f.x, f.y, f.z])


def fill_imu(message: Any, header: Header, angular_velocity: Array, force: Array) -> Any:
    """Refill an Imu with angular velocity (3,) [rad/s] and specific force (3,) [m/s^2]."""
    message.header = header
    w, f = message.angular_velocity, message.linear_acceleration
    w.x, w.y, w.z = angular_velocity.tolist()
    f.x, f.y, f.z = force.tolist()
    return message


def wrench_message(wrench: Array, header: Header) -> WrenchStamped:
    """Return a wrench (6,), force before torque [N, N m]."""
    message = WrenchStamped(header=header)
    f, t = message.wrench.force, message.wrench.torque
    f.x, f.y, f.z, t.x, t.y, t.z = wrench.tolist()
    return message


def wrench_numbers(message: WrenchStamped) -> tuple[float, ...]:
    """Return the six numbers of a wrench, force before torque [N, N m]."""
    f, t = message.wrench.force, message.wrench.torque
    return f.x, f.y, f.z, t.x, t.y, t.z


def read_wrench(data: bytes) -> WrenchCommand:
    """Return what a serialized WrenchStamped holds.

    In little-endian CDR (OMG DDSI-RTPS 2.5, chapter 10) the fields are read from the bytes,
    because rclpy needs 12 us for the message, more than the allocation and all checks together:
    without this the p50 of the node at 1000 Hz rose by 0 to 18 % (three runs on a loaded machine).
    Other bytes are left to rclpy.  Raises a RMWError if the bytes are no WrenchStamped.
    """
    if data[:2] == b'\0\1' and len(data) > 16:
        sec, nanosec, size = HEADER.unpack_from(data, 4)
        end = 16 + size
        # After the four bytes of the encoding, numbers are aligned to their size.
        first = end + (4 - end) % 8
        # The length of the frame includes a zero, which is its only one.
        if len(data) == first + NUMBERS.size and data.find(0, 16) == end - 1:
            frame = str(data[16 : end - 1], 'utf-8', 'replace')
            return WrenchCommand(sec, nanosec, frame, NUMBERS.unpack_from(data, first))
    message = deserialize_message(data, WrenchStamped)
    time, frame = message.header.stamp, message.header.frame_id
    return WrenchCommand(time.sec, time.nanosec, frame, wrench_numbers(message))
