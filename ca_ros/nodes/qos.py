"""Quality of service of the nodes' topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LOCKSTEP_DEPTH = 2000  # steps that a recorder may lag behind in lockstep without a loss


def offered(mode: str) -> QoSProfile:
    """Return the QoS of publishers: reliable, which any subscriber matches, and depth 1."""
    return QoSProfile(depth=LOCKSTEP_DEPTH if mode == 'lockstep' else 1)


def requested(mode: str) -> QoSProfile:
    """Return the QoS of subscribers of streams: the newest message, in lockstep each one."""
    if mode == 'lockstep':
        return offered(mode)
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


COMMAND = QoSProfile(depth=1)  # of rare messages that must arrive, such as waypoints

STANDING = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of messages that later subscribers get, too, if they ask for it.

A subscription that asks for it does not match publishers that do not offer it, such as that of
``ros2 topic pub``.
"""
