"""A ROS graph of a test: processes and nodes, their parameters, and their diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import cached_property
from re import sub
from typing import Any, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ca_ros.nodes.topics import DIAGNOSTICS
from ca_ros.process.diagnostics import Status, statuses
from ca_ros.process.parameters import Call, ParameterClient
from ca_ros.process.processes import Deadline
from ca_ros.testing.processes import DEADLINE, GraphProcesses

Answer = TypeVar('Answer')

FIRST_PAUSE, LAST_PAUSE = 0.25, 2.0  # between repetitions of what may have been lost [s]
LETTING_GO_MAX = 0.3  # longest wait until DDS knows that the processes have ended [s]
LENGTH = 500  # length of a message in a report

RELIABLE, BEST_EFFORT = (
    QoSProfile(reliability=reliability, history=HistoryPolicy.KEEP_LAST, depth=1000)
    for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
)


class Graph(GraphProcesses):
    """A ROS graph: processes, nodes in the process of the test, and the node of the test.

    A context manager; the fixture `graph` of pytest gives each test its own.  For the environment
    see `GraphProcesses`.  `sections` are further sections of the report of a failure: title and
    function that returns the text.
    """

    def __enter__(self) -> Graph:
        super().__enter__()
        self._ends: list[tuple[str, Callable[[], int]]] = []
        self._records: dict[str, list[Any]] = {}
        self.sections: dict[str, Callable[[], str]] = {'topics': self._topics}
        return self

    def report(self) -> list[tuple[str, str]]:
        """Return the output of each process and the texts of `sections`, with their titles."""
        texts = ((title, text()) for title, text in self.sections.items())
        return [*super().report(), *((title, text) for title, text in texts if text)]

    def _topics(self) -> str:
        """Return the last message of each topic that is recorded."""
        return '\n'.join(
            f'{topic}: {len(messages)} messages, last: {_short(messages[-1:])}'
            for topic, messages in self._records.items()
        )

    @cached_property
    def context(self) -> Context:
        """The context of the nodes in the process of the test."""
        context, signals = Context(), SignalHandlerOptions.NO
        rclpy.init(args=[], context=context, domain_id=self.domain, signal_handler_options=signals)
        self._ending.callback(self._close)
        return context

    @cached_property
    def node(self) -> Node:
        """The node of the test."""
        less: Any = {'start_parameter_services': False, 'enable_rosout': False}
        return self.add_node(rclpy.create_node('test', context=self.context, **less))

    @cached_property
    def _executor(self) -> SingleThreadedExecutor:
        return SingleThreadedExecutor(context=self.context)

    def add_node(self, node: Node) -> Node:
        """Let a node, on the context of the graph, work whenever the test waits; return it."""
        if node.context is not self.context:
            raise ValueError(f'{node.get_name()}: create the node with context=graph.context')
        self._executor.add_node(node)
        return node

    def _close(self) -> None:
        # DDS may block in `destroy_node` until it knows that the processes have ended, which
        # killed processes do not announce.
        limit = Deadline(LETTING_GO_MAX)
        while any(matched() for _, matched in self._ends) and not limit.passed():
            self._executor.spin_once(timeout_sec=0.02)
        nodes = self._executor.get_nodes()
        self._executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)

    def publisher(self, kind: type[Any], topic: str, qos: QoSProfile = RELIABLE) -> Publisher:
        """Return a publisher."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self._ends.append((topic, publisher.get_subscription_count))
        return publisher

    def listen(self, kind: type[Any], topic: str, qos: QoSProfile = RELIABLE) -> list[Any]:
        """Return a list that grows with the messages of a topic."""
        messages: list[Any] = []
        subscription = self.node.create_subscription(kind, topic, messages.append, qos)
        self._ends.append((topic, subscription.get_publisher_count))
        self._records[topic] = messages
        return messages

    def connect(self, name: str) -> Parameters:
        """Wait until both ends of all topics have matched; return the parameters of a node."""
        # DDS announces the ends of a process in the order of their creation: a node that answers
        # the client of a service knows all ends that were created before the client.
        parameters = Parameters(self, name)
        for topic, matched in self._ends:
            self.spin_until(matched, f'{topic}: matched')
        parameters.get('use_sim_time')
        return parameters

    def spin_until(
        self, condition: Callable[[], object], what: str,
        repeat: Callable[[], object] | None = None, deadline: float = DEADLINE,
    ) -> None:
        """Let the nodes work until a condition holds; `what` describes it in errors.

        `repeat` is called at the start and then at growing intervals, for messages that may be
        lost.  Raises an AssertionError if the condition does not hold by the deadline [s], not
        counting stalls of the machine, or if a process ends meanwhile.
        """
        __tracebackhide__ = True
        limit, again, pause = Deadline(deadline), time.monotonic(), FIRST_PAUSE
        while not condition():
            if ended := self.ended():
                raise AssertionError(f'{what}: waited in vain, {"; ".join(ended)}')
            if limit.passed():
                raise AssertionError(f'{what}: not within {deadline:g} s')
            if repeat and time.monotonic() >= again:
                repeat()
                again, pause = time.monotonic() + pause, min(2.0 * pause, LAST_PAUSE)
            self._executor.spin_once(timeout_sec=0.1)


def _short(messages: list[Any]) -> str:
    """Return messages as text of a few lines, without the modules of their types."""
    text = sub(r'\w+\.msg\.', '', ', '.join(map(str, messages))) or 'none'
    return text if len(text) < LENGTH else f'{text[:LENGTH]} ...'


class Parameters:
    """The parameters of the node `name` of a graph; `Graph.connect` returns them."""

    def __init__(self, graph: Graph, name: str) -> None:
        self._graph, self._client = graph, ParameterClient(graph.node, name)

    def get(self, *names: str) -> list[Any]:
        """Return the values of parameters."""
        return self._wait(self._client.get(names))

    def set(self, values: Mapping[str, Any]) -> Any:
        """Set parameters one by one; return the result of each, a SetParametersResult."""
        return self._wait(self._client.set(values))

    def set_atomically(self, values: Mapping[str, Any]) -> Any:
        """Set all parameters or none; return the result, a SetParametersResult."""
        return self._wait(self._client.set_atomically(values))

    def _wait(self, call: Call[Answer]) -> Answer:
        self._graph.spin_until(
            lambda: call.answer() is not None,
            f'{self._client.remote_node_name}: an answer about parameters')
        answer = call.answer()
        assert answer is not None
        return answer


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
