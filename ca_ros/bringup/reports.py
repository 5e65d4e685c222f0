"""What the nodes report on /diagnostics during a flight: timeouts, and faults of the links."""

from collections import Counter

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ca_ros.arguments import full_name
from ca_ros.nodes.diagnostics import OK
from ca_ros.nodes.link_faults import FAULT_KINDS
from ca_ros.nodes.messages import nanoseconds
from ca_ros.nodes.monitor import FOUND
from ca_ros.nodes.topics import DIAGNOSTICS, offered
from ca_ros.process.diagnostics import Status, counts, statuses
from ca_ros_cli import NODES


class Reports:
    """The newest status of each subject of the nodes in the namespace of a node."""

    def __init__(self, node: Node) -> None:
        self._newest: dict[str, DiagnosticArray] = {}
        # All nodes share the topic, so the queue must hold several messages.
        quality = offered('lockstep')
        node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._receive, quality)
        self._namespace = node.get_namespace()

    def timeouts(self) -> Counter[str]:
        """Return the number of timeouts of each node of the loop that had one."""
        return +Counter({name: self._sum(name)['timeouts'] for name in NODES})

    def detected(self) -> dict[int, int]:
        """Return the stamps [ns] at which the monitor found failures, by rotor, from 1."""
        return {
            int(key.removeprefix(FOUND).partition(' ')[0]): int(value)
            for status in self._of('monitor') for key, value in status.values.items()
            if key.startswith(FOUND)
        }

    def faults(self) -> Counter[str]:
        """Return how many messages the fault proxy received, and had each fault."""
        total = self._sum('fault_proxy')
        return +Counter({kind: total[kind] for kind in ('received', *FAULT_KINDS)})

    def missing(self, nodes: list[str], since: int) -> list[str]:
        """Return the topic if a status of one of the nodes is older than a time [ns]."""
        counts = ((len(self._of(name)), len(self._of(name, since))) for name in nodes)
        return [] if all(0 < newest == fresh for newest, fresh in counts) else [DIAGNOSTICS.name]

    def faults_of_nodes(self) -> str:
        """Return what the nodes report other than OK, in brackets; empty if there is nothing."""
        reports = ((name, status) for name in NODES for status in self._of(name))
        found = [f'{name}: {status.message}' for name, status in reports if status.level != OK]
        return f' ({"; ".join(found)})' if found else ''

    def _sum(self, name: str) -> Counter[str]:
        return sum((counts(status.values) for status in self._of(name)), Counter[str]())

    def _of(self, name: str, since: int = 0) -> list[Status]:
        """Return the newest statuses of a node, one a subject, unless older than a time [ns]."""
        newest = self._newest.values()
        fresh = (array for array in newest if nanoseconds(array.header.stamp) >= since)
        return statuses(fresh, full_name(self._namespace, name))

    def _receive(self, array: DiagnosticArray) -> None:
        for status in array.status:
            self._newest[status.name] = DiagnosticArray(header=array.header, status=[status])
