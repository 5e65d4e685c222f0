"""What nodes publish on /diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ca_ros.nodes.messages import nanoseconds
from ca_ros.nodes.qos import offered
from ca_ros.nodes.topics import DIAGNOSTICS


class Status(NamedTuple):
    """A diagnostic status of a node."""

    level: bytes
    message: str
    values: dict[str, str]


def statuses(arrays: Iterable[DiagnosticArray], node: str) -> list[Status]:
    """Return all statuses of a node in messages, or those of one subject, ``'node: subject'``."""
    return [
        Status(status.level, status.message, {pair.key: pair.value for pair in status.values})
        for array in arrays for status in array.status
        if f'{status.name}: '.startswith(f'{node.lstrip("/")}: ')
    ]


def counts(values: Mapping[str, str]) -> Counter[str]:
    """Return the values of a status that are counts; a count that is absent is zero."""
    return Counter(
        {key: int(value) for key, value in values.items() if value.isdigit() and '[' not in key}
    )


class DiagnosticsReader:
    """Keeps the newest message of each status; `node` is the node that subscribes."""

    def __init__(self, node: Node) -> None:
        self._newest: dict[str, DiagnosticArray] = {}
        # All nodes share the topic, so the queue must hold several messages.
        quality = offered('lockstep')
        node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._receive, quality)

    def statuses(self, node: str, since: int = 0) -> list[Status]:
        """Return the newest statuses of a node, one a subject, unless older than a time [ns]."""
        return statuses(
            (array for array in self._newest.values() if nanoseconds(array.header.stamp) >= since),
            node,
        )

    def _receive(self, array: DiagnosticArray) -> None:
        for status in array.status:
            self._newest[status.name] = DiagnosticArray(header=array.header, status=[status])
