"""The streams of a node: topics that should have one publisher."""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from time import monotonic, sleep
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from ca_ros.arrays import Array
from ca_ros.nodes import topics
from ca_ros.nodes.messages import speeds_stamp
from ca_ros.nodes.mode import RealTime
from ca_ros.nodes.rclpy_internals import RMWError
from ca_ros.nodes.topics import Topic, offered, requested
from ca_ros.vehicle.command_bounds import CommandBounds

_Taken = tuple[bytes, dict[str, Any]]  # a serialized message and the information about it
SIZE_MAX = 16384  # largest message of a stream [bytes]: 2000 rotor speeds
STALL_MIN = 0.1  # time in which the process did nothing that counts as a stall [s]

STEADY = Clock(clock_type=ClockType.STEADY_TIME)

TICK = 0.02  # period of the checks of watchdogs and of the timeout action [s]

NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
"""Each event handler costs two microseconds a command; `endpoint_faults` replaces rclpy's."""

SETTLING = 0.05  # time after a stall until the middleware has handed over all that came [s]


class Streams:
    """The publishers and subscriptions of a node's streams, in its mode.

    After a stall, of the process or of its machine, the middleware reads the messages that the
    kernel has kept, the oldest first, and a node that takes the first one answers an old command.
    Where the clock counts, only the newest of them is received.

    `drop` gets a reason and a text for each message that is not received.  While a stream has one
    publisher, `counts` gets the messages that were lost or that newer ones replaced.
    """

    def __init__(
        self, node: Node, mode: RealTime, drop: Callable[[str, str], None], counts: Counter[str]
    ) -> None:
        self._node, self._mode, self._drop, self._counts = node, mode, drop, counts
        self._looked, self._settled = inf, 0.0
        self.subscriptions: list[Subscription] = []
        self.listened: list[Subscription] = []
        self.publishers: list[Publisher] = []

    def note_stall(self) -> None:
        """Notice a stall since the last look; a timer calls this."""
        now = monotonic()
        if now - self._looked > STALL_MIN:
            self._settled = now + SETTLING
        self._looked = now

    def _newest(self, stream: Subscription, taken: _Taken) -> _Taken:
        """Return the newest message of what waits after a stall; otherwise the message taken."""
        # The timer, which notes stalls too, is served after the messages.
        if monotonic() > self._looked + STALL_MIN:
            self.note_stall()
        while monotonic() < self._settled:
            taken = stream.handle.take_message(stream.msg_type, True) or taken
            sleep(0.001)
        return taken

    def publish(self, topic: Topic) -> Publisher:
        """Create the publisher of a topic; it should be the only one."""
        given: Any = topic.kind, topic.name, offered(self._mode.name)
        publisher = self._node.create_publisher(*given, event_callbacks=NO_EVENTS)
        self.publishers.append(publisher)
        return publisher

    def listen(
        self, kind: type[Any], name: str, receive: Callable[[Any], None],
        quality: QoSProfile | None = None,
    ) -> None:
        """Subscribe to a topic that is no stream; by default to its newest messages."""
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        given = kind, name, receive, quality or requested('realtime')
        self.listened.append(self._node.create_subscription(*given, event_callbacks=events))

    def subscribe_commands(
        self, receive: Callable[[Float64MultiArray, Array], None], bounds: CommandBounds
    ) -> None:
        """Subscribe to rotor speeds; if there are servos, to speeds and angles by stamp.

        `receive` gets the message of the speeds, and the command (n + k,); one that is out of
        bounds is dropped.
        """
        parts = topics.needed(topics.COMMAND_PARTS, len(bounds.servos))
        waiting: dict[str, Float64MultiArray] = {}

        def join(own: str, others: Sequence[str], message: Float64MultiArray) -> None:
            if own in waiting:
                self._counts['without the other part'] += 1
                self._node.get_logger().warning(
                    f'{own} without {", ".join(others)} of the same stamp: not used',
                    throttle_duration_sec=1.0)
            waiting[own] = message
            stamp = speeds_stamp(message)
            if all(each in waiting and speeds_stamp(waiting[each]) == stamp for each in others):
                finish(*[waiting.pop(topic.name) for topic in parts])

        def finish(speeds: Float64MultiArray, *angles: Float64MultiArray) -> None:
            self._counts['received'] += 1
            numbers = [each.data for each in (speeds, *angles)]
            if fault := bounds.fault(*numbers):
                self._drop(*fault)
            else:
                receive(speeds, np.concatenate(numbers))

        for topic in parts:
            others = [each.name for each in parts if each is not topic]
            self.subscribe(topic, partial(join, topic.name, others))

    def subscribe(
        self, topic: Topic, receive: Callable[[Any], None],
        read: Callable[[bytes], Any] | None = None,
    ) -> None:
        """Subscribe to a topic that should have one publisher.

        `receive` gets what `read` returns for the bytes of a message; default: the message.
        Messages of more than `SIZE_MAX` bytes are dropped before conversion.
        """
        kind, name = topic.kind, topic.name
        newest = 0

        def take(data: bytes, info: dict[str, Any]) -> None:
            nonlocal newest
            if self._mode.clocked:
                data, info = self._newest(stream, (data, info))
            number = info.get('publication_sequence_number') or 0
            lost = number - newest - 1
            if newest and lost > 0 and stream.get_publisher_count() == 1:
                self._counts[f'lost: {name}'] += lost
            newest = number
            fault = None
            try:
                if len(data) > SIZE_MAX:
                    fault = 'size', f'{len(data)} bytes on {name}: expected up to {SIZE_MAX}'
                else:
                    message = read(data) if read else deserialize_message(data, kind)
            except RMWError:
                fault = 'bytes', f'{len(data)} bytes on {name} are no {kind.__name__}'
            if fault:
                self._counts['received'] += 1
                self._drop(*fault)
            else:
                receive(message)

        def forget(_: object) -> None:
            nonlocal newest
            newest = 0

        events = SubscriptionEventCallbacks(matched=forget, use_default_callbacks=False)
        # rclpy's annotation does not have callbacks that take the information, too.
        given: Any = kind, name, take, requested(self._mode.name)
        stream = self._node.create_subscription(*given, raw=True, event_callbacks=events)
        self.subscriptions.append(stream)
