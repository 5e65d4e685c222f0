"""An executor with one wait set for one thread."""

import warnings
from typing import Any

from rclpy import executors
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.task import Future, Task
from rclpy.time import Time
from rclpy.utilities import timeout_sec_to_nsec
from rosgraph_msgs.msg import Clock as ClockMessage

from ca_ros.nodes.rclpy_internals import WaitSet, guard_condition, takes_info


class Executor(executors.Executor):
    """Serves everything that is ready once a turn, in one thread, with one wait set.

    Each turn serves one message of each subscription, the timers, the events, one request of each
    service and one response of each client, in this order.  A flood of messages therefore delays a
    service by one turn only, and a timer runs after the messages that arrived before it was due.

    rclpy's SingleThreadedExecutor builds a wait set and a task for each callback, which takes
    longer than the callback of a command.  Its EventsExecutor queues an event for each message,
    also for messages that newer ones have replaced, and needs minutes to recover from a flood.

    Coroutines and the guard conditions of nodes are not served: a callback is a function that does
    not spin, and the done callbacks of futures are called at once.  The nodes are by default in
    the global context.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        self._changed = True
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)

    def add_node(self, node: Node) -> bool:
        """Serve a node from the next turn on."""
        self._changed = True
        return super().add_node(node)

    def remove_node(self, node: Node) -> None:
        """Stop serving a node from the next turn on."""
        self._changed = True
        super().remove_node(node)

    def wake(self) -> None:
        """Note that entities may have changed, and end the wait."""
        self._changed = True
        super().wake()

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | executors.TimeoutObject | None = None
    ) -> None:
        """Serve one turn; `spin_until_future_complete` calls this until the future is done."""
        given: Any = timeout_sec
        self.spin_once(getattr(given, 'timeout', given))

    # The name that rclpy calls since Kilted.
    _spin_once_until_future_complete = spin_once_until_future_complete

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait at most the timeout [s] until something is ready, and serve all that is ready."""
        if self._changed:
            self._gather()
        # rcl removes entities that are not ready from a wait set, so each turn fills it again.
        wait_set = self._wait_set
        wait_set.clear_entities()
        wait_set.add_guard_condition(guard_condition(self).handle)
        for _, subscription in self._subscriptions:
            wait_set.add_subscription(subscription.handle)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        services, clients, waitables = self._others
        for _, service in services:
            wait_set.add_service(service.handle)
        for client in clients:
            wait_set.add_client(client.handle)
        for waitable in waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(timeout_sec_to_nsec(timeout_sec))
        ready = wait_set.is_ready
        self._changed |= ready('guard_condition', 0)
        # A message does not wait until all others have been asked whether they are ready.
        for i, (node, subscription) in enumerate(self._subscriptions):
            if not ready('subscription', i):
                continue
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is not None and self._convertible(node, taken[0]):
                subscription.callback(*taken if takes_info(subscription) else taken[:1])
        for timer in self._timers:
            if timer.handle.is_timer_ready():
                timer.handle.call_timer()
                timer.callback()
        for waitable in waitables:
            if waitable.is_ready(wait_set):
                task = Task(waitable.execute, (waitable.take_data(),), executor=self)
                task()
                task.result()
        for i, (node, service) in enumerate(services):
            if ready('service', i):
                self._answer(node, service)
        for i, client in enumerate(clients):
            if ready('client', i):
                _take_answer(client)

    def _answer(self, node: Node, service: Any) -> None:
        """Answer a request to a service of a node."""
        kind = service.srv_type
        request, header = service.handle.service_take_request(kind.Request)
        if header is None:
            return
        response = service.callback(request, kind.Response())
        with warnings.catch_warnings(record=True) as late:
            warnings.simplefilter('always')
            service.send_response(response, header)
        if late:
            # The client has not been discovered or has ended; a client may ask again.
            self._warn(node, f'{service.srv_name}: {late[0].message}')

    def _convertible(self, node: Node, message: Any) -> bool:
        """Return whether rclpy's own callback of a clock, which would end the node, takes it."""
        try:
            if isinstance(message, ClockMessage):
                Time.from_msg(message.clock)
        except ValueError as error:
            self._warn(node, f'dropped: {type(message).__name__}: {error}')
            return False
        return True

    def _warn(self, node: Node, what: str) -> None:
        """Log a warning, at most once a second."""
        limit: Any = {'throttle_duration_sec': 1.0, 'throttle_time_source_type': self._steady}
        node.get_logger().warning(what, **limit)

    def _gather(self) -> None:
        self._changed = False
        nodes = self.get_nodes()
        self._subscriptions = [(node, x) for node in nodes for x in node.subscriptions]
        self._timers = [x for node in nodes for x in node.timers]
        services = [(node, x) for node in nodes for x in node.services]
        clients = [x for node in nodes for x in node.clients]
        waitables = [x for node in nodes for x in node.waitables]
        self._others = services, clients, waitables
        self._wait_set = WaitSet(
            len(self._subscriptions), 1, len(self._timers), len(clients), len(services),
            sum(waitable.get_num_entities().num_events for waitable in waitables),
            self.context.handle,
        )


def _take_answer(client: Any) -> None:
    """Give the answer that has come for a client to the one who waits for it."""
    header, response = client.handle.take_response(client.srv_type.Response)
    if header is None:
        return
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:
        # The request was given up.
        return
    future.set_result(response)
