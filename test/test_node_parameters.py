"""Parameters of the nodes: at start, on the running node, and under load."""

import json
import math
import signal
import time
from collections import Counter

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray

from ca_ros import ALLOCATORS, ParameterError, Vehicle, make_allocator
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.parameter_files import DECLARED, AllocatorSettings, FileSettings
from ca_ros.settings import table
from ca_ros.testing import Graph, wrench
from ca_ros_cli import NODES
from nodes import (
    HOVER,
    KINDS,
    OBSERVERS,
    AllocatorClient,
    host,
    refused,
    run_all,
    some_wrenches,
    twin,
)
from strategies import file_values, length

SHIPPED = file_values('hexarotor')
PARAMETERS, ALLOCATOR = table(FileSettings), table(AllocatorSettings)


def wrong_values(name):
    """Return values that a parameter must not have, each with a word that has to be said of it."""
    parameter = PARAMETERS[name]
    if bool in parameter.kinds:
        return [(1.0, '1.0'), ('wrong', 'wrong'), ([True, True], 'one value')]
    if str in parameter.kinds:
        values = [(True, 'True')]
        if float not in parameter.kinds:
            values.append((1.0, '1.0'))
        if parameter.choices:
            values.append(('magic', 'magic'))
    else:
        values = [('wrong', 'wrong'), (True, 'True')]
        values += [(number, str(number)) for number in (math.nan, math.inf, -math.inf)]
        if parameter.minimum > -math.inf:
            values.append((parameter.minimum - 0.5, str(parameter.minimum - 0.5)))
        if parameter.maximum < math.inf:
            values.append((parameter.maximum + 0.5, str(parameter.maximum + 0.5)))
        if parameter.positive:
            values += [(0.0, '0.0'), (-0.5, '-0.5')]
        if int in parameter.kinds:
            values.append((1.5, '1.5'))
    if not parameter.array:
        array = [SHIPPED[name]] * 2
        return [*values, (array, 'one value')]
    if parameter.sizes and 1 not in parameter.sizes:
        values = [(value, 'got 1') for value, _ in values]
    good = SHIPPED[name] if isinstance(SHIPPED[name], list) else (
        [SHIPPED[name]] * max(parameter.sizes, default=6))
    kind = str if str in parameter.kinds else float
    entries = [value for value, _ in values if type(value) is kind]
    for i in range(len(good) if entries else 0):
        entry = entries[i % len(entries)]
        values.append(([*good[:i], entry, *good[i + 1:]], f'{name}[{i}]'))
    return values


WRONG = [(name, value, word) for name in PARAMETERS for value, word in wrong_values(name)]


# At start

def starts(folder, node, changes):
    """Start a node once for each change of the shipped file; return exit codes and words."""
    files = []
    for i, change in enumerate(changes):
        files.append(folder / f'{node}_{i}.yaml')
        files[-1].write_text(
            yaml.safe_dump({'/**': {'ros__parameters': {**SHIPPED, **change}}}), encoding='utf-8')
    found = run_all([(node, '--ros-args', '--params-file', str(file)) for file in files])
    return [(code, err) for code, _, err in found]


def check_line(node, code, said, words):
    """A start failed with one line that names the node and the fault."""
    lines = said.splitlines()
    assert code == 1, words
    assert len(lines) == 1, (words, said)
    assert lines[0].startswith(f'{node}: '), said
    assert [word for word in words if word not in lines[0]] == [], said


UNKNOWN = {
    'comand_timeout': 'command_timeout', 'timeout.action': 'timeout_action',
    'vehicle.mas': 'vehicle.mass', 'rotors.blades': 'no such parameter',
    'allocation.exact.polcy': 'allocation.exact.policy', 'allocation': 'no such parameter'}
REFUSED = [
    {'rotors.health': [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]}, {'vehicle.mass': 18.0},
    {'rotors.torque_coefficient': 0.0}]


@pytest.mark.slow
@pytest.mark.parametrize('node', ['allocator', 'controller', 'simulator'])
def test_a_wrong_value_ends_the_start_with_one_line_that_names_it(tmp_path, node):
    wrong = [
        ('vehicle.mass', math.nan, ''), ('rotors.positions', [0.0, math.inf, *[0.0] * 16], ''),
        ('command_timeout', 0.0, ''), *((name, 1.0, word) for name, word in UNKNOWN.items())]
    if node == 'allocator':
        wrong += WRONG[::length(48, 1)]
    refused = REFUSED if node != 'simulator' else []
    answers = starts(tmp_path, node, [*({name: value} for name, value, _ in wrong), *refused])
    for name, _, word in wrong:
        check_line(node, *answers.pop(0), [name, word])
    for change, answer in zip(refused, answers, strict=True):
        with pytest.raises(ParameterError) as caught:
            make_allocator('exact', Vehicle.from_parameters({**SHIPPED, **change}))
        assert answer == (1, f'{node}: {caught.value}\n')


def test_the_allocator_starts_from_a_file_without_an_inertia(graph, tmp_path):
    values = dict(SHIPPED)
    del values['vehicle.inertia']
    file = tmp_path / 'onboard.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}), encoding='utf-8')
    graph.start('allocator', '--vehicle', str(file))
    assert graph.connect('allocator').get('vehicle.mass') == [1.0]
    refused([((node, '--vehicle', str(file)), ['onboard.yaml: vehicle.inertia: missing'])
             for node in ('controller', 'simulator')])


@pytest.mark.slow
def test_a_missing_parameter_is_said_with_the_node_and_its_files(tmp_path):
    file = tmp_path / 'others.yaml'
    file.write_text(yaml.safe_dump({
        name: {'ros__parameters': {'vehicle.mass': 1.0}}
        for name in ('/uav1/simulator', '/uav2/allocator')}))
    other = tmp_path / 'other.yaml'
    other.write_text(yaml.safe_dump({'/**': {'ros__parameters': {'vehicle.gravity': 9.81}}}))
    refused([
        (('allocator', '--ros-args', '-r', '__ns:=/uav1', '--params-file', str(file)), [
            'vehicle.mass: missing', 'looked for by the node /uav1/allocator in ', str(file),
            'sections: /uav1/simulator, /uav2/allocator']),
        (('allocator', '--vehicle', str(other)),
         [f'allocator: {other}: vehicle.mass: missing; it is the mass [kg]'])])


def test_each_node_of_the_loop_has_its_parameters():
    assert DECLARED.keys() == set(NODES)


@pytest.mark.parametrize('node', DECLARED)
def test_a_node_declares_what_it_uses_and_names_what_no_node_has(graph, node):
    process = graph.start(
        node, '--vehicle', 'hexarotor', '--ros-args', '-p', 'camera.exposure:=3',
        '-p', 'foo:=1.0', '-p', 'use_sim_time:=true',
        '-p', 'qos_overrides./clock.subscription.depth:=1',
        '-p', 'qos_overrides./command/wrench.subscription.reliability:=reliable',
        *(word for name, value in SHIPPED.items()
          for word in ('-p', f'{name}:={json.dumps(value)}')))
    parameters = graph.connect(node)
    # A node declares what it uses, and no more.
    declared = table(DECLARED[node])
    assert parameters.get(*declared) == [SHIPPED[name] for name in declared]
    others = [name for name in SHIPPED if name not in declared]
    results = parameters.set({name: SHIPPED[name] for name in others})
    assert [name for name, result in zip(others, results, strict=True)
            if result.successful or f"'{name}'" not in result.reason] == []
    _, err = graph.end(process, signal.SIGINT)
    [line] = [line for line in err.splitlines() if 'camera.exposure' in line]
    assert 'foo' in line
    assert 'WARN' in line
    assert 'use_sim_time' not in err
    [line] = [line for line in err.splitlines() if 'qos_overrides' in line]
    assert 'qos_overrides./command/wrench.subscription.reliability: without effect' in line
    assert [name for name in SHIPPED if name in line] == []


# On the running node

@pytest.fixture(scope='module')
def client():
    """Share an allocator."""
    with Graph() as graph:
        host(graph, 'allocator', '-p', 'mode:=lockstep')
        yield AllocatorClient(graph)


@pytest.mark.parametrize('name', [name for name in ALLOCATOR if ALLOCATOR[name].mutable])
def test_a_wrong_value_on_the_running_node_is_refused_with_the_reason(client, name):
    before, speeds = client.parameters.get(*ALLOCATOR), client.ask(HOVER)
    for value, word in wrong_values(name):
        [result] = client.parameters.set({name: value})
        assert not result.successful, value
        assert name in result.reason
        assert word in result.reason
        assert len(result.reason.splitlines()) == 1
    assert client.parameters.get(*ALLOCATOR) == before
    assert client.ask(HOVER).tobytes() == speeds.tobytes()


@pytest.mark.parametrize('value', ['[0.0, 0.5, 1, 1, 1, 1]', '[1, 1.0, 1, 1, 1, 1]'])
def test_a_list_that_ros_takes_for_a_string_is_refused_with_what_would_be_right(client, value):
    [result] = client.parameters.set({'rotors.health': value})
    assert not result.successful
    for words in ('rotors.health: ', f"the string '{value}'", 'write [0.0, 0.5, 1.0]'):
        assert words in result.reason


WRONG_SETS = [
    ({'no.such': 1.0}, ''), ({'rotors.helth': 1.0}, ''), ({'rotors.health': None}, ''),
    ({'allocation.method': None}, ''), ({'allocation.method': 'direct', 'no.such': 1.0}, ''),
    ({'allocation.method': 'direct', 'use_sim_time': 5}, ''),
    ({'allocation.method': 'magic'}, ' '.join(ALLOCATORS)),
    ({'allocation.method': 'direct', 'rotors.health': [1.0] * 5}, 'rotors.health 6 5'),
    ({'allocation.method': 'direct', 'vehicle.mass': 2.0}, 'read-only'),
    ({'allocation.method': 'conventional', 'allocation.conventional.weight': [1.0, 1.0]},
     'allocation.conventional.weight 6')]


def test_what_cannot_be_set_changes_nothing_now_or_later(client):
    before, speeds = client.parameters.get(*ALLOCATOR), client.ask(HOVER)
    for values, words in WRONG_SETS:
        result = client.parameters.set_atomically(values)
        assert not result.successful, values
        assert result.reason, values
        assert [word for word in words.split() if word not in result.reason] == []
        assert client.parameters.set_atomically({'use_sim_time': False}).successful
        assert client.parameters.get(*ALLOCATOR) == before, values
        assert client.ask(HOVER).tobytes() == speeds.tobytes(), values
    assert client.diagnose()[1]['method'] == 'exact'


@pytest.mark.parametrize('name', [*KINDS, *OBSERVERS])
def test_every_parameter_takes_every_kind_of_value_or_refuses_it_by_name(graph, name):
    node, twin = host(graph, name), host(graph, name, '-r', '__ns:=/twin')
    values = [
        [], [''], '', 'wrong', '[1.0, 2]', True, [True], [b'\x01'], 0, -1, 10**18, [0],
        [1] * 37, 0.0, -1.0, 1e300, math.nan, [math.nan], [0.0], [1.0] * 6, [1.0] * 37, ['a'] * 3]
    changes = [Parameter(key, value=value) for key in table(node.declared) for value in values]
    changes += [Parameter(key) for key in table(node.declared)]
    answers = node.set_parameters(changes)
    for change, answer in zip(changes, answers, strict=True):
        assert answer.successful or change.name in answer.reason, (change.name, change.value)
        assert len(answer.reason.splitlines()) <= 1
    # What was taken is in force: all of it can be set again at once, also on another node.
    for each in (node, twin):
        mutable = [node.get_parameter(key) for key, field in table(node.declared).items()
                   if field.mutable]
        answer = each.set_parameters_atomically(mutable)
        assert answer.successful, answer.reason


def serve(node, kind, *changes):
    """Return the answer of a service to changes, as messages, and the processor time [s]."""
    [service] = [each for each in node.services if each.srv_type is kind]
    begun = time.thread_time()
    answer = service.callback(kind.Request(parameters=changes), kind.Response())
    return answer, time.thread_time() - begun


def change(name, value):
    return Parameter(name, value=value).to_parameter_msg()


def test_requests_that_are_too_long_are_refused_at_once(graph):
    node = host(graph, 'allocator')
    for size, time_max in ((10_000, 0.05), (100_000, 0.03), (2_000_000, 0.3)):
        message = change('rotors.health', [1.0] * size)
        for kind in (SetParameters, SetParametersAtomically):
            answer, taken = serve(node, kind, message)
            result = answer.results[0] if kind is SetParameters else answer.result
            assert not result.successful
            assert result.reason.startswith('rotors.health: ')
            assert taken < time_max
    answer, taken = serve(node, SetParameters, *[change('rotors.health', 1.0)] * 100_000)
    assert not any(result.successful for result in answer.results)


def test_a_name_twice_and_a_type_that_is_none_are_refused_with_the_reason(graph):
    node = host(graph, 'allocator')
    twice = change('rotors.health', -1.0), change('rotors.health', 0.4)
    answer, _ = serve(node, SetParametersAtomically, *twice)
    assert answer.result.reason == 'rotors.health: given twice in one request'
    result = node.set_parameters_atomically(
        [Parameter('rotors.health', value=share) for share in (-1.0, 0.4)])
    assert not result.successful
    assert node.get_parameter('rotors.health').value == 1.0
    wrong = change('rotors.health', 1.0)
    wrong.value.type = 99
    for kind in (SetParameters, SetParametersAtomically):
        answer, _ = serve(node, kind, wrong)
        result = answer.results[0] if kind is SetParameters else answer.result
        assert result.reason == 'rotors.health: 99 is no type of a parameter'
    answer, _ = serve(node, SetParametersAtomically, change('no.such', 1.0))
    assert "'no.such'" in answer.result.reason


def test_a_reason_does_not_repeat_a_long_text(graph):
    node = host(graph, 'allocator')
    [result] = node.set_parameters([Parameter('allocation.exact.order', value='x' * 100_000)])
    assert not result.successful
    assert 'x' * 20 in result.reason
    assert len(result.reason) <= 1000


def test_wrong_values_of_methods_that_are_not_in_use_are_refused(graph):
    node, name = host(graph, 'allocator'), 'allocation.conventional.weight'
    [result] = node.set_parameters([Parameter(name, value=[1.0, 1.0])])
    assert not result.successful
    assert name in result.reason
    [result] = node.set_parameters([Parameter(name, value=[1.0] * 6)])
    assert result.successful, result.reason
    with pytest.raises(ParameterError, match='conventional'):
        host(graph, 'allocator', '-r', '__ns:=/other', '-p', f'{name}:=[1.0, 1.0]')


def spin_a_while(executor):
    for _ in range(100):
        executor.spin_once(timeout_sec=0.1)


def test_an_executor_that_cannot_run_a_node_is_refused_with_the_reason(graph):
    events = pytest.importorskip('rclpy.experimental').EventsExecutor
    node = AllocatorNode(context=graph.context, use_global_arguments=False, parameter_overrides=[
        Parameter(key, value=value)
        for key, value in file_values('hexarotor', kind=AllocatorNode.declared).items()])
    executor = events(context=graph.context)
    try:
        executor.add_node(node)
        with pytest.raises(RuntimeError, match='EventsExecutor of rclpy fails'):
            spin_a_while(executor)
    finally:
        executor.shutdown()
        node.destroy_node()


# Under load

STATES = [
    {'allocation.method': 'exact', 'rotors.health': [1.0, 1.0, 1.0, 0.7, 1.0, 1.0]},
    {'allocation.method': 'pseudo_inverse', 'rotors.health': [0.8, 1.0, 1.0, 1.0, 1.0, 1.0]}]
CHANGES = length(20, 40)
RATE = 200.0
"""Of the commands [Hz]."""


@pytest.mark.parametrize('mode', length(['realtime'], ['realtime', 'lockstep']))
def test_changes_under_load_are_all_or_nothing(graph, mode):
    host(graph, 'allocator', '-p', f'mode:={mode}')
    command = graph.publisher(WrenchStamped, 'command/wrench')
    speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
    parameters = graph.connect('allocator')
    wrenches, sent = some_wrenches(50), []

    def send():
        sent.append(wrenches[len(sent) % len(wrenches)])
        command.publish(wrench(sent[-1], len(sent) * 10**9))

    assert parameters.set_atomically(STATES[0]).successful
    timer = graph.node.create_timer(1.0 / RATE, send)
    for k in range(CHANGES):
        assert parameters.set_atomically(STATES[(k + 1) % 2]).successful
        before = len(speeds)
        graph.spin_until(lambda before=before: len(speeds) > before + 2, 'some answers')
    timer.cancel()
    twins = [twin(*state.values()) for state in STATES]
    answers = Counter()
    for message in speeds:
        label = message.layout.dim[1].label
        if label == 'no stamp':
            continue
        command = sent[int(label.removeprefix('stamp ')) // 10**9 - 1]
        # Which laws it has met before has an influence on the rounding of the exact method.
        [k] = [
            k for k, twin in enumerate(twins)
            if np.allclose(message.data, twin.allocate(command[2:]).speeds, rtol=0.0, atol=1e-9)]
        answers[k] += 1
    assert min(answers.values()) >= CHANGES / 2
    assert len(answers) == 2
