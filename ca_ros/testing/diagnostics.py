"""What the nodes of a graph publish on /diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray

from ca_ros.nodes.topics import DIAGNOSTICS

if TYPE_CHECKING:
    from ca_ros.testing.graph import Graph


class Status(NamedTuple):
    """A diagnostic status of a node."""

    level: bytes
    message: str
    values: dict[str, str]


class Diagnostics:
    """Records the diagnostics of the nodes of a graph; `arrays` has the messages so far."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self.arrays: list[DiagnosticArray] = graph.listen(DiagnosticArray, DIAGNOSTICS.name)

    def all(self, node: str) -> list[Status]:
        """Return all statuses of a node so far, or of one subject, ``'node: subject'``."""
        return [
            Status(status.level, status.message, {pair.key: pair.value for pair in status.values})
            for array in self.arrays
            for status in array.status
            if f'{status.name}: '.startswith(f'{node.lstrip("/")}: ')
        ]

    def wait(
        self, node: str, condition: Callable[[bytes, str, dict[str, str]], bool], what: str
    ) -> Status:
        """Wait until level, message and values of the newest status of a node fulfil a condition.

        Returns them; `what` describes the condition for the error, see `Graph.spin_until`.
        """

        def fulfilled() -> bool:
            statuses = self.all(node)
            return bool(statuses) and condition(*statuses[-1])

        self._graph.spin_until(fulfilled, f'{node} reports: {what}')
        return self.all(node)[-1]


def counts(values: Mapping[str, str]) -> Counter[str]:
    """Return the values of a status that are counts; a count that is absent is zero."""
    return Counter(
        {key: int(value) for key, value in values.items() if value.isdigit() and '[' not in key}
    )
