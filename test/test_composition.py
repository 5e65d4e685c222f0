"""Several nodes in one process, on one executor."""

import math
from contextlib import ExitStack

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from ca_ros.bringup.deadline import Deadline
from ca_ros.bringup.recorder import Recorder
from ca_ros.flight.controller import Waypoint
from ca_ros.nodes.allocator import AllocatorNode
from ca_ros.nodes.controller import ControllerNode
from ca_ros.nodes.executor import Executor
from ca_ros.nodes.simulator import SimulatorNode
from ca_ros.vehicle.files import load
from ros import DEADLINE
from test_bringup import fly_offline

DURATION = 6.0


def overrides(**others):
    """Return the parameters of the hexarotor in lockstep."""
    values = load('hexarotor') | {'mode': 'lockstep'} | others
    return [Parameter(name, value=value) for name, value in values.items()]


class Composition:
    """The three nodes on one executor, in a context of their own, and a recorder beside them."""

    def __init__(self, graph, executor_class, namespace):
        self._ending = ExitStack()
        context = rclpy.Context()
        rclpy.init(
            args=[], context=context, domain_id=graph.domain,
            signal_handler_options=SignalHandlerOptions.NO)
        self._ending.callback(rclpy.shutdown, context=context)
        self.executor = executor_class(context=context)
        self._ending.callback(self.executor.shutdown)
        given = {'context': context, 'namespace': namespace, 'use_global_arguments': False}
        self.nodes = [
            node_class(parameter_overrides=overrides(), **given)
            for node_class in (ControllerNode, AllocatorNode, SimulatorNode)]
        for node in self.nodes:
            self._ending.callback(node.destroy_node)
            self.executor.add_node(node)
        self.recorder = Recorder(**given)
        self._ending.callback(self.recorder.destroy_node)
        self._client = SingleThreadedExecutor(context=context)
        self._ending.callback(self._client.shutdown)
        self._client.add_node(self.recorder)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ending.close()

    def spin_until(self, condition, what):
        limit = Deadline(DEADLINE)
        while not condition():
            assert not limit.passed(), what
            self.executor.spin_once(timeout_sec=0.1)
            if self.recorder.waiting:
                self._client.spin_once(timeout_sec=0.0)
            self.recorder.drain()

    def fly(self):
        self.spin_until(lambda: not self.recorder.missing(), 'a complete loop')
        self.recorder.send(Waypoint.of(1.0, 1.0, 1.0, math.radians(45.0)))
        self.spin_until(lambda: self.recorder.elapsed >= DURATION, 'a flight')
        return self.recorder.flight(DURATION)


@pytest.mark.parametrize('executor_class', [Executor, SingleThreadedExecutor])
def test_three_nodes_on_one_executor_fly_as_the_offline_loop_to_the_last_bit(
        graph, tmp_path, executor_class):
    with Composition(graph, executor_class, '/uav1') as nodes:
        assert [node.get_fully_qualified_name() for node in nodes.nodes] == [
            '/uav1/controller', '/uav1/allocator', '/uav1/simulator']
        flight = nodes.fly()
    flight.write_csv(tmp_path / 'composed.csv')
    fly_offline('exact', DURATION).write_csv(tmp_path / 'offline.csv')
    assert (tmp_path / 'composed.csv').read_bytes() == (tmp_path / 'offline.csv').read_bytes()
