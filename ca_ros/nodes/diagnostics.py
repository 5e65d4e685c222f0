"""The diagnostics of a node on /diagnostics (REP 107)."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ca_ros.nodes.qos import COMMAND
from ca_ros.nodes.topics import DIAGNOSTICS

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)

SEVERITY = (OK, STALE, WARN, ERROR)
"""The levels from best to worst.  The worst is published: faults outrank missing data."""


class DiagnosticsPublisher:
    """Publishes statuses of a node on /diagnostics.

    Parameters
    ----------
    node : Node
    hardware_id : str
        What the statuses are about, such as the name of the vehicle.
    """

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node, self._hardware_id = node, hardware_id
        self._publisher = node.create_publisher(DIAGNOSTICS.kind, DIAGNOSTICS.name, COMMAND)

    def status(
        self, subject: str, level: bytes, message: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        """Return a status of the node: subject, such as ``allocation``, level, message, values."""
        return DiagnosticStatus(
            level=level,
            name=f'{self._node.get_fully_qualified_name().lstrip("/")}: {subject}',
            message=message,
            hardware_id=self._hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )

    def publish(self, *statuses: DiagnosticStatus) -> None:
        """Publish statuses with the present time."""
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
