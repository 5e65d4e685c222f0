"""Every installed executable: its help, how it ends, and what it says of a wrong vehicle."""

import re
import signal
from importlib.metadata import entry_points
from itertools import cycle
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped

from ca_ros.bringup.options import parse
from ca_ros.nodes.executable import split
from ca_ros.vehicle.files import find
from ca_ros_cli import COMMANDS, NODES
from nodes import refused, run_all
from strategies import length

OPTIONS = dict.fromkeys(NODES, ('--vehicle', '--ros-args')) | {'bringup': (
    '--method', '--mode', '--duration', '--out', '--vehicle', '--params-file', '--namespace')}


@pytest.mark.slow
def test_the_help_of_every_executable_names_its_options():
    scripts = entry_points(group='console_scripts')
    assert [script.name for script in scripts if script.module.startswith('ca_ros')] == ['ca_ros']
    names = [name for name in COMMANDS if '-' not in name]
    for name, (code, out, err) in zip(
            names, run_all([(name, '--help') for name in names]), strict=True):
        assert (code, err) == (0, '')
        assert re.match(f'usage: (ca_ros )?{name} ', out), out
        assert not {'None', '[]'} & set(re.findall(r'default: (.*?)\)', out)), out
        options = ('--help', *OPTIONS.get(name, ()))
        assert [option for option in options if option not in out] == [], name


@pytest.mark.parametrize('number', length([signal.SIGINT], [signal.SIGINT, signal.SIGTERM]))
def test_signals_end_the_nodes_cleanly_in_full_flight(graph, number):
    nodes = [graph.start(name, '--vehicle', 'hexarotor') for name in NODES]
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
        assert (node.returncode, out) == (0, ''), err
        assert 'Traceback' not in err


@pytest.mark.parametrize('own', ['', '--vehicle x', '--vehicle info'])
def test_arguments_are_ours_or_those_of_ros(own):
    ros = '--ros-args --log-level info'
    assert split(f'{own} {ros}'.split()) == (own.split(), ros.split())
    assert split(f'{ros} -- {own}'.split()) == (own.split(), f'{ros} --'.split())


# Wrong vehicles

HEXAROTOR = find('hexarotor').read_text(encoding='utf-8')
WRONG = {
    'missing': ('mass: 1.0', '', ('vehicle.mass', 'missing')),
    'length': ('thrust_coefficient: 2.5e-5', 'thrust_coefficient: [2.5e-5, 2.5e-5]',
               ('rotors.thrust_coefficient', '6', '2')),
    'negative': ('mass: 1.0', 'mass: -1.0', ('vehicle.mass', 'positive', '-1')),
    'crossed': ('speed_min: 40.0', 'speed_min: 500.0',
                ('rotors.speed_min', '500', 'rotors.speed_max', '400')),
    'nan': ('mass: 1.0', 'mass: .nan', ('vehicle.mass', 'nan')),
    'alias': ('mass: 1.0', 'mass: &a [*a]', ('aliases', 'line'))}
"""What is replaced in the hexarotor's file, by what, and words of the error."""


@pytest.mark.slow
def test_a_wrong_vehicle_is_refused_in_one_line_by_all_that_read_it(tmp_path):
    ways = [
        *((name, '--vehicle') for name in (*OPTIONS, 'static_study', 'dynamic_study')),
        *((name, '--ros-args', '--params-file') for name in NODES)]
    # test_parameters.py and test_node_parameters.py have each fault: here each way has one.
    files = {}
    for fault, (old, new, _) in {**WRONG, 'no yaw': ('ccw', 'cw', ())}.items():
        files[fault] = str(tmp_path / f'{fault}.yaml')
        assert old in HEXAROTOR
        Path(files[fault]).write_text(HEXAROTOR.replace(old, new), encoding='utf-8')
    boat = tmp_path / 'boat.yaml'
    boat.write_text('problem: {matrix: [[1, 1]], lower: 0, upper: 1, unit: N}', encoding='utf-8')
    refused([
        (('allocator', '--vehicle', str(boat)), ['boat.yaml: problem.unit: no such entry']),
        (('bringup', '--vehicle', files['negative']), [f'bringup: {files["negative"]}: vehicle']),
        *(((*way, files[fault]), words)
          for way, (fault, (_, _, words)) in zip(ways, cycle(WRONG.items()), strict=False)),
        *(((name, '--vehicle', files['no yaw']), [
            'allocation.lost_axes: this vehicle is refused: yaw lost', 'rank 3 for 4 axes'])
          for name in ('allocator', 'controller', 'dynamic_study')),
        *(((*way, 'nope'), ['nope', 'hexarotor'])
          for way in (*((name, '--vehicle') for name in OPTIONS), ('bringup', '--params-file'))),
        *(((name, '--vehicle', 'admire'), [
            'admire.yaml: a problem without a vehicle', 'no rotors to fly with'])
          for name in ('bringup', 'controller')),
        # ROS alone would pass over both: the file's value is of another type.
        *((('allocator', '--vehicle', 'x8', '--ros-args', '-p', f'vehicle.mass:={value}'),
           ['vehicle.mass: ', 'foo']) for value in ('!!timestamp foo', 'foo'))])


WRONG_OPTIONS = [
    ('bringup', '--vehicle', 'x8', '--params-file', 'my.yaml'),
    ('bringup', '--namespace', '1 bad'), ('bringup', '--namespace', '/uav1/'),
    ('bringup', '--ros-args', '-r', 'foo'), ('fault_proxy', '--ros-args', '-r', 'foo'),
    ('allocator', '--ros-args', '--params-file', 'nope')]


@pytest.mark.slow
def test_a_wrong_option_is_refused_by_name():
    for (name, *options), (code, out, err) in zip(
            WRONG_OPTIONS, run_all(WRONG_OPTIONS), strict=True):
        assert (bool(code), out) == (True, ''), options
        assert 'Traceback' not in err, err
        last = err.splitlines()[-1]
        assert last.startswith(f'{name}: '), last
        assert any(word.strip('-') in last for word in options), last


@pytest.mark.parametrize(('options', 'words'), [
    ('--duration -1', '--duration'), ('--duration nan', '--duration'),
    ('--waypoint 1 2 inf', '--waypoint'), ('--method magic', '--method'),
    ('--method nowhere:Mine', 'nowhere:Mine: No module'), ('--method json:loads', 'not a class'),
    ('--fail 1', 'expected ROTOR@TIME'), ('--fail 1@1e300', "'1@1e300': expected a time"),
    ('--fail 1@1 --announce soon', "'soon' is neither a time"),
    ('--fail 1@1 --announce 1e300', "'1e300' is neither a time"),
    ('--fail 1@1 --announce -1', "'-1' is neither a time"),
    ('--fail 1@1 --respawn', 'not with --respawn'),
    *((f'--faults {fault}', 'argument --faults: ')
      for fault in ('drop', 'drop=0.1', 'dorp:=0.1', 'topics:=command/wrench'))])
def test_bringup_refuses_what_it_cannot_read(options, words, capsys):
    with pytest.raises(SystemExit, match='2'):
        parse(options.split())
    out, err = capsys.readouterr()
    assert out == ''
    assert err.splitlines()[-1].startswith('bringup: error: ')
    assert words in err
