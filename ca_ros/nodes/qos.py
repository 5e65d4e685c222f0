"""Quality of service of the nodes' topics."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

LOCKSTEP_DEPTH = 2000
"""Number of steps that a recorder may lag behind in lockstep without losing messages."""


def offered(mode: str) -> QoSProfile:
    """Return the QoS of publishers: reliable, which any subscriber matches, and depth 1."""
    depth = LOCKSTEP_DEPTH if mode == 'lockstep' else 1
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=depth
    )


def requested(mode: str) -> QoSProfile:
    """Return the QoS of subscribers of streams: the newest message, in lockstep each one."""
    if mode == 'lockstep':
        return offered(mode)
    return QoSProfile(
        reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1
    )


COMMAND = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1
)
"""QoS of rare messages that must arrive, such as waypoints and diagnostics."""

STANDING = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
)
"""QoS of messages that later subscribers get, too, if they ask for it.

A subscription that asks for it does not match publishers that do not offer it, such as that of
``ros2 topic pub``.
"""
