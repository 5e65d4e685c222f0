"""A flight in a bag of ROS 2: messages of the nodes as streams of numbers."""

from collections.abc import Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError

COMMAND, POSE = 'command/motor_speed', 'local_position/pose'
NUMBERS = 'std_msgs/msg/Float64MultiArray'

FIELDS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    COMMAND: (NUMBERS, {'command': 'data'}),
    'motor_speed/measured': (NUMBERS, {'speed': 'data'}),
    POSE: ('geometry_msgs/msg/PoseStamped', {'attitude': 'pose.orientation'}),
    'local_position/velocity_body': (
        'geometry_msgs/msg/TwistStamped', {'velocity': 'twist.linear', 'gyro': 'twist.angular'}),
    'imu': ('sensor_msgs/msg/Imu', {'gyro': 'angular_velocity', 'acc': 'linear_acceleration'}),
}
"""The type of each topic, and its field for each stream; a stream of two is that of the last."""


def streams_of(path: Path) -> dict[str, tuple[Array, Array]]:
    """Return the streams of a bag by name: times (K,) [s] by the stamps, and numbers (K, c).

    `path`: a folder of rosbag2, or one of its files, .mcap or .db3.  Of messages in a row with the
    same stamp the last one counts, since the state at rest is repeated until a flight begins.  A
    command without a stamp has that of the last pose.

    Raises a ParameterError if `rosbags` is missing or the bag has not the commands of one vehicle,
    and any error if it is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ParameterError(
            "a bag needs rosbags: pip install rosbags, or ca_ros's extra 'bag'") from None
    # Bags in SQLite from before Jazzy do not define their types.
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return _streams(reader)


def _streams(reader: Any) -> dict[str, tuple[Array, Array]]:
    # What the fault proxy passes on has a namespace of its own.
    spaces = {
        each.topic.removesuffix(COMMAND) for each in reader.connections
        if each.topic.endswith(f'/{COMMAND}') and not each.topic.endswith(f'/faulty/{COMMAND}')}
    if len(spaces) != 1:
        raise ParameterError(
            f'{COMMAND} in {len(spaces)} namespaces: expected one'
            f'{", not " * bool(spaces)}{", ".join(sorted(spaces))}')
    [space] = spaces
    kinds = {f'{space}{topic}': kind for topic, (kind, _) in FIELDS.items()}
    wanted = [each for each in reader.connections if kinds.get(each.topic) == each.msgtype]
    rows: dict[str, dict[str, tuple[list[int], list[Any]]]] = {topic: {} for topic in FIELDS}
    now = None
    for each, _, raw in reader.messages(wanted):
        topic = each.topic.removeprefix(space)
        message = reader.deserialize(raw, each.msgtype)
        time = _stamp(message, now)
        now = time if topic == POSE else now
        if time is None:
            continue
        for stream, field in FIELDS[topic][1].items():
            times, table = rows[topic].setdefault(stream, ([], []))
            if times and times[-1] == time:
                del times[-1], table[-1]
            times.append(time)
            table.append(_numbers(attrgetter(field)(message)))
    found = {stream: each for streams in rows.values() for stream, each in streams.items()}
    start = min((times[0] for times, _ in found.values()), default=0)
    return {
        stream: ((np.array(times) - start) / 1e9, np.array(table, float))
        for stream, (times, table) in found.items()}


def _stamp(message: Any, last: int | None) -> int | None:
    """Return the stamp of a message [ns]; of rotor speeds without one `last`."""
    if hasattr(message, 'header'):
        return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
    words = [each.label.split() for each in message.layout.dim]
    return next((int(each[1]) for each in words if each[:1] == ['stamp']), last)


def _numbers(field: Any) -> Any:
    """Return the numbers of an array, a vector or a quaternion."""
    axes = [getattr(field, axis) for axis in 'xyzw' if hasattr(field, axis)]
    return axes or field
