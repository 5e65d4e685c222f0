"""The executor: responses that cannot be sent, and the clients of its nodes."""

import warnings

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor

from ca_ros.nodes.executor import Executor
from ca_ros.process.processes import Deadline
from ca_ros.testing import DEADLINE


def test_a_response_that_comes_too_late_is_logged(graph, capfd):
    context = graph.node.context
    node, other = (
        rclpy.create_node(name, context=context, start_parameter_services=False)
        for name in ('server', 'client'))
    service = node.create_service(GetParameters, 'late', lambda request, response: response)
    send, sent = service.send_response, []

    def late(response, header):
        # rclpy warns in this way if the middleware has not discovered the client in time.
        if not sent:
            warnings.warn('failed to send response (timeout)', RuntimeWarning, stacklevel=1)
        sent.append(header)
        send(response, header)

    service.send_response = late
    client = other.create_client(GetParameters, 'late')
    executor, others = Executor(context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    others.add_node(other)
    limit = Deadline(DEADLINE)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        while not client.service_is_ready():
            others.spin_once(timeout_sec=0.01)
        futures = [client.call_async(GetParameters.Request()) for _ in range(2)]
        while not all(future.done() for future in futures):
            assert not limit.passed()
            executor.spin_once(timeout_sec=0.01)
            others.spin_once(timeout_sec=0.01)
    for each in (executor, others):
        each.shutdown()
    for each in (node, other):
        each.destroy_node()
    err = capfd.readouterr().err
    assert err.count('late: failed to send response (timeout)') == 1
    assert 'Warning:' not in err


def test_clients_of_its_nodes_get_answers(graph):
    context, executor = graph.node.context, Executor(context=graph.node.context)
    server, node = (
        rclpy.create_node(name, context=context, start_parameter_services=False)
        for name in ('server', 'client'))
    server.create_service(GetParameters, 'asked', lambda request, response: response)
    client = node.create_client(GetParameters, 'asked')
    called = []
    for each in (server, node):
        executor.add_node(each)
    limit = Deadline(DEADLINE)
    while not client.service_is_ready():
        assert not limit.passed()
        executor.spin_once(timeout_sec=0.01)
    futures = [client.call_async(GetParameters.Request()) for _ in range(3)]
    client.remove_pending_request(futures[0])
    for future in futures:
        future.add_done_callback(called.append)
    executor.spin_until_future_complete(futures[1], timeout_sec=DEADLINE)
    assert isinstance(futures[1].result(), GetParameters.Response)
    rclpy.spin_until_future_complete(node, futures[2], executor)
    assert called == futures[1:]
    # Nobody answers this one.
    executor.spin_until_future_complete(futures[0], timeout_sec=0.05)
    assert not futures[0].done()
    executor.shutdown()
    for each in (server, node):
        each.destroy_node()
