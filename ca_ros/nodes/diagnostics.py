"""The diagnostics of a node on /diagnostics (REP 107)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

import numpy as np
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

LATENCIES = 5000
"""Number of latest latencies that the percentiles cover."""

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


class StatusPublisher:
    """A status that is published on demand or on change.

    Parameters
    ----------
    node : Node
    subject : str
        What the status describes, such as ``allocation``.
    levels : callable
        Returns levels with their messages, such as ``[(WARN, 'two publishers')]``.  The worst
        level is published, and all messages, those of the worst level first.
    values : callable
        Returns values by name.
    hardware_id : str
        Name of the vehicle.
    """

    def __init__(
        self,
        node: Node,
        subject: str,
        levels: Callable[[], list[tuple[bytes, str]]],
        values: Callable[[], Mapping[str, object]],
        hardware_id: str,
    ) -> None:
        self._subject, self._levels, self._values = subject, levels, values
        self._published: tuple[bytes, str] | None = None
        self._publisher = DiagnosticsPublisher(node, hardware_id)

    def update(self) -> None:
        """Publish if level or message have changed."""
        if self._status() != self._published:
            self.publish()

    def publish(self) -> None:
        """Publish level, message and values."""
        self._published = level, message = self._status()
        self._publisher.publish(
            self._publisher.status(self._subject, level, message, self._values())
        )

    def _status(self) -> tuple[bytes, str]:
        levels = sorted(self._levels(), key=lambda each: -SEVERITY.index(each[0]))
        return levels[0][0], '; '.join(text for _, text in levels)


class Latencies:
    """The last latencies, and their percentiles."""

    def __init__(self) -> None:
        self._nanoseconds: deque[int] = deque(maxlen=LATENCIES)
        self.add = self._nanoseconds.append

    def values(self) -> dict[str, str]:
        """Return median, 99th percentile and maximum by name [us]."""
        if not self._nanoseconds:
            return {}
        p50, p99, highest = np.percentile(np.array(self._nanoseconds), (50, 99, 100)) / 1e3
        return {
            'latency p50 [us]': f'{p50:.0f}',
            'latency p99 [us]': f'{p99:.0f}',
            'latency max [us]': f'{highest:.0f}',
        }
