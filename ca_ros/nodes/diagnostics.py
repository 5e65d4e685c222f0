"""The diagnostics of a node on /diagnostics (REP 107)."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ca_ros.nodes.topics import COMMAND, DIAGNOSTICS

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
