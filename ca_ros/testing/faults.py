"""Faults on the links between nodes: messages lost, delayed, duplicated, reordered, damaged."""

from typing import Any

from ca_ros.nodes.fault_proxy import PREFIX
from ca_ros.process.diagnostics import counts
from ca_ros.testing.graph import Diagnostics, Graph, Parameters


class FaultProxy:
    """The node `fault_proxy` on topics between nodes of the loop, such as ``'command/wrench'``.

    Start the subscribers with the arguments of `remaps`.  The faults are by name, such as
    ``drop=0.1`` or ``delay=0.02``; ``fault_proxy --help`` lists them.
    """

    def __init__(self, graph: Graph, topic: str, *others: str, **faults: Any) -> None:
        self._topics = topic, *others
        self._diagnostics = Diagnostics(graph)
        values = {'topics': f'[{", ".join(self._topics)}]', **faults}
        words = [f'{name}:={value}' for name, value in values.items()]
        graph.start('fault_proxy', '--ros-args', *(w for word in words for w in ('-p', word)))
        self._parameters = Parameters(graph, 'fault_proxy')
        self._parameters.get('seed')

    @property
    def remaps(self) -> list[str]:
        """The ROS arguments with which a node subscribes to the faulty topics."""
        return [word for topic in self._topics for word in ('-r', f'{topic}:={PREFIX}{topic}')]

    def set(self, **faults: Any) -> None:
        """Change faults; those that are not named stay.  Wrong ones raise a ValueError."""
        result = self._parameters.set_atomically(faults)
        if not result.successful:
            raise ValueError(result.reason)

    def counts(self, topic: str) -> dict[str, int]:
        """Return the next counts of a topic: received, passed, dropped and so on."""
        self._diagnostics.arrays.clear()
        subject = f'fault_proxy: {topic}'
        *_, values = self._diagnostics.wait(subject, lambda *_: True, 'counts')
        return counts(values)
