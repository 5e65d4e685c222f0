"""What the nodes report on /diagnostics during a flight: timeouts, and faults of the links."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from ca_ros.arguments import full_name
from ca_ros.bringup.link_faults import FAULT_KINDS
from ca_ros.commands import NODES
from ca_ros.nodes.messages import nanoseconds
from ca_ros.nodes.qos import offered
from ca_ros.nodes.topics import DIAGNOSTICS

T = TypeVar('T')


class Reports:
    """The newest values of each status of the nodes in a namespace.

    Parameters
    ----------
    node : Node
        The node that subscribes; the reports are those of the nodes in its namespace.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._newest: dict[str, tuple[int, dict[str, str]]] = {}
        self._faults: dict[str, str] = {}
        # All nodes share the topic, so the queue must hold several messages.
        quality = offered('lockstep')
        node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._receive, quality)

    def timeouts(self) -> Counter[str]:
        """Return the number of timeouts of each node of the loop that had one."""
        counts = {name: self._sum(name, 'timeouts') for name in NODES}
        return Counter({name: count for name, count in counts.items() if count})

    def faults(self) -> Counter[str]:
        """Return how many messages the fault proxy received, and how many had each fault."""
        return Counter(
            {kind: self._sum('fault_proxy', kind) for kind in ('received', *FAULT_KINDS)}
        )

    def missing(self, since: int) -> list[str]:
        """Return the topic if the fault proxy has not reported since a time [ns]."""
        times = [time for time, _ in self._of('fault_proxy', self._newest)]
        return [] if times and min(times) >= since else [DIAGNOSTICS.name]

    def faults_of_nodes(self) -> str:
        """Return what the nodes report other than OK, in brackets; empty if there is nothing."""
        found = [
            f'{name}: {text}' for name in NODES for text in self._of(name, self._faults) if text
        ]
        return f' ({"; ".join(found)})' if found else ''

    def _sum(self, name: str, key: str) -> int:
        return sum(int(values.get(key, 0)) for _, values in self._of(name, self._newest))

    def _of(self, name: str, reports: Mapping[str, T]) -> list[T]:
        start = f'{full_name(self._node.get_namespace(), name).lstrip("/")}: '
        return [each for subject, each in reports.items() if subject.startswith(start)]

    def _receive(self, array: Any) -> None:
        time = nanoseconds(array.header.stamp)
        for status in array.status:
            self._newest[status.name] = time, {pair.key: pair.value for pair in status.values}
            sound = status.level == DiagnosticStatus.OK
            self._faults[status.name] = '' if sound else status.message

