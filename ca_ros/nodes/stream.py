"""The subscription to a stream, a topic that should have one publisher."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from math import inf
from time import monotonic, sleep
from typing import Any, cast

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from ca_ros.nodes.rclpy_internals import RMWError
from ca_ros.nodes.topics import Topic, requested

_Taken = tuple[bytes, dict[str, Any]]  # a serialized message and the information about it
SIZE_MAX = 16384  # largest message of a stream [bytes]: 2000 rotor speeds
STALL_MIN = 0.1  # time in which the process did nothing that counts as a stall [s]

SETTLING = 0.05  # time after a stall until the middleware has handed over all that came [s]


class Stalls:
    """Notices stalls: the process was stopped, or its machine was.

    After a stall the middleware reads the messages that the kernel has kept, the oldest first, and
    a node that takes the first one answers an old command.
    """

    def __init__(self) -> None:
        self._looked, self._settled = inf, 0.0

    def look(self) -> None:
        """Notice a stall since the last look; a timer calls this."""
        now = monotonic()
        if now - self._looked > STALL_MIN:
            self._settled = now + SETTLING
        self._looked = now

    def newest(self, stream: Subscription, taken: _Taken) -> _Taken:
        """Return the newest message of what waits after a stall; otherwise the message taken."""
        # Before the timer, which comes after the messages.
        if monotonic() > self._looked + STALL_MIN:
            self.look()
        while monotonic() < self._settled:
            taken = stream.handle.take_message(stream.msg_type, True) or taken
            sleep(0.001)
        return taken


def subscribe(
    node: Node, topic: Topic, mode: str, receive: Callable[[Any], None],
    read: Callable[[bytes], Any] | None, drop: Callable[[str, str], None], counts: Counter[str],
    stalls: Stalls,
) -> Subscription:
    """Subscribe to a stream in a mode, 'realtime' or 'lockstep'.

    `receive` gets what `read` returns for the bytes of a message; default: the message.  Messages
    of more than `SIZE_MAX` bytes are dropped before conversion; `drop` gets a reason and a text.
    In real time only the newest of the messages that wait after a stall is received.  While there
    is one publisher, `counts` gets the messages that were lost or that newer ones replaced.
    """
    kind, name = topic.kind, topic.name
    newest = 0

    def take(data: bytes, info: dict[str, Any]) -> None:
        nonlocal newest
        if mode == 'realtime':
            data, info = stalls.newest(stream, (data, info))
        number = info.get('publication_sequence_number') or 0
        lost = number - newest - 1
        if newest and lost > 0 and stream.get_publisher_count() == 1:
            counts[f'lost: {name}'] += lost
        newest = number
        try:
            if len(data) > SIZE_MAX:
                fault = 'size', f'{len(data)} bytes on {name}: expected up to {SIZE_MAX}'
            else:
                fault = None
                message = read(data) if read else deserialize_message(data, kind)
        except RMWError:
            fault = 'bytes', f'{len(data)} bytes on {name} are no {kind.__name__}'
        if fault:
            counts['received'] += 1
            drop(*fault)
        else:
            receive(message)

    def forget(_: object) -> None:
        nonlocal newest
        newest = 0

    stream = node.create_subscription(
        kind,
        name,
        # rclpy's annotation does not have callbacks that take the information, too.
        cast('Callable[[bytes], None]', take),
        requested(mode),
        raw=True,
        event_callbacks=SubscriptionEventCallbacks(matched=forget, use_default_callbacks=False),
    )
    return stream
