"""Faults of the endpoints of streams: surplus publishers, and types and QoS that cannot match."""

from collections.abc import Collection

from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ca_ros.nodes.topics import type_name


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
