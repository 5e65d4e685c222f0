"""The diagnostics of a node on /diagnostics (REP 107), and faults of the endpoints of streams."""

from collections.abc import Collection, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ca_ros.nodes.topics import COMMAND, DIAGNOSTICS, type_name

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
)

SEVERITY = (OK, STALE, WARN, ERROR)  # from best to worst: faults outrank missing data


class DiagnosticsPublisher:
    """Publishes statuses of a node on /diagnostics, about a vehicle or a link, the hardware."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node, self._hardware_id = node, hardware_id
        self._publisher = node.create_publisher(DIAGNOSTICS.kind, DIAGNOSTICS.name, COMMAND)

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


def faults(
    node: Node, streams: Collection[Subscription], offers: Collection[Publisher]
) -> list[str]:
    """Return what is wrong with the endpoints on a node's topics, one sentence each.

    `streams` should have one publisher each; `offers` should be the only ones on their topics.
    """
    sentences = []
    for stream in streams:
        topic = stream.topic_name
        if (matched := stream.get_publisher_count()) > 1:
            sentences.append(f'{matched} publishers on {topic}')
        for other in node.get_publishers_info_by_topic(topic):
            if fault := mismatch(other, stream, other.qos_profile, stream.qos_profile):
                sentences.append(f'a publisher on {topic} offers another {fault}')
    for publisher in node.publishers:
        topic = publisher.topic_name
        if publisher in offers and (count := node.count_publishers(topic)) > 1:
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
