"""Quality of service of the nodes' topics."""

from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

LOCKSTEP_DEPTH = 2000
"""In lockstep a recorder may fall behind by this many steps without losing one."""


def offered(mode: str) -> QoSProfile:
    """Return what publishers offer: reliable, so that all match, and only the newest message."""
    depth = LOCKSTEP_DEPTH if mode == 'lockstep' else 1
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=depth
    )


def requested(mode: str) -> QoSProfile:
    """Return what subscribers of streams ask for: the newest message, in lockstep every one."""
    if mode == 'lockstep':
        return offered(mode)
    return QoSProfile(
        reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1
    )


COMMAND = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1
)
"""Of rare commands, such as a waypoint, that must arrive."""
