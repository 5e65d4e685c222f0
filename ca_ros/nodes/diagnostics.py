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


class Diagnostics:
    """A status that is published on demand or on change.

    Parameters
    ----------
    node : Node
    subject : str
        What the status describes, such as ``allocation``.
    levels : callable
        Returns levels with their messages, such as ``[(WARN, 'two publishers')]``.  The worst
        level is published with its messages.
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
        self._node, self._levels, self._values = node, levels, values
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: {subject}'
        self._hardware_id = hardware_id
        self._published: tuple[bytes, str] | None = None
        self._publisher = node.create_publisher(DIAGNOSTICS.kind, DIAGNOSTICS.name, COMMAND)

    def update(self) -> None:
        """Publish if level or message have changed."""
        if self._status() != self._published:
            self.publish()

    def publish(self) -> None:
        """Publish level, message and values."""
        self._published = level, message = self._status()
        status = DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=self._hardware_id
        )
        status.values = [
            KeyValue(key=key, value=str(value)) for key, value in self._values().items()
        ]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _status(self) -> tuple[bytes, str]:
        levels = self._levels()
        worst = max((level for level, _ in levels), key=SEVERITY.index)
        return worst, '; '.join(text for level, text in levels if level == worst)


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
