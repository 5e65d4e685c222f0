"""What nodes publish on /diagnostics."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ca_ros.arguments import full_name
from ca_ros.nodes.detector_words import FOUND, WITHHELD
from ca_ros.nodes.diagnostics import OK
from ca_ros.nodes.link_faults import FAULT_KINDS
from ca_ros.nodes.messages import nanoseconds
from ca_ros.nodes.topics import DIAGNOSTICS, deep
from ca_ros_cli import NODES

LEAST = re.compile('least (?P<axis>.+) served limited by')
"""The name of a value of `ca_ros.nodes.cuts.Cuts`."""


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


class Reports:
    """The newest status of each subject of the nodes in the namespace of a node."""

    def __init__(self, node: Node) -> None:
        self._newest: dict[str, DiagnosticArray] = {}
        # All nodes share the topic, so the queue must hold several messages.
        quality = deep()
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

    def withheld(self) -> list[int]:
        """Return the rotors, from 1, whose failures the monitor has named, but not to act on."""
        return [
            int(rotor) for status in self._of('monitor')
            for rotor in re.findall(r'\d+', status.values.get(WITHHELD, ''))]

    def limits(self) -> dict[str, str]:
        """Return what limited each axis of which less than all was served, when it was least.

        Of the controller and the allocator the one counts that served less.
        """
        found: dict[str, tuple[float, str]] = {}
        for status in (*self._of('controller'), *self._of('allocator')):
            for key, why in status.values.items():
                if match := LEAST.fullmatch(key):
                    share = float(status.values[f'least {match["axis"]} served [%]'])
                    if share < found.get(match['axis'], (100.0,))[0]:
                        found[match['axis']] = share, why
        return {axis: why for axis, (_, why) in found.items()}

    def link_faults(self) -> Counter[str]:
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
