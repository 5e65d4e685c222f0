"""Several nodes in one process, on one executor."""

import math
import re
from contextlib import ExitStack
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from ca_ros import ParameterError
from ca_ros.bringup.recorder import Recorder
from ca_ros.control.waypoint import Waypoint
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.controller import ControllerNode
from ca_ros.nodes.executor import Executor
from ca_ros.nodes.monitor import MonitorNode
from ca_ros.nodes.simulator import SimulatorNode
from ca_ros.nodes.topics import BATTERY, EFFECTORS, IMU, TOPICS
from ca_ros.process.processes import Deadline
from ca_ros.settings import table as settings_of
from ca_ros.testing import DEADLINE
from nodes import fly_offline
from strategies import file_values, length

DURATION = 1.0
METHODS = {'/uav1': 'exact', '/uav2': 'pseudo_inverse'}
"""The allocation method of each vehicle, by namespace."""


class Composition:
    """The nodes of two vehicles on one executor, and a recorder for each vehicle beside them."""

    def __init__(self, graph, executor_class):
        self._ending = ExitStack()
        context = rclpy.Context()
        rclpy.init(
            args=[], context=context, domain_id=graph.domain,
            signal_handler_options=SignalHandlerOptions.NO)
        self._ending.callback(rclpy.shutdown, context=context)
        self.executor, self._client = (
            self._own(kind(context=context)) for kind in (executor_class, SingleThreadedExecutor))
        self.nodes, self.recorders = [], []
        for namespace, method in METHODS.items():
            given = {'context': context, 'namespace': namespace, 'use_global_arguments': False}
            values = file_values('hexarotor') | {'mode': 'lockstep', 'allocation.method': method}
            overrides = [Parameter(name, value=value) for name, value in values.items()]
            self.nodes += [
                self._add(self.executor, node_class(parameter_overrides=overrides, **given))
                for node_class in (ControllerNode, AllocatorNode, SimulatorNode)]
            self.recorders.append(self._add(self._client, Recorder(**given)))

    def _own(self, executor):
        self._ending.callback(executor.shutdown)
        return executor

    def _add(self, executor, node):
        self._ending.callback(node.destroy_node)
        executor.add_node(node)
        return node

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ending.close()

    def spin_until(self, condition, what):
        """Spin until a condition holds for each recorder."""
        limit = Deadline(DEADLINE)
        while not all(map(condition, self.recorders)):
            assert not limit.passed(), what
            self.executor.spin_once(timeout_sec=0.1)
            if any(recorder.waiting for recorder in self.recorders):
                self._client.spin_once(timeout_sec=0.0)
            for recorder in self.recorders:
                recorder.drain()

    def fly(self):
        """Fly both vehicles to the paper's waypoint; return the flights."""
        self.spin_until(lambda recorder: not recorder.missing(), 'complete loops')
        for recorder in self.recorders:
            recorder.send(Waypoint.of(1.0, 1.0, 1.0, math.radians(45.0)))
        self.spin_until(lambda recorder: (recorder.elapsed or 0) >= 1e9 * DURATION, 'two flights')
        return [recorder.flight(DURATION) for recorder in self.recorders]


@pytest.mark.parametrize(
    'executor_class', length([Executor], [Executor, SingleThreadedExecutor]))
def test_nodes_on_one_executor_fly_as_the_offline_loop_to_the_last_bit(
        graph, tmp_path, executor_class):
    with Composition(graph, executor_class) as composition:
        assert [node.get_fully_qualified_name() for node in composition.nodes] == [
            f'{namespace}/{name}' for namespace in METHODS
            for name in ('controller', 'allocator', 'simulator')]
        flights = composition.fly()
    for flight, method in zip(flights, METHODS.values(), strict=True):
        composed, offline = tmp_path / f'{method}.csv', tmp_path / f'{method}_offline.csv'
        flight.write_csv(composed)
        fly_offline(method, DURATION).write_csv(offline)
        assert composed.read_bytes() == offline.read_bytes()


def test_parameters_with_two_bounds_have_a_range_for_sliders(graph):
    def node(node_class, **changes):
        values = file_values('hexarotor', kind=node_class.declared) | changes
        return node_class(
            context=graph.node.context, use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])

    simulator, allocator = node(SimulatorNode), node(AllocatorNode)
    try:
        ranges = {
            name: [(each.from_value, each.to_value) for each in
                   simulator.describe_parameter(name).floating_point_range]
            for name in settings_of(SimulatorNode.declared)}
        assert ranges['simulator.real_time_factor'] == [(0.01, 10.0)]
        assert ranges['rotors.health'] == [(0.0, 1.0)]
        assert ranges['vehicle.mass'] == ranges['mode'] == []
        result = allocator.set_parameters_atomically([Parameter('rotors.health', value=2.0)])
        assert result.reason == (
            'Parameter rotors.health out of range Min: 0.0, Max: 1.0, value: 2.0')
        [result] = allocator.set_parameters([Parameter('rotors.health', value=[2.0] * 6)])
        assert result.reason == 'rotors.health[0]: must be in [0, 1], got 2.0'
        assert allocator.get_parameter('rotors.health').value == 1.0
    finally:
        simulator.destroy_node()
        allocator.destroy_node()
    with pytest.raises(ParameterError, match=r'^simulator\.time_step: must be in \[1e-05, 1\], g'):
        node(SimulatorNode, **{'simulator.time_step': 2.0})


TOPICS_PAGE = Path(__file__).resolve().parent.parent / 'docs' / 'topics.md'


@pytest.mark.skipif(not TOPICS_PAGE.is_file(), reason='docs/ is not beside the tests')
@pytest.mark.parametrize('mode', ['realtime', 'lockstep'])
def test_the_table_of_qos_is_that_of_the_nodes(graph, mode):
    table, streams = {'offered': {}, 'requested': {}}, []
    for names, when, offered, requested in re.findall(
            r'^\| (.*?) \| (realtime|lockstep|both) \| (.*?) \| (.*?) \|$',
            TOPICS_PAGE.read_text(encoding='utf-8'), re.MULTILINE):
        topics = re.findall('`(.*?)`', names) or streams
        streams += topics if when == 'realtime' else []
        if when in (mode, 'both'):
            table['offered'] |= dict.fromkeys(topics, offered)
            table['requested'] |= dict.fromkeys(topics, requested)
    assert table['offered'].keys() == (
        {topic.name for topic in TOPICS} - {'/rosout', EFFECTORS.name, '~/markers'}
        | {IMU, BATTERY})
    seen = set()
    for node_class in (ControllerNode, AllocatorNode, SimulatorNode, MonitorNode):
        tilts = node_class in (AllocatorNode, SimulatorNode)
        vehicle = 'hexarotor_tilting' if tilts else 'hexarotor'
        values = file_values(vehicle, kind=node_class.declared) | {'mode': mode}
        values |= {name: True for name in values if 'publish_' in name}
        if node_class is AllocatorNode:
            values |= {'rotors.thrust_curve.pwm': [1000.0, 2000.0],
                       'rotors.speed_max_per_volt': 20.0}
        else:
            values |= {name: [0.0, 0.0, 0.0] for name in values if name.endswith('imu_position')}
        node = node_class(
            context=graph.node.context, use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])
        try:
            for kind, ends in (('offered', node.publishers), ('requested', node.subscriptions)):
                told = {node.resolve_topic_name(name): name for name in table[kind]}
                for end in ends:
                    name, qos = told.get(end.topic_name), end.qos_profile
                    if name:
                        words = qos.reliability.name.lower().replace('_', ' ')
                        words += f', depth {qos.depth}'
                        if qos.durability.name == 'TRANSIENT_LOCAL':
                            words += ', transient local'
                        assert table[kind][name] == words, name
                        assert qos.history.name == 'KEEP_LAST', name
                        seen.add((kind, name))
        finally:
            node.destroy_node()
    told = [(kind, name) for kind in table for name in table[kind]]
    others = [end for end in told if not table[end[0]][end[1]].startswith(('yours', 'none'))]
    not_in_the_loop = {('requested', topic.name) for topic in TOPICS if not topic.subscribers}
    assert seen - not_in_the_loop == set(others) - not_in_the_loop
