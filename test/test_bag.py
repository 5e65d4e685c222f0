"""The bag of a flight, read by a reader that shares nothing with its writer."""

import json
import re
import signal
import subprocess
import sys
from collections import Counter, defaultdict
from contextlib import closing
from functools import reduce
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Imu

from ca_ros.__main__ import main
from ca_ros.bringup.bag import LOOP, RECORDED, Bag
from ca_ros.nodes.topics import (
    ANNOUNCED_HEALTH,
    EFFECTORS,
    HELD_HEALTH,
    STATE_RESTART,
    TILT_COMMAND,
    TILTS,
)
from ca_ros.testing import Graph
from ca_ros.vehicle.formats.recording import read_recording

rosbag2 = pytest.importorskip('rosbags.rosbag2', reason="needs the extra 'bag'")
typesys = pytest.importorskip('rosbags.typesys', reason="needs the extra 'bag'")
make_reader = pytest.importorskip('mcap.reader', reason="needs the extra 'test'").make_reader
DecoderFactory = pytest.importorskip('mcap_ros2.decoder').DecoderFactory

pytestmark = pytest.mark.slow

SWITCHES = (
    'simulator.publish_clock:=true', 'rotors.thrust_curve.pwm:=[1000.0, 2000.0]',
    'detector.imu_position:=[0.0, 0.0, 0.0]')
"""Parameters that switch optional topics on."""

ELSEWHERE = tuple(
    topic.name for topic in (
        EFFECTORS, TILT_COMMAND, TILTS, STATE_RESTART, ANNOUNCED_HEALTH, HELD_HEALTH))
"""Topics of problems without a vehicle, of rotors that tilt or fail, and of px4_bridge."""

LAYOUTS = Path(__file__).resolve().parent.parent / 'layouts'
DURATION = 3.0


class Recording:
    """A bag that was read: messages by topic, in their order, and what the files say of them."""

    def __init__(self, folder):
        self.folder = folder
        [file] = folder.glob('*.mcap')
        self.types, self.messages = {}, defaultdict(list)
        with file.open('rb') as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            self.summary = reader.get_summary()
            for schema, channel, _, message in reader.iter_decoded_messages():
                self.types[channel.topic] = schema.name
                self.messages[channel.topic].append(message)
        self.metadata = yaml.safe_load((folder / 'metadata.yaml').read_text(encoding='utf-8'))[
            'rosbag2_bagfile_information']
        assert self.metadata['relative_file_paths'] == [file.name]

    def by_stamp(self, topic):
        """Return the messages of a topic by their stamps [ns], the last one of each."""
        return {_stamp(message): message for message in self.messages[topic]}


def _stamp(message):
    if hasattr(message, 'header'):
        return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    # The allocator's last word, when it is ended, answers no state and has no stamp.
    word, _, number = message.layout.dim[1].label.partition(' ')
    return int(number) if word == 'stamp' else None


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    """Return the bag of a flight in lockstep, its flight.csv and what bringup said."""
    folder = tmp_path_factory.mktemp('flight')
    with Graph() as graph:
        process = graph.start(
            'bringup', '--figures', 'none',
            '--mode', 'lockstep', '--duration', str(DURATION), '--detect', '--view',
            '--out', str(folder), '--bag', str(folder / 'bag'), '--ros-args',
            *(word for value in SWITCHES for word in ('-p', value)))
        out, err = graph.outlive(process)
    assert (folder / 'flight.csv').is_file(), out + err
    table = np.genfromtxt(folder / 'flight.csv', delimiter=',', names=True)
    return Recording(folder / 'bag'), table, out


def test_every_topic_is_there_with_its_type_and_count(flight):
    recording, _, out = flight
    expected = {
        topic if topic.startswith('/') else f'/{topic}':
        f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
        for topic, kind in {**RECORDED, 'imu': Imu}.items() if topic not in ELSEWHERE}
    assert recording.types == expected
    counts = {topic: len(messages) for topic, messages in recording.messages.items()}
    counts |= {f'/{name}': 0 for name in ELSEWHERE}
    noted = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in recording.metadata['topics_with_message_count']}
    assert noted == counts
    assert recording.metadata['message_count'] == sum(counts.values())
    assert recording.summary.statistics.message_count == sum(counts.values())
    assert f'{sum(counts.values())} messages on {len(expected)} topics, none lost' in out


def test_the_type_hashes_are_those_on_the_wire(flight, graph):
    noted = {
        entry['topic_metadata']['type']: entry['topic_metadata']['type_description_hash']
        for entry in flight[0].metadata['topics_with_message_count']}
    for kind in set(RECORDED.values()):
        graph.publisher(kind, kind.__name__)
        def found(name=f'/{kind.__name__}'):
            return graph.node.get_publishers_info_by_topic(name)

        graph.spin_until(found, kind.__name__)
        [end] = found()
        assert noted[end.topic_type] == str(end.topic_type_hash)


def test_no_step_is_missing_and_the_speeds_are_those_of_the_flight(flight):
    recording, table, _ = flight
    stamps = np.round(table['t'] * 1e9).astype(int).tolist()
    assert len(stamps) == round(DURATION / 0.01) + 1
    for topic in (*LOOP, 'allocator/allocated_wrench', 'allocator/residual'):
        there = set(recording.by_stamp(f'/{topic}')) - {None}
        # A publisher may learn only after the first steps that the bag is there.
        begun = [stamp for stamp in stamps if stamp >= min(there)]
        assert len(begun) > 0.75 * len(stamps), topic
        assert set(begun) <= there, topic
    # A step is taken once; before the first one, rest is published again and again.
    often = Counter(_stamp(message) for message in recording.messages['/motor_speed'])
    assert {often[stamp] for stamp in stamps[1:]} == {1}
    speeds = recording.by_stamp('/motor_speed')
    poses = recording.by_stamp('/local_position/pose')
    for row, stamp in zip(table, stamps, strict=True):
        assert list(speeds[stamp].data) == [row[f'speed_{i + 1}'] for i in range(6)]
        assert poses[stamp].pose.position.z == row['z']


def test_the_waypoint_and_the_log_are_there(flight):
    # It is sent once more to each controller that is found after it was sent.
    waypoints = flight[0].messages['/command/pose']
    assert {waypoint.pose.position.x for waypoint in waypoints} == {1.0}
    assert {'allocator', 'controller'} <= {each.name for each in flight[0].messages['/rosout']}


# Replayed

def copied(source, path, topics, storage=rosbag2.StoragePlugin.SQLITE3):
    """Write topics of a bag into a new one, by their new names."""
    with rosbag2.Reader(source) as reader, \
            rosbag2.Writer(path, version=9, storage_plugin=storage) as writer:
        types, new = typesys.get_typestore(typesys.Stores.ROS2_JAZZY), defaultdict(list)
        for each in reader.connections:
            for name in topics(each.topic):
                new[each.topic].append(writer.add_connection(name, each.msgtype, typestore=types))
        for each, time, data in reader.messages():
            for connection in new[each.topic]:
                writer.write(connection, time, data)
    return path


def replayed(capsys, path, *words):
    code = main(['replay', str(path), 'hexarotor', *words])
    return code, ''.join(capsys.readouterr())


@pytest.mark.parametrize('storage', ['mcap', 'file', 'sqlite3'])
def test_a_bag_is_replayed_and_a_rotor_that_is_taken_from_it_is_named(
        flight, tmp_path, capsys, storage):
    folder = flight[0].folder
    [path] = folder.glob('*.mcap') if storage == 'file' else [folder]
    if storage == 'sqlite3':
        path = copied(folder, tmp_path / 'bag', lambda topic: [f'/uav1{topic}', f'/faulty{topic}'])
        assert list(path.glob('*.db3'))
    code, said = replayed(capsys, path, '--inject', '2@2')
    assert code == 0, said
    assert 'nothing is named' in said
    assert 'no specific force' not in said
    assert re.search(r'rotor 2 taken at 2 s: rotor 2 named after \d\d ms', said), said


def test_a_bag_gives_the_streams_of_the_flight(flight):
    recording, table, _ = flight
    found, steps = read_recording(recording.folder, 6), np.round(table['t'] / 0.01)
    titles = {
        'command': [f'command_{i + 1}' for i in range(6)], 'acc': [f'acc_{x}' for x in 'xyz'],
        'speed': [f'speed_measured_{i + 1}' for i in range(6)],
        'gyro': [f'gyro_{x}' for x in 'xyz'], 'velocity': [f'v{x}' for x in 'xyz'],
        'attitude': [f'q{x}' for x in 'xyzw']}
    for name, columns in titles.items():
        _, here, there = np.intersect1d(np.round(found.times[name] / 0.01), steps,
                                        return_indices=True)
        assert len(here) > 0.75 * len(steps)
        expected = np.column_stack([table[column] for column in columns])[there]
        filled = np.isfinite(expected).all(axis=1)
        assert filled.sum() > 0.75 * len(steps)
        np.testing.assert_array_equal(found.values[name][here][filled], expected[filled], name)


@pytest.mark.parametrize(('names', 'answer'), [
    (['/a{}', '/b{}'], 'command/motor_speed in 2 namespaces: expected one, not /a/, /b/'),
    (['/a{}_other'], 'command/motor_speed in 0 namespaces: expected one'),
])
def test_a_bag_without_the_commands_of_one_vehicle_is_refused(
        flight, tmp_path, capsys, names, answer):
    path = copied(flight[0].folder, tmp_path / 'bag', lambda topic: [
        name.format(topic) for name in names if topic.startswith('/command/')])
    code, said = replayed(capsys, path)
    assert code == 1
    assert answer in said


def test_a_bag_that_is_cut_is_refused(flight, tmp_path, capsys):
    path = copied(
        flight[0].folder, tmp_path / 'bag', lambda topic: [topic], rosbag2.StoragePlugin.MCAP)
    [file] = path.glob('*.mcap')
    data = file.read_bytes()
    file.write_bytes(data[:len(data) // 2])
    code, said = replayed(capsys, path)
    assert code == 1
    assert said.splitlines()[-1].startswith(f'ca_ros replay: {path}: ')


def test_a_replay_without_rosbags_names_the_extra(flight, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'rosbags.highlevel', None)
    code, said = replayed(capsys, flight[0].folder)
    assert code == 1
    assert "a bag needs rosbags: pip install rosbags, or ca_ros's extra 'bag'" in said


# Layouts

def test_the_layout_of_foxglove_shows_what_is_recorded(flight):
    layout = json.loads((LAYOUTS / 'foxglove.json').read_text(encoding='utf-8'))
    panels = layout['configById']
    assert sorted(_leaves(layout['layout'])) == sorted(panels)
    shown = set()
    for panel in panels.values():
        for path in panel.get('paths', []):
            topic, dot, field = path['value'].partition('.')
            assert _number(flight[0], topic, dot + field) is not None, path
            shown.add(topic)
        shown |= {*panel.get('topics', {}), *filter(None, [panel.get('topicToRender')])}
    assert shown <= set(flight[0].types)


def _leaves(node):
    if isinstance(node, str):
        return [node]
    return _leaves(node['first']) + _leaves(node['second'])


def test_the_layout_of_plotjuggler_shows_what_is_recorded(flight):
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    curves = [curve.get('name') for curve in root.iter('curve')]
    assert len(curves) > 20
    for curve in curves:
        [topic] = [topic for topic in flight[0].types if curve.startswith(f'{topic}/')]
        field = curve.removeprefix(topic).replace('/', '.')
        # PlotJuggler makes these three of the quaternion.
        field = re.sub(r'orientation\.(roll|pitch|yaw)$', 'orientation.w', field)
        assert _number(flight[0], topic, field) is not None, curve
    for splitter in root.iter('DockSplitter'):
        assert int(splitter.get('count')) == len(splitter) == len(splitter.get('sizes').split(';'))


def _number(recording, topic, path):
    """Return the number at a path such as .data[0] of a topic's last message."""
    steps = re.findall(r'\.(\w+)|\[(\d+)\]', path)
    return float(reduce(
        lambda value, step: getattr(value, step[0]) if step[0] else value[int(step[1])],
        steps, recording.messages[topic][-1]))


# Bags that are not to be had, or not to be finished

def test_an_interrupt_ends_all_in_its_namespace_and_leaves_a_bag_that_can_be_read(
        graph, tmp_path):
    process = graph.start(
        'bringup', '--figures', 'none',
        '--mode', 'lockstep', '--duration', '1e6', '--namespace', 'uav1',
        '--out', str(tmp_path), '--bag', str(tmp_path / 'bag'))
    poses = graph.listen(PoseStamped, '/uav1/local_position/pose')
    graph.spin_until(lambda: poses and poses[-1].pose.position.z > 0.1, 'a flight')
    own = {f'/uav1/{topic}' for topic in (*LOOP, 'command/pose')}

    def topics():
        return {name for name, _ in graph.node.get_topic_names_and_types()}

    graph.spin_until(lambda: own <= topics(), f'topics {own}')
    # The bag listens to the clock.
    common = {'/rosout', '/parameter_events', '/diagnostics', '/clock'}
    assert {name for name in topics() - common if not name.startswith('/uav1/')} == set()
    assert len(graph.alive()) == 4
    process.send_signal(signal.SIGINT)
    out, err = graph.outlive(process)
    assert process.returncode == 130, out + err
    assert 'Traceback' not in err
    assert 'SIGINT' in err
    assert graph.alive() == []
    recording = Recording(tmp_path / 'bag')
    heights = [each.pose.position.z for each in recording.messages['/uav1/local_position/pose']]
    # The recorder may be behind the flight.
    assert max(heights) > 0.0
    assert {f'/uav1/{topic}' for topic in LOOP} <= set(recording.types)


def test_a_folder_that_is_there_is_left_alone(graph, tmp_path):
    (tmp_path / 'bag').mkdir()
    process = graph.start(
        'bringup', '--out', str(tmp_path), '--bag', str(tmp_path / 'bag'))
    out, err = graph.outlive(process)
    assert (process.returncode, out) == (1, '')
    [line] = err.splitlines()
    assert line.startswith('bringup: --bag')
    assert 'exists' in line
    assert list((tmp_path / 'bag').iterdir()) == []


def test_a_bag_without_a_message_is_removed(tmp_path):
    with closing(Bag(tmp_path / 'new' / 'bag')) as bag:
        assert bag.path.is_dir()
    assert not bag.path.exists()


def test_without_rosbags_its_extra_is_named(tmp_path):
    script = (
        'import sys; sys.modules["rosbags"] = None; from ca_ros.bringup.bringup import main; '
        f'sys.exit(main(["--out", {str(tmp_path)!r}, "--bag", {str(tmp_path / "bag")!r}]))')
    run = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (1, '')
    [line] = run.stderr.splitlines()
    assert line.startswith('bringup: --bag')
    assert 'rosbags' in line
    assert "'bag'" in line
    assert not (tmp_path / 'bag').exists()
