"""The diagnostics of a node on /diagnostics (REP 107), and faults of the endpoints of streams."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from math import inf
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ca_ros.nodes.stream import NO_EVENTS, STEADY, TICK, Streams
from ca_ros.nodes.topics import COMMAND, DIAGNOSTICS, type_name

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
)

SEVERITY = (OK, STALE, WARN, ERROR)  # from best to worst: faults outrank missing data

Level = tuple[bytes, str]  # a level with its message


class DiagnosticsPublisher:
    """Publishes statuses of a node on /diagnostics, about a vehicle or a link, the hardware."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node, self._hardware_id = node, hardware_id
        self._publisher = node.create_publisher(
            DIAGNOSTICS.kind, DIAGNOSTICS.name, COMMAND, event_callbacks=NO_EVENTS)

    def publish(self, *statuses: tuple[str, bytes, str, Mapping[str, object]]) -> None:
        """Publish statuses: subject, such as ``allocation``, level, message and values of each."""
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        name = self._node.get_fully_qualified_name().lstrip('/')
        for subject, level, message, values in statuses:
            pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
            about = {'name': f'{name}: {subject}', 'hardware_id': self._hardware_id}
            status = DiagnosticStatus(level=level, message=message, values=pairs, **about)
            array.status.append(status)
        self._publisher.publish(array)


class Diagnostics:
    """What a node says of itself: counts, logs, and a status on /diagnostics.

    `subject`: what it is about, such as ``allocation``.  `counts`: messages, by what became of
    them.
    """

    def __init__(self, node: Node, subject: str, hardware_id: str) -> None:
        self._node, self._subject, self._hardware_id = node, subject, hardware_id
        self.counts: Counter[str] = Counter()
        self._logged: dict[str, float] = {}
        self._notes: list[Level] = []
        self._published: Level | None = None
        self._dropped_before = 0
        self._waits = self._waited = False

    def start(
        self, levels: Callable[[], Iterable[Level]], values: Callable[[], Mapping[str, object]],
        streams: Streams, *chores: Callable[[], None], log: Callable[[], None] = lambda: None,
    ) -> None:
        """Publish /diagnostics once a second and on change; before, each `TICK`, do the chores.

        `log` is called before /diagnostics is published; see `wait`.
        """
        self._levels, self._values, self._streams = levels, values, streams
        self._chores, self._log = (streams.note_stall, *chores), log
        self._looked = monotonic()
        self._publisher = DiagnosticsPublisher(self._node, self._hardware_id)
        self._node.create_timer(TICK, self._tick, clock=STEADY)

    def wait(self) -> None:
        """Say nothing in the next tick: a command may wait that is to obey the news first."""
        self._waits = True

    def drop(self, reason: str, what: str) -> None:
        """Count a message that is not served, and log the reason, rate limited."""
        self.counts[f'dropped: {reason}'] += 1
        self.warn(reason, f'dropped: {what}')

    def warn(self, reason: str, what: str) -> None:
        """Log a warning, at most once a second for each reason."""
        if self.may_log(reason):
            self._node.get_logger().warning(what)

    def may_log(self, reason: str) -> bool:
        """Return True at most once a second for each reason, by the steady clock."""
        now = monotonic()
        if now < self._logged.get(reason, -inf) + 1.0:
            return False
        self._logged[reason] = now
        return True

    def _tick(self) -> None:
        if type(self._node.executor).__name__ == 'EventsExecutor':
            raise RuntimeError(
                f'{self._node.get_name()}: EventsExecutor of rclpy fails where a callback takes '
                'the information about a message, which tells lost ones: use '
                'ca_ros.nodes.executor.Executor or SingleThreadedExecutor'
            )
        now = monotonic()
        for chore in self._chores:
            chore()
        waits, self._waits = self._waits, False
        # News at each tick do not silence the node.
        self._waited = waits and not self._waited
        if self._waited:
            return
        self._log()
        if now >= self._looked + 1.0:
            self._looked = now
            self._look_around()
        elif self._status() != self._published:
            self._publish()

    def _status(self) -> Level:
        """Return the worst level, and all messages, those of the worst level first."""
        levels = [*self._notes, *self._levels()]
        levels.sort(key=lambda each: SEVERITY.index(each[0]), reverse=True)
        return levels[0][0], '; '.join(message for _, message in levels)

    def _publish(self) -> None:
        self._published = self._status()
        self._publisher.publish((self._subject, *self._published, self._values()))

    def _look_around(self) -> None:
        """Report faults of endpoints, and how many messages were dropped since the last look."""
        streams = self._streams
        found = endpoint_faults(self._node, streams)
        notes = [(WARN, fault) for fault in found]
        for note in notes:
            if note not in self._notes:
                self._node.get_logger().warning(note[1])
        dropped = sum(self.counts[key] for key in self.counts if key.startswith('dropped'))
        if dropped > self._dropped_before:
            notes.append((WARN, f'{dropped - self._dropped_before} dropped in a second'))
        self._dropped_before = dropped
        self._notes = notes
        self._publish()


def endpoint_faults(node: Node, streams: Streams) -> list[str]:
    """Return what is wrong with the endpoints on a node's topics, one sentence each.

    Its streams should have one publisher each, and it should be the only one of what it publishes.
    """
    sentences = []
    for stream in (*streams.subscriptions, *streams.listened):
        topic = stream.topic_name
        if stream in streams.subscriptions and (matched := stream.get_publisher_count()) > 1:
            sentences.append(f'{matched} publishers on {topic}')
        for other in node.get_publishers_info_by_topic(topic):
            if fault := mismatch(other, stream, other.qos_profile, stream.qos_profile):
                sentences.append(f'a publisher on {topic} offers another {fault}')
    for publisher in node.publishers:
        topic = publisher.topic_name
        if publisher in streams.publishers and (count := node.count_publishers(topic)) > 1:
            sentences.append(f'{count} publishers on {topic}')
        for other in node.get_subscriptions_info_by_topic(topic):
            if fault := mismatch(other, publisher, publisher.qos_profile, other.qos_profile):
                sentences.append(f'a subscriber to {topic} asks for another {fault}')
    return sentences


def mismatch(
    other: TopicEndpointInfo, own: Publisher | Subscription, offered: QoSProfile,
    requested: QoSProfile,
) -> str | None:
    """Return why a publisher and a subscription cannot match; None if they can.

    The number of matches does not show this, because discovery takes time.
    """
    if other.topic_type != type_name(own.msg_type):
        return f'type: {other.topic_type}'
    compatibility, reason = qos_check_compatible(_explicit(offered), _explicit(requested))
    if compatibility == QoSCompatibility.ERROR:
        return f'quality of service: {reason.removeprefix("ERROR: ").rstrip(";")}'
    return None


def _explicit(profile: QoSProfile) -> QoSProfile:
    """Return the policies that decide about a match; unset durations (zero) become infinite."""
    lease = profile.liveliness_lease_duration
    return QoSProfile(
        depth=1, reliability=profile.reliability, durability=profile.durability,
        deadline=profile.deadline if profile.deadline.nanoseconds else Infinite,
        liveliness=profile.liveliness,
        liveliness_lease_duration=lease if lease.nanoseconds else Infinite,
    )
