"""Every installed executable: its help, how it ends, and what it says of a wrong vehicle."""

import math
import signal
from importlib.metadata import entry_points

import pytest
import yaml
from geometry_msgs.msg import PoseStamped

from ca_ros.nodes.executable import split
from ca_ros.vehicle.files import find

NODES = ('allocator', 'simulator', 'controller')
OPTIONS = dict.fromkeys(NODES, ('--vehicle', '--ros-args')) | {'bringup': (
    '--method', '--mode', '--duration', '--out', '--vehicle', '--params-file', '--namespace')}


def test_the_help_of_every_executable_names_its_options(graph):
    scripts = entry_points(group='console_scripts')
    names = [script.name for script in scripts if script.module.startswith('ca_ros.')]
    assert {*OPTIONS, 'benchmark', 'fault_proxy', 'report'} <= set(names)
    processes = {name: graph.start_silent(name, '--help') for name in names}
    for name, process in processes.items():
        out, err = graph.outlive(process)
        assert (process.returncode, err) == (0, '')
        assert out.startswith(f'usage: {name} '), out
        options = ('--help', *OPTIONS.get(name, ()))
        assert [option for option in options if option not in out] == [], name


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_nodes_cleanly_in_full_flight(graph, number):
    nodes = [graph.start_silent(name, '--vehicle', 'hexarotor') for name in NODES]
    waypoint = graph.publisher(PoseStamped, 'command/pose')
    poses = graph.listen(PoseStamped, 'local_position/pose')
    for name in NODES:
        graph.connect(name)
    waypoint.publish(PoseStamped())
    graph.spin_until(lambda: poses and poses[-1].pose.position.z != 0.0, 'a flight')
    for node in nodes:
        node.send_signal(number)
    for node in nodes:
        out, err = graph.outlive(node)
        assert (node.returncode, out) == (0, '')
        assert 'Traceback' not in err


@pytest.mark.parametrize('own', ['', '--vehicle x', '--vehicle info'])
def test_arguments_are_ours_or_those_of_ros(own):
    ros = '--ros-args --log-level info'
    assert split(f'{own} {ros}'.split()) == (own.split(), ros.split())
    assert split(f'{ros} -- {own}'.split()) == (own.split(), f'{ros} --'.split())


# Wrong vehicles

def missing(parameters):
    del parameters['vehicle']['mass']


def wrong_length(parameters):
    parameters['rotors']['thrust_coefficient'] = [2.5e-5] * 5


def negative(parameters):
    parameters['vehicle']['mass'] = -1.0


def crossed(parameters):
    parameters['rotors']['speed_min'] = 500.0


def not_a_number(parameters):
    parameters['rotors']['positions'][4] = math.nan


FAULTS = {
    missing: ('vehicle.mass', 'missing'),
    wrong_length: ('rotors.thrust_coefficient', '6', '5'),
    negative: ('vehicle.mass', 'positive', '-1'),
    crossed: ('rotors.speed_min', '500', 'rotors.speed_max', '400'),
    not_a_number: ('rotors.positions[4]', 'finite', 'nan'),
}


@pytest.mark.slow
@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: fault.__name__)
def test_a_wrong_vehicle_is_refused_in_one_line(graph, tmp_path, fault):
    content = yaml.safe_load(find('hexarotor').read_text(encoding='utf-8'))
    fault(content['/**']['ros__parameters'])
    file = tmp_path / 'wrong.yaml'
    file.write_text(yaml.safe_dump(content), encoding='utf-8')
    refused(graph, [
        *((name, '--vehicle', str(file)) for name in OPTIONS),
        *((name, '--ros-args', '--params-file', str(file)) for name in NODES),
    ], FAULTS[fault])


def test_a_geometry_without_yaw_is_refused_in_one_line_by_all_that_allocate(graph, tmp_path):
    content = yaml.safe_load(find('hexarotor').read_text(encoding='utf-8'))
    content['/**']['ros__parameters']['rotors']['spins'] = ['cw'] * 6
    file = tmp_path / 'wrong.yaml'
    file.write_text(yaml.safe_dump(content), encoding='utf-8')
    names = 'allocator', 'controller', 'static_study', 'dynamic_study', 'benchmark'
    refused(
        graph, [(name, '--vehicle', str(file)) for name in names],
        ['allocation.lost_axes: this vehicle is refused: yaw lost', 'rank 3 for 4 axes'])


def test_a_file_that_holds_itself_is_refused_in_one_line_by_all_that_read_it(graph, tmp_path):
    file = tmp_path / 'wrong.yaml'
    file.write_text("'/**': &a\n  ros__parameters:\n    vehicle: *a\n", encoding='utf-8')
    names = 'allocator', 'bringup', 'static_study', 'dynamic_study', 'benchmark'
    refused(
        graph, [(name, '--vehicle', str(file)) for name in names],
        ['wrong.yaml', 'aliases', 'line 3'])


def test_a_vehicle_that_is_not_there_is_refused_in_one_line(graph):
    refused(graph, [
        *((name, '--vehicle', 'nope') for name in OPTIONS),
        ('bringup', '--params-file', 'nope'),
    ], ['nope', 'hexarotor'])


WRONG_OPTIONS = [
    ('bringup', '--namespace', '1 bad'), ('bringup', '--namespace', '/uav1/'),
    ('bringup', '--duration', '-1'), ('bringup', '--duration', 'nan'),
    ('bringup', '--waypoint', '1', '2', 'inf'), ('bringup', '--method', 'magic'),
    ('bringup', '--vehicle', 'x8', '--params-file', 'my.yaml'),
    ('bringup', '--ros-args', '-r', 'foo'), ('fault_proxy', '--ros-args', '-r', 'foo'),
    ('allocator', '--ros-args', '--params-file', 'nope'),
]


def test_a_wrong_option_is_refused_by_name(graph):
    processes = [graph.start_silent(*way) for way in WRONG_OPTIONS]
    for (name, *options), process in zip(WRONG_OPTIONS, processes, strict=True):
        out, err = graph.outlive(process)
        assert process.returncode != 0, options
        assert out == '', out
        assert 'Traceback' not in err, err
        last = err.splitlines()[-1]
        assert last.startswith(f'{name}: '), last
        assert any(word.strip('-') in last for word in options), last


def test_a_wrong_value_on_the_command_line_is_refused_in_one_line(graph):
    # ROS alone would pass over both: the file's value is of another type.
    values = '!!timestamp foo', 'foo'
    refused(graph, [
        ('allocator', '--vehicle', 'x8', '--ros-args', '-p', f'vehicle.mass:={value}')
        for value in values], ['vehicle.mass: ', 'foo'])


def refused(graph, ways, words):
    """Each way ends with an exit code other than zero and one line with these words."""
    processes = [graph.start_silent(*way) for way in ways]
    for way, process in zip(ways, processes, strict=True):
        out, err = graph.outlive(process)
        assert process.returncode != 0, way
        assert out == '', out
        assert len(err.splitlines()) == 1, err
        assert err.startswith(way[0]), err
        assert [word for word in words if word not in err] == [], err
