"""Recorded flights through the detector: names, injected losses, and what is not recorded."""

import re
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from matplotlib.patches import StepPatch

from benchmarks.detection import recordings
from benchmarks.detection.conditions import FLOWN
from benchmarks.detection.flights import BEFORE, Setup, landed
from benchmarks.detection.plant import HOLDING, PERIOD, Plant
from ca_ros import Vehicle
from ca_ros.__main__ import main
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.injected_loss import _turned, without_rotor
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.detection.recorded_motion import motion_of
from ca_ros.detection.replay import Naming, replay
from ca_ros.settings import ParameterError
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.studies import replay_figure
from ca_ros.studies.cases import Case
from ca_ros.studies.replay import report
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.files import find
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.match import Match, match
from ca_ros.vehicle.plausibility import check
from ca_ros.vehicle.state import GAP, rotation_matrix
from ca_ros.vehicle.vehicle import inertia_of

UP = Waypoint.of(0.0, 0.0, 1.0, 0.0)
SETTINGS = DetectorSettings(motor_time_constant=0.05, delay=0.01)


@cache
def recorded(lost=None, name='hexarotor_realistic'):
    """Return a flight of 5 s; a rotor may be lost at 4 s, which nobody is told."""
    case = Case.load(name)
    changes = [Change(2_500_000_000, waypoint=Waypoint.of(2.0, 1.0, 2.0, 1.0))]
    if lost is not None:
        health = np.where(np.arange(case.vehicle.n) == lost, 0.0, 1.0)
        changes.append(Change(4_000_000_000, body=case.body(health)))
    flight = fly(
        case.controller(), case.allocator('exact'), case.plant(), UP, 5.0, changes=changes)
    turns = np.array([rotation_matrix(q) for q in flight.attitude])
    world = np.einsum('kij,kj->ki', turns, flight.velocity)
    gained = np.diff(world, axis=0, prepend=world[:1]) / 0.01 + [0.0, 0.0, 9.81]
    values = {
        'command': flight.speeds, 'gyro': flight.angular_velocity, 'attitude': flight.attitude,
        'velocity': flight.velocity, 'acc': np.einsum('kji,kj->ki', turns, gained)}
    return case.vehicle, Recording(dict.fromkeys(values, flight.time), values, 'flight'), flight


def without(recording, *names):
    return Recording(
        {name: each for name, each in recording.times.items() if name not in names},
        {name: each for name, each in recording.values.items() if name not in names}, 'flight')


@pytest.mark.parametrize('missing', [('acc',), ('velocity',), ('attitude', 'velocity')])
def test_a_recorded_loss_is_named(missing):
    vehicle, recording, _ = recorded(2)
    found = replay(vehicle, without(recording, *missing), SETTINGS)
    first = found.named[0]
    assert first.rotors == (2,)
    assert 4.0 < first.time < 4.4
    assert first.phase == 'flight'
    assert first.margin > 4.0
    assert len(found.notes) == len(missing)


@pytest.mark.parametrize(('name', 'withheld'), [
    ('quadrotor', True), ('hexarotor_realistic', False)])
def test_a_name_that_is_not_acted_on_says_so(name, withheld):
    vehicle, recording, _ = recorded(2, name)
    lag = SETTINGS if name != 'quadrotor' else DetectorSettings(motor_time_constant=0.0)
    found = replay(vehicle, recording, lag)
    assert (found.named[0].rotors, found.named[0].withheld) == ((2,), withheld)
    [row] = [line for line in report('it', found) if line.startswith('    4.')]
    assert row.endswith('not acted on') == withheld


def test_nothing_is_named_in_a_sound_flight_and_an_injected_loss_is():
    vehicle, recording, _ = recorded()
    recording = without(recording, 'acc')
    assert replay(vehicle, recording, SETTINGS).named == []
    motion = motion_of(vehicle, recording)
    for rotor in range(6):
        lost = without_rotor(vehicle, recording, SETTINGS, motion, rotor, 3.5)
        first = replay(vehicle, recording, SETTINGS, lost).named[0]
        assert first.rotors == (rotor,)
        assert 3.5 < first.time < 3.7


def stopped(recording, start, end):
    """Return a flight in which no state comes for some time [s]."""
    times, values = dict(recording.times), dict(recording.values)
    for name in 'attitude', 'velocity':
        kept = (times[name] <= start) | (times[name] > end)
        times[name], values[name] = times[name][kept], values[name][kept]
    return Recording(times, values, 'flight')


@pytest.mark.parametrize('make', [FailureDetector, make_detector])
@pytest.mark.parametrize(('end', 'served'), [(2.0, False), (2.9, True), (9.0, True)])
def test_the_imu_serves_alone_where_states_stop(make, end, served):
    vehicle, recording, _ = recorded()
    _, lost, _ = recorded(2)
    sound = replay(vehicle, stopped(recording, 1.8, end), SETTINGS, make=make)
    assert sound.named == []
    assert sound.notes == served * [
        'no state from 1.80 s on: gyro and accelerometer carry it on']
    assert len(sound.times) == len(recording.times['gyro']) - served * 49
    first = replay(vehicle, stopped(lost, 1.8, end), SETTINGS, make=make).named[0]
    assert first.rotors == (2,)
    assert 4.0 < first.time < 4.4


def test_what_is_carried_on_is_near_the_states_that_did_not_come():
    vehicle, recording, _ = recorded()
    carried = motion_of(vehicle, stopped(recording, 1.8, 9.0))
    known = motion_of(vehicle, recording)
    at = np.searchsorted(known.times, carried.times[-1])
    # It flies 2 m to the side, and turns by 1 rad.
    between = abs(carried.attitude[-1].dot(known.attitude[at]))
    assert 2.0 * np.arccos(min(between, 1.0)) < 0.2
    assert abs(known.attitude[at][2]) > 0.2


def test_an_injected_loss_moves_the_vehicle_as_a_real_one():
    vehicle, recording, _ = recorded()
    _, lost, _ = recorded(2)
    motion = without_rotor(
        vehicle, recording, SETTINGS, motion_of(vehicle, recording), 2, 4.0)
    # Until the controller reacts; gusts are the same.
    after = np.searchsorted(motion.times, 4.06)
    np.testing.assert_allclose(
        motion.gyro[after], lost.values['gyro'][after], rtol=0.3, atol=0.1)
    assert abs(lost.values['gyro'][after] - recording.values['gyro'][after]).max() > 1.5


def test_an_injected_loss_takes_the_torque_of_the_rotor_alone_however_fast_the_vehicle_turns():
    vehicle, recording, _ = recorded()
    sound = motion_of(vehicle, recording)
    lost = without_rotor(vehicle, recording, SETTINGS, sound, 2, 3.0)
    inertia, own = inertia_of(vehicle), rotor_wrenches(vehicle)[3:, 2]
    torques = []
    for motion in sound, lost:
        times, gyro = motion.times[310:400], motion.gyro[310:401]
        mean = 0.5 * (gyro[1:] + gyro[:-1])
        change = np.diff(gyro, axis=0) / np.median(np.diff(times))
        torques.append(change @ inertia + np.cross(mean, mean @ inertia))
    missing = torques[0] - torques[1]
    across = missing - np.outer(missing @ own, own) / own.dot(own)
    assert abs(lost.gyro[400]).max() > 8.0
    assert abs(across).max() < 0.1 * abs(missing).max()


def test_a_vehicle_without_torques_turns_on_with_its_energy():
    # It turns at 35 rad/s; beside it, the recorded one is at rest.
    inertia, rest = np.diag([0.037, 0.030, 0.015]), np.zeros(3)
    turned = np.array([20.0, -20.0, 20.0])
    energy = turned @ inertia @ turned
    momentum = np.linalg.norm(inertia @ turned)
    for _ in range(200):
        turned = turned + _turned(inertia, rest, rest, turned, rest, 0.01)
    np.testing.assert_allclose(turned @ inertia @ turned, energy, rtol=0.01)
    np.testing.assert_allclose(np.linalg.norm(inertia @ turned), momentum, rtol=0.01)


def test_a_loss_is_injected_however_many_commands_are_recorded():
    vehicle, recording, _ = recorded()
    times = recording.times['command']
    often = Recording(
        {**recording.times, 'command': np.concatenate([times, times + 3e-3, times + 6e-3])},
        {**recording.values, 'command': np.tile(recording.values['command'], (3, 1))}, 'often')
    order = np.argsort(often.times['command'])
    for each in (often.times, often.values):
        each['command'] = each['command'][order]
    motion = motion_of(vehicle, recording)
    once, thrice = (
        without_rotor(vehicle, each, SETTINGS, motion, 2, 1.0) for each in (recording, often))
    assert abs(once.gyro - motion.gyro[:len(once.gyro)]).max() > 0.5
    np.testing.assert_allclose(thrice.gyro, once.gyro, atol=1e-2)


@cache
def turning(lost=None):
    """Return a flight of 10 s that rolls and pitches; a rotor may be lost at 8 s."""
    case, rng = Case.load('hexarotor_realistic'), np.random.default_rng(1)
    changes = [
        Change(round(1e9 * t), waypoint=Waypoint.of(*rng.uniform(0.0, 2.0, 3), 0.0))
        for t in np.arange(1.0, 9.5, 1.0)]
    if lost is not None:
        health = np.where(np.arange(6) == lost, 0.0, 1.0)
        changes.append(Change(8_000_000_000, body=case.body(health)))
    flight = fly(
        case.controller(), case.allocator('exact'), case.plant(), UP, 10.0, changes=changes)
    values = {
        'command': flight.speeds, 'gyro': flight.angular_velocity, 'attitude': flight.attitude,
        'velocity': flight.velocity}
    return case.vehicle, Recording(dict.fromkeys(values, flight.time), values, 'flight'), flight


@pytest.mark.parametrize('lost', [None, 2])
def test_a_flight_fits_the_file_of_its_vehicle_also_if_a_rotor_is_lost(lost):
    vehicle, recording, _ = turning(lost)
    for lag, delay in ((0.05, 0.01), (0.0, 0.0)):
        assert match(vehicle, recording, lag, delay, 1.0) == Match('', True)


def test_a_flight_of_another_vehicle_is_told():
    vehicle, recording, _ = turning()
    commands = recording.values['command']
    turned = recording.with_stream('command', commands[:, [3, 4, 5, 0, 1, 2]])
    fault = match(vehicle, turned, 0.05, 0.01, 1.0).fault
    assert fault.startswith('roll, pitch, yaw against the commands (correlation -0.99, -0.99')
    heavy = replace(vehicle, inertia=4.0 * vehicle.inertia)
    fault = match(heavy, recording, 0.05, 0.01, 1.0).fault
    assert re.search('roll with [34].. % of the angular acceleration that the file', fault)
    fault = match(vehicle, recording, 0.05, 0.01, 3.0).fault
    assert fault == 'in the air 300 % of the thrust that carries the weight'


def test_a_vehicle_that_hardly_moves_does_not_show_that_the_file_fits():
    vehicle, recording, _ = turning()
    noise = np.random.default_rng(0).normal(0.0, 0.01, recording.values['gyro'].shape)
    assert match(vehicle, recording.with_stream('gyro', noise), 0.05, 0.01, 1.0) == Match()
    short = Recording(
        {name: each[:500] for name, each in recording.times.items()},
        {name: each[:500] for name, each in recording.values.items()})
    assert match(vehicle, short, 0.05, 0.01, 1.0) == Match()


def test_a_loss_is_not_injected_where_the_file_is_of_another_vehicle(tmp_path, capsys):
    turning()[2].write_csv(tmp_path / 'flight.csv')
    command = ['replay', str(tmp_path / 'flight.csv')]
    assert main([*command, 'hexarotor_realistic', '--inject', '2@5']) == 0
    out = capsys.readouterr().out
    assert re.search('^rotor 2 taken at 5 s: rotor 2 named after .. ms$', out, re.MULTILINE)
    text = find('hexarotor_realistic').read_text()
    (tmp_path / 'other.yaml').write_text(re.sub('inertia: .*', 'inertia: [0.1, 0.1, 0.2]', text))
    assert main([*command, str(tmp_path / 'other.yaml')]) == 0
    assert 'is it the file of this vehicle, with order and' in capsys.readouterr().out
    assert main([*command, str(tmp_path / 'other.yaml'), '--inject', '2@5']) == 1
    assert 'expected the file of the vehicle that flew' in capsys.readouterr().err


def test_the_command_reads_a_flight_and_the_settings_of_the_vehicle(tmp_path, capsys):
    file = tmp_path / 'flight.csv'
    recorded(2)[2].write_csv(file)
    figure = tmp_path / 'minute.png'
    words = [str(file), 'hexarotor_realistic', '--inject', '5@3.5', '--figure', str(figure)]
    assert main(['replay', *words]) == 0
    out = capsys.readouterr().out
    assert 'no specific force' in out
    assert 'rotor 5 taken at 3.5 s: rotor 5 named after' in out
    assert any(line.split()[1:3] == ['flight', '3'] for line in out.splitlines() if '.' in line)
    assert figure.stat().st_size > 1000
    for text in ('7@1', '0@1', '1', '1@x', '1@-1'):
        assert main(['replay', *words[:2], '--inject', text]) == 1
        assert f'--inject {text}: expected ROTOR@T' in capsys.readouterr().err


def test_the_figure_has_rows_phases_names_and_injections(tmp_path):
    vehicle, recording, _ = recorded(2)
    recording = without(recording, 'acc')
    motion = motion_of(vehicle, recording)
    found = replay(vehicle, recording, SETTINGS, motion)
    lost = replay(
        vehicle, recording, SETTINGS, without_rotor(vehicle, recording, SETTINGS, motion, 4, 3.0))
    figure = replay_figure.figure_of(found, [(4, 3.0, lost)])
    body = figure.subfigs[1]
    axes, = body.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        'disturbance', *(f'rotor {i}' for i in range(6, 0, -1))]
    legend = {each.get_text() for each in figure.subfigs[0].legends[0].get_texts()}
    assert {'as recorded', 'rotor taken', 'named', 'launch', 'flight'} <= legend
    first = next(each for each in lost.named if each.time >= 3.0)
    words = [text.get_text() for text in axes.texts]
    assert words[0] == f'{found.named[0].time:.1f} s'
    assert words[-1] == f'+{1e3 * (first.time - 3.0):.0f} ms'
    # The spike of 10 ms of rotor 5, in its row, is as high as its probability.
    spikes = [patch.get_path().vertices for patch in axes.patches if isinstance(patch, StepPatch)]
    assert max(each[:, 1].max() for each in spikes if each[:, 1].min() == 2.0) > 2.5


def test_what_cannot_be_replayed_is_refused(tmp_path, capsys):
    vehicle = Vehicle.load('hexarotor')
    time = np.linspace(0.0, 3.0, 301)
    np.savez(tmp_path / 'flight.npz', t=time, command=np.full((301, vehicle.n), 250.0),
             gyro=np.zeros((301, 3)))
    assert main(['replay', str(tmp_path / 'flight.npz'), 'hexarotor']) == 1
    assert 'expected a velocity (vx, vy, vz), or a specific' in capsys.readouterr().err
    # Before anything is read.
    assert main(['replay', 'none.npz', 'hexarotor', '--figure', 'a.txt']) == 1
    answer = '--figure a.txt: expected a name that ends with .png, .svg, .pdf'
    assert answer in capsys.readouterr().err
    (tmp_path / 'folder.png').mkdir()
    for name, fault in (
            (f'{tmp_path}/folder.png', 'Is a directory'), ('/proc/a.png', 'No such file'),
            ('none/a.png', 'No such file or directory')):
        assert main(['replay', 'none.npz', 'hexarotor', '--figure', name]) == 1
        assert f'--figure {name}: {fault}' in capsys.readouterr().err
    # Nothing is written before the figure.
    (tmp_path / 'old.png').write_bytes(b'old')
    for name in ('old', 'new'):
        assert main(['replay', 'none.npz', 'hexarotor', '--figure', f'{tmp_path}/{name}.png']) == 1
        assert 'none.npz' in capsys.readouterr().err
    assert (tmp_path / 'old.png').read_bytes() == b'old'
    assert not (tmp_path / 'new.png').exists()
    link = tmp_path / 'link.png'
    link.symlink_to(tmp_path / 'new.png')
    assert main(['replay', 'none.npz', 'hexarotor', '--figure', str(link)]) == 1
    assert link.is_symlink()
    assert not (tmp_path / 'new.png').exists()


@pytest.mark.parametrize('spoil', [
    lambda content: b'', lambda content: b'hello', lambda content: content[: len(content) // 2],
    lambda content: content[:200] + bytes(50) + content[250:]])
def test_a_damaged_file_is_refused(spoil, tmp_path, capsys):
    file = tmp_path / 'flight.npz'
    np.savez(file, t=np.arange(99.0), gyro=np.zeros((99, 3)))
    file.write_bytes(spoil(file.read_bytes()))
    assert main(['replay', str(file), 'hexarotor']) == 1
    words = f'ca_ros replay: {file}: damaged, or no npz file of numbers\n'
    assert capsys.readouterr().err.endswith(words)


@pytest.mark.parametrize(('name', 'content'), [
    ('bag/metadata.yaml', b'a: ['), ('bag/metadata.yaml', b'a'), ('a.mcap', b'a'),
    ('b.mcap', b'\x89MCAP0\r\n' + bytes([1] * 200)), ('a.db3', b'a'), ('a.csv', b'\xff'),
    ('b.csv', b't,gyro_x\n"' + b'a' * 200000)])
def test_one_line_says_that_a_flight_is_damaged(name, content, tmp_path, capsys):
    if not name.endswith('.csv'):
        pytest.importorskip('rosbags', reason="needs the extra 'bag'")
    (tmp_path / 'bag').mkdir()
    (tmp_path / name).write_bytes(content)
    given = tmp_path / name.removesuffix('/metadata.yaml')
    assert main(['replay', str(given), 'hexarotor_realistic']) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'ca_ros replay: {given}: cannot be read as a flight: ')


@pytest.mark.parametrize('command', ['replay', 'identify'])
def test_rotors_that_tilt_are_refused(command, tmp_path, capsys):
    recorded()[2].write_csv(tmp_path / 'flight.csv')
    assert main([command, str(tmp_path / 'flight.csv'), 'hexarotor_tilting']) == 1
    [*_, line] = capsys.readouterr().err.splitlines()
    assert 'rotors.tilt_axes: a recorded flight has no tilt angles' in line


@pytest.mark.parametrize('command', ['replay', 'identify'])
def test_a_flight_of_one_row_is_refused(command, tmp_path, capsys):
    _, recording, _ = recorded()
    file = tmp_path / 'flight.npz'
    np.savez(file, t=[0.0], **{name: each[:1] for name, each in recording.values.items()})
    assert main([command, str(file), 'hexarotor_realistic']) == 1
    words = 'flight.npz: command: 1 of 1 rows have a value: expected two or more'
    assert words in capsys.readouterr().err


def test_commands_in_turns_a_second_are_said_once():
    vehicle, recording, _ = recorded()
    slow = recording.with_stream('command', recording.values['command'] / (2.0 * np.pi))
    motion = motion_of(vehicle, slow)
    for _ in range(2):
        found = replay(vehicle, slow, SETTINGS, motion, make_detector)
        [note] = found.notes
        assert re.fullmatch('command: in the air at most .* %.* rev/s, .* by 2 pi', note)


@pytest.mark.parametrize(('stream', 'value', 'answer'), [
    ('velocity', 1e12, 'velocity: row 101, t 1: [1000000000000.0, '),
    ('gyro', 1e5, 'gyro: row 101, t 1: [100000.0, '),
    ('velocity', np.inf, 'velocity: row 101, t 1: [inf, '),
    ('attitude', 0.0, 'attitude: row 101, t 1: [0.0, 0.0, 0.0, 0.0]: expected a quaternion that'),
    ('t', 1e3, 't: steps of 10 s in the median: expected seconds'),
])
def test_what_cannot_be_is_named_with_file_and_row(stream, value, answer, tmp_path, capsys):
    _, recording, _ = recorded()
    values = {name: each.copy() for name, each in recording.values.items() if name != 'acc'}
    times = recording.times['gyro'] * (value if stream == 't' else 1.0)
    if stream != 't':
        values[stream][100, :1 if value else 4] = value
    np.savez(tmp_path / 'flight.npz', t=times, **values)
    assert main(['replay', str(tmp_path / 'flight.npz'), 'hexarotor_realistic']) == 1
    assert f'flight.npz: {answer}' in capsys.readouterr().err


def test_a_gap_is_said_and_not_flown():
    vehicle, recording, _ = recorded()
    times = recording.times['gyro'].copy()
    times[200:] += 30.0
    apart = Recording(dict.fromkeys(recording.values, times), recording.values, 'flight')
    found = replay(vehicle, without(apart, 'acc'), SETTINGS)
    assert 4.8 < found.in_air < 5.0
    assert found.notes[0] == (
        'command, gyro, attitude, velocity: nothing from 1.99 s on, for 30.01 s')


def test_a_clock_that_is_set_in_flight_is_refused(tmp_path, capsys):
    _, recording, _ = recorded()
    times = recording.times['gyro'] + 1.7e9 * (recording.times['gyro'] > 2.0)
    values = {name: each for name, each in recording.values.items() if name != 'acc'}
    np.savez(tmp_path / 'flight.npz', t=times, **values)
    assert main(['replay', str(tmp_path / 'flight.npz'), 'hexarotor_realistic']) == 1
    assert 'was its clock set meanwhile?' in capsys.readouterr().err


@pytest.mark.parametrize(('share', 'notes'), [(0.98, 0), (1.02, 1)])
def test_a_gap_is_said_where_the_observer_does_not_continue(share, notes):
    vehicle, recording, _ = recorded()
    times = recording.times['gyro'].copy()
    times[200:] += share * GAP / 1e9 - 0.01
    apart = Recording(dict.fromkeys(recording.values, times), recording.values, 'flight')
    assert len(motion_of(vehicle, apart).notes) == notes


def degrees(values):
    values['gyro'] = np.degrees(values['gyro'])


def millimetres(values):
    values['velocity'] = 1e3 * values['velocity']


def world(values):
    values['velocity'] = np.array([
        rotation_matrix(q) @ v
        for q, v in zip(values['attitude'], values['velocity'], strict=True)])


def scalar_first(values):
    values['attitude'] = np.roll(values['attitude'], 1, axis=1)


def to_body(values):
    values['attitude'] = values['attitude'] * [-1, -1, -1, 1]


def in_g(values):
    values['acc'] = values['acc'] / 9.81


def other_frame(values):
    for name in ('gyro', 'velocity', 'acc'):
        values[name] = values[name] * [1, -1, -1]
    values['attitude'] = values['attitude'] * [1, -1, -1, 1]


def rpm(values):
    values['command'] = values['command'] * 30.0 / np.pi


@pytest.mark.parametrize(('spoil', 'acc', 'answer'), [
    (degrees, False, 'gyro: .* read as deg/s .*: expected rad/s'),
    (millimetres, False, 'velocity: .* read as mm/s .*: expected m/s in the body frame'),
    (world, True, 'velocity: .* read as of the world frame'),
    (scalar_first, False, 'attitude: .* read as w, x, y, z'),
    (to_body, True, 'attitude: .* read as world to body'),
    (in_g, True, 'acc: .* read as g'),
    (other_frame, True, 'acc: .* read as of the other --frame'),
    (rpm, False, 'command: 30.. of 30.. are beyond .*: expected rad/s; if these are rpm'),
])
def test_units_and_frames_that_cannot_be_are_named(spoil, acc, answer):
    vehicle, recording, _ = recorded()
    if not acc:
        recording = without(recording, 'acc')
    motion_of(vehicle, recording)
    values = dict(recording.values)
    spoil(values)
    with pytest.raises(ParameterError, match=f'^flight: {answer}'):
        motion_of(vehicle, Recording(recording.times, values, 'flight'))


def test_a_velocity_of_the_world_frame_is_told_without_an_accelerometer():
    setup = Setup.load('hexarotor')
    truth, mission = FLOWN['aggressive'].draw(setup.model, np.random.default_rng(4001), 16.0)
    rows = Plant(setup.model, truth, mission, 4001).fly(16.0)
    values = {
        'command': rows['command'][:, :6], 'gyro': rows['rates'], 'attitude': rows['attitude'],
        'velocity': rows['velocity']}
    times = dict.fromkeys(values, rows['time'] / 1e9)
    motion_of(setup.vehicle, Recording(times, values, 'flight'))
    world(values)
    with pytest.raises(ParameterError, match=r'velocity: .* read as of the world frame'):
        motion_of(setup.vehicle, Recording(times, values, 'flight'))


@pytest.mark.parametrize('condition', ['usual', 'aggressive'])
def test_a_gyro_in_degrees_is_told_without_an_attitude(condition):
    setup = Setup.load('hexarotor')
    truth, mission = FLOWN[condition].draw(setup.model, np.random.default_rng(4001), 16.0)
    rows = Plant(setup.model, truth, mission, 4001).fly(16.0)
    values = {'command': rows['command'][:, :6], 'gyro': rows['rates']}
    times = dict.fromkeys(values, rows['time'] / 1e9)
    assert not check(setup.vehicle, Recording(times, values, 'flight'))
    degrees(values)
    with pytest.raises(ParameterError, match=r'gyro: .* read as deg/s .*: expected rad/s'):
        check(setup.vehicle, Recording(times, values, 'flight'))


def test_what_no_other_reading_explains_is_said():
    vehicle, recording, _ = recorded()
    values = recording.values['acc'].copy()
    values[250:] *= -1.0
    found = motion_of(vehicle, recording.with_stream('acc', values))
    assert re.fullmatch('acc: 1[89].* m/s.2 away from what the other streams say', found.notes[0])


def thinned(recording, name, kept):
    times, values = dict(recording.times), dict(recording.values)
    times[name], values[name] = times[name][kept], values[name][kept]
    return Recording(times, values, 'flight')


@pytest.mark.parametrize(('name', 'kept', 'air', 'note'), [
    ('command', lambda t: (t < 1.5) | (t > 3.0), 3.5, 'nothing from 1.49 s on, for 1.52 s'),
    ('command', lambda t: t < 3.0, 3.0, 'nothing from 2.99 s on, for 2.01 s'),
    ('attitude', lambda t: t < 2.0, 2.0, 'nothing from 1.99 s on, for 3.01 s'),
    ('velocity', lambda t: np.arange(len(t)) % 20 == 0, 4.8,
     '5 values a second: below 25 a loss may not be named'),
])
def test_what_is_missing_is_said_and_not_flown(name, kept, air, note):
    vehicle, recording, _ = recorded()
    times = recording.times[name]
    spoiled = thinned(without(recording, 'acc'), name, kept(times - times[0]))
    found = replay(vehicle, spoiled, SETTINGS)
    assert found.notes[0] == f'{name}: {note}'
    assert found.in_air == pytest.approx(air, abs=0.1)
    assert 0.0 < found.testing <= found.in_air


@pytest.mark.parametrize('name', ['attitude', 'velocity', 'gyro', 'acc'])
@pytest.mark.parametrize(('last', 'said'), [(298, False), (300, True)])
def test_a_stream_that_is_frozen_in_the_air_is_said(name, last, said):
    vehicle, recording, _ = recorded()
    values = recording.values[name].copy()
    values[200 : last + 1] = values[200]
    found = motion_of(vehicle, recording.with_stream(name, values))
    assert found.notes == said * [f'{name}: does not change from 2.00 s on, and for 1.00 s in all']
    # What stands on the ground does not move.
    commands = 0.1 * recording.values['command']
    grounded = recording.with_stream('command', commands).with_stream(name, values)
    assert not any('does not change' in note for note in motion_of(vehicle, grounded).notes)


def test_measured_speeds_are_said_not_to_be_used():
    vehicle, recording, _ = recorded()
    speeds = {'speed': recording.values['command']}
    with_speeds = Recording(
        recording.times | {'speed': recording.times['command']}, recording.values | speeds, 'it')
    assert motion_of(vehicle, with_speeds).notes == [
        'measured speeds are not used: losses are tested by commands']


def test_commands_that_are_clipped_are_counted():
    vehicle, recording, _ = recorded()
    values = recording.values['command'].copy()
    values[100:150, 2] = 1000.0
    found = motion_of(vehicle, recording.with_stream('command', values))
    assert found.notes == [
        'command: 50 of 3006 are beyond rotors.speed_max and taken as it, in 0.50 s']


def test_nothing_named_says_how_long_was_tested(tmp_path, capsys):
    _, recording, flight = recorded()
    file = tmp_path / 'flight.csv'
    flight.write_csv(file)
    assert main(['replay', str(file), 'hexarotor_realistic']) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert re.fullmatch('losses were tested for 4.[45] s: nothing is named', last)
    short = {name: each[:45] for name, each in recording.values.items()}
    np.savez(tmp_path / 'short.npz', t=recording.times['gyro'][:45], **short)
    assert main(['replay', str(tmp_path / 'short.npz'), 'hexarotor_realistic']) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == 'nothing was tested, so nothing can be named'


class NamesAt:
    """A detector that names rotor 1 at given times [ns], and otherwise sees what ours does."""

    def __init__(self, times, *given):
        self.times, self.detector, self.now = times, make_detector(*given), 0

    def __getattr__(self, name):
        return getattr(self.detector, name)

    def observe(self, time, *state):
        self.detector.observe(time, *state)
        self.now = time
        return time in self.times

    @property
    def health(self):
        return np.where(np.arange(6) == 0, float(self.now not in self.times), 1.0)


def test_a_name_at_a_contact_belongs_to_the_landing():
    setup = Setup.load('hexarotor')
    truth, mission = FLOWN['landings'].draw(setup.model, np.random.default_rng(4001), 90.0)
    rows = Plant(setup.model, truth, mission, 4001).fly(90.0)
    times = rows['time'] / 1e9
    values = {
        'command': rows['command'][:, :6], 'gyro': rows['rates'], 'attitude': rows['attitude'],
        'velocity': rows['velocity']}
    recording = Recording(dict.fromkeys(values, times), values, 'flight')
    # The vehicle does not come to stand after the last one.
    contacts = [begin + round(BEFORE / PERIOD) for begin, _ in landed(rows)][:-1]
    cruise = np.flatnonzero(rows['mode'] == HOLDING)[::200].tolist()
    at = {round(1e9 * (times[i] - times[0])): i for i in contacts + cruise}
    found = replay(setup.vehicle, recording, setup.detector().settings,
                   make=partial(NamesAt, set(at)))
    phases = {at[round(1e9 * each.time)]: each.phase for each in found.named}
    assert len(contacts) >= 4
    assert [phases[i] for i in contacts] == ['landing'] * len(contacts)
    assert 'landing' not in [phases[i] for i in cruise if i in phases]


def test_a_loss_that_cannot_be_named_in_time_says_why(tmp_path, capsys):
    flight = tmp_path / 'flight.csv'
    recorded()[2].write_csv(flight)
    command = ['replay', str(flight), 'hexarotor_realistic', '--inject']
    for text in ('2@1000', '2@5'):
        assert main([*command, text]) == 1
        assert f'--inject {text}: expected a time before the end, ' in capsys.readouterr().err
    # Nobody reacts in a recording: it would turn at 40 rad/s when the tests begin.
    for text in ('2@0', '1@0.4'):
        assert main([*command, text]) == 1
        assert re.search(f'--inject {text}: nothing is tested then, but from 0.[45]. s on',
                         capsys.readouterr().err)
    _, recording, _ = recorded()
    idle = recording.with_stream('command', recording.values['command'].copy())
    idle.values['command'][398:403] *= 0.5
    np.savez(tmp_path / 'idle.npz', t=idle.times['gyro'], **without(idle, 'acc').values)
    words = [str(tmp_path / 'idle.npz'), 'hexarotor_realistic', '--inject', '2@4']
    assert main(['replay', *words]) == 1
    assert re.search('--inject 2@4: the commands carry 2. % of the weight then: expected a time '
                     'in flight', capsys.readouterr().err)
    main([*command, '2@3.5', '--inject', '2@4.98'])
    tested, late = capsys.readouterr().out.splitlines()[-2:]
    unsure = '; the motion does not show that the file fits'
    assert re.fullmatch(f'rotor 2 taken at 3.5 s: rotor 2 named after .. ms{unsure}', tested)
    assert re.fullmatch(
        'rotor 2 taken at 4.98 s: not named within 0.0[12] s; then nothing is recorded'
        f'{unsure}', late)


@pytest.mark.parametrize(('line', 'answer'), [
    ('motor_time_constnt: 0.05', 'detector.motor_time_constnt: no such parameter (did you mean '
     'detector.motor_time_constant?)'),
    ('false_alarms: 0.1', 'detector.false_alarms: no such parameter or value any more'),
])
def test_settings_are_checked_as_by_the_monitor(line, answer, tmp_path, capsys):
    flight, vehicle = tmp_path / 'flight.csv', tmp_path / 'vehicle.yaml'
    recorded()[2].write_csv(flight)
    text = find('hexarotor_realistic').read_text()
    vehicle.write_text(text.replace('detector:', f'detector:\n      {line}'))
    assert main(['replay', str(flight), str(vehicle)]) == 1
    assert answer in capsys.readouterr().err
    assert recordings.main([str(flight), str(vehicle)]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert answer in line


@pytest.mark.parametrize(('vehicle', 'warned'), [('hexarotor', 1), ('hexarotor_realistic', 0)])
def test_a_lag_that_is_not_given_is_warned_of(vehicle, warned, tmp_path, capsys):
    recorded()[2].write_csv(tmp_path / 'flight.csv')
    assert main(['replay', str(tmp_path / 'flight.csv'), vehicle]) == 0
    assert capsys.readouterr().err.count('detector.motor_time_constant: taken as 0') == warned


def test_many_flights_give_a_row_of_the_page(tmp_path, capsys):
    _, sound, _ = recorded()
    _, failed, _ = recorded(2)
    files = []
    for name, recording in (('sound', sound), ('failed', failed)):
        streams = {f't_{stream}': times for stream, times in recording.times.items()}
        files.append(str(tmp_path / f'{name}.npz'))
        np.savez(files[-1], **streams, **recording.values)
    assert recordings.main([*files, 'hexarotor_realistic']) == 0
    _, named, row = capsys.readouterr().out.splitlines()
    assert 'flight 4.' in named
    assert re.search(r' s 3\b', named)
    assert '2 flights' in row
    # The rotor that is lost for good is named again after each reset.
    assert re.search('launch 0, flight [1-9], landing 0; warnings of the lag: 0, '
                     'of another vehicle: 0', row)
    assert recordings.main([files[0], 'hexarotor_realistic', '--losses']) == 0
    assert 'losses named right 12/12' in capsys.readouterr().out


def test_an_arm_of_which_one_rotor_has_failed_has_the_names_of_both():
    named = Naming(1.0, (0, 1, 4, 6, 7), ((1, 2), (7, 8)), (0.5,) * 5, 9.0, 'flight')
    assert named.words == '1 or 2, 5, 7 or 8'
