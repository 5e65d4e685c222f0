"""What the nodes of a graph publish on /diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray

from ca_ros.nodes.topics import DIAGNOSTICS
from ca_ros.process.diagnostics import Status, statuses

if TYPE_CHECKING:
    from ca_ros.testing.graph import Graph


class Diagnostics:
    """Records the diagnostics of the nodes of a graph; `arrays` has the messages so far."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self.arrays: list[DiagnosticArray] = graph.listen(DiagnosticArray, DIAGNOSTICS.name)

    def all(self, node: str) -> list[Status]:
        """Return all statuses of a node so far, or of one subject, ``'node: subject'``."""
        return statuses(self.arrays, node)

    def wait(
        self, node: str, condition: Callable[[bytes, str, dict[str, str]], bool], what: str
    ) -> Status:
        """Wait until level, message and values of the newest status of a node fulfil a condition.

        Returns them; `what` describes the condition for the error, see `Graph.spin_until`.
        """

        def fulfilled() -> bool:
            found = self.all(node)
            return bool(found) and condition(*found[-1])

        self._graph.spin_until(fulfilled, f'{node} reports: {what}')
        return self.all(node)[-1]
