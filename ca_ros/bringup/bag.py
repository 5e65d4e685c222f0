"""A bag of every message of the vehicle, for ros2 bag, Foxglove and PlotJuggler."""

import shutil
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from ca_ros.errors import CaRosError
from ca_ros.nodes import topics
from ca_ros.nodes.messages import stamp_of
from ca_ros.nodes.topics import ROSOUT, deep, type_name

RECORDED: dict[str, type[Any]] = {topic.path: topic.kind for topic in topics.TOPICS}
"""The recorded topics, beside `imu`; each of the relative ones has one publisher."""

OPTIONAL = {topics.IMU, *(topic.path for topic in topics.TOPICS if topic.optional)}

LOOP = tuple(topic.path for topic in topics.STREAMS)  # one stamped message for each step
STAMPED = (*LOOP, topics.ALLOCATED_WRENCH.path, topics.RESIDUAL.path)  # and results of commands
INFINITE = (9223372036, 854775807)  # RMW_DURATION_INFINITE [s, ns]


class Bag:
    """Writes the messages of `RECORDED` to an MCAP bag of rosbag2, a new folder.

    `counts` are the messages written, by topic, and `lost` those on the vehicle's own topics that
    were sent but not received.  Raises a CaRosError if the folder exists or cannot be created, or
    `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        if find_spec('rosbags') is None:
            raise CaRosError("--bag needs rosbags: pip install rosbags, or ca_ros's extra 'bag'")
        from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
        from rosbags.typesys import Stores, get_typestore

        self._recorded = {**RECORDED, topics.IMU: topics.imu().kind}
        self.path, self.counts, self.lost = path, dict.fromkeys(self._recorded, 0), Counter[str]()
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._node: Node | None = None
        self._subscriptions: dict[str, Any] = {}
        self._connections: dict[str, Any] = {}
        self._sequence: dict[str, int] = {}
        self._newest: dict[str, bytes] = {}
        try:
            # Version 9 is Jazzy's.
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise CaRosError(f'--bag: {error}') from None

    def listen(self, namespace: str) -> None:
        """Subscribe to all topics; `write` takes the messages without an executor."""
        without: Any = {'start_parameter_services': False, 'enable_rosout': False}
        self._node = Node('bag', namespace=namespace, **without)
        for topic, kind in self._recorded.items():
            # The publishers offer the same, apart from the depth.
            qos = deep()
            if topic == ROSOUT.path:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            # Nobody calls it; `print` has no signature in Python 3.10, and rclpy wants one.
            subscription = self._node.create_subscription(
                kind, topic, lambda message: None, qos, raw=True
            )
            self._subscriptions[topic] = subscription
            about: Any = {'typestore': self._types, 'offered_qos_profiles': [_noted(qos)]}
            self._connections[topic] = self._writer.add_connection(
                subscription.topic_name, type_name(kind), **about
            )

    def missing(self) -> list[str]:
        """Return the topics that have no publisher yet, except optional ones."""
        return [
            topic for topic, subscription in self._subscriptions.items()
            if topic not in OPTIONAL and not subscription.get_publisher_count()
        ]

    def write(self) -> None:
        """Write the messages that arrived since the last call, with their times of arrival."""
        for topic, subscription in self._subscriptions.items():
            with subscription.handle:
                # Taking messages here needs a fraction of the time of an executor.
                while taken := subscription.handle.take_message(subscription.msg_type, True):
                    self._put(topic, *taken)

    def _put(self, topic: str, message: bytes, info: dict[str, Any]) -> None:
        try:
            self._writer.write(self._connections[topic], info['received_timestamp'], message)
        except OSError as error:
            raise CaRosError(f'--bag: {self.path}: {error}') from None
        self.counts[topic] += 1
        self._newest[topic] = message
        if not topic.startswith('/'):
            before, number = self._sequence.get(topic), info['publication_sequence_number']
            # A restarted publisher counts from one again.
            if before is not None and number > before:
                self.lost[topic] += number - before - 1
            self._sequence[topic] = number

    def behind(self, time: int) -> list[str]:
        """Return the stamped topics whose newest message is older than a stamp [ns]."""
        return [topic for topic in STAMPED if self._stamp(topic) < time]

    def _stamp(self, topic: str) -> int:
        if topic not in self._newest:
            return -1
        time = stamp_of(deserialize_message(self._newest[topic], RECORDED[topic]))
        return -1 if time is None else time

    def close(self) -> None:
        """Write the last messages and complete the file; remove a bag without messages."""
        try:
            self.write()
            if sum(self.counts.values()):
                self._writer.close()
            else:
                self._writer.abort()
                shutil.rmtree(self.path)
        except OSError as error:
            raise CaRosError(f'--bag: {self.path}: {error}') from None
        finally:
            if self._node is not None:
                self._node.destroy_node()

    def __str__(self) -> str:
        written = sum(map(bool, self.counts.values()))
        lost = [f'{count} LOST of {topic}' for topic, count in self.lost.items() if count]
        return f'{self.path}: {sum(self.counts.values())} messages on {written} topics, ' + (
            ', '.join(lost) or 'none lost')


def _noted(qos: QoSProfile) -> Any:
    """Return a profile in the form of rosbags, which has the numbers of rmw."""
    from rosbags import interfaces as rosbags

    durability = rosbags.QosDurability(qos.durability.value)
    reliability, ever = rosbags.QosReliability(qos.reliability.value), rosbags.QosTime(*INFINITE)
    kept = rosbags.QosHistory(qos.history.value), qos.depth, reliability, durability
    return rosbags.Qos(*kept, ever, ever, rosbags.QosLiveliness.AUTOMATIC, ever, False)
