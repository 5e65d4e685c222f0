"""Identification: what a simulated vehicle is made of comes back from its flight."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ca_ros import Exact, ParameterError, Vehicle
from ca_ros.__main__ import main
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import Case
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.edited_yaml import with_values
from ca_ros.vehicle.formats.recording import Recording, read_recording
from ca_ros.vehicle.identification import identify, speeds_of
from strategies import length

STEP = 0.004  # [s]
LAG, DELAY, THRUST = 0.05, 0.02, 1.2
INERTIA = {'roll': 0.75, 'pitch': 1.3, 'yaw': 1.0}  # over that of the file


@cache
def flown(name, seconds=16.0, seed=0):
    """Return a vehicle and its flight, with a rate controller that follows random rates."""
    vehicle, rng = Vehicle.load(name), np.random.default_rng(seed)
    wrenches, allocator = rotor_wrenches(vehicle), Exact(vehicle)
    inertia = np.diag(np.diag(vehicle.inertia) * [*INERTIA.values()])
    steps = int(seconds / STEP)
    speeds = allocator.allocate([vehicle.weight, 0, 0, 0]).speeds
    given = np.tile(speeds, (steps, 1))
    rates, gyro, acc = np.zeros(3), np.zeros((steps, 3)), np.zeros((steps, 3))
    noise = rng.normal(size=(steps, 6)) * np.repeat([0.01, 0.2], 3)
    wanted, lift = np.zeros(3), vehicle.weight
    for k in range(steps):
        if k % 40 == 0:
            wanted = rng.normal(size=3) * [0.6, 0.6, 0.4]
            lift = vehicle.weight * (1.0 + 0.1 * rng.normal())
        if k % 2 == 0:
            torque = 12.0 * np.diag(vehicle.inertia) * (wanted - rates)
            given[k:] = allocator.allocate([lift, *torque]).speeds
        delayed = given[max(0, k - round(DELAY / STEP))]
        before = speeds
        speeds = speeds + (1.0 - np.exp(-STEP / LAG)) * (delayed - speeds)
        wrench = THRUST * wrenches @ vehicle.thrusts((before + speeds) / 2.0)
        gyro[k], acc[k] = rates + noise[k, :3], wrench[:3] / vehicle.mass + noise[k, 3:]
        turning = wrench[3:] - np.cross(rates, inertia @ rates)
        rates = rates + STEP * np.linalg.solve(inertia, turning)
    time = STEP * np.arange(steps)
    values = {'command': given, 'gyro': gyro, 'acc': acc}
    return vehicle, Recording(dict.fromkeys(values, time), values, 'flight')


def close(estimate, value, share):
    assert not estimate.fault, estimate
    # An interval of 95 % misses one of 20 values: a share of the value beside it.
    assert estimate.low - share * value <= value <= estimate.high + share * value, estimate


@pytest.mark.parametrize('name', length(['hexarotor'], ['hexarotor', 'x8', 'octorotor']))
def test_a_simulated_vehicle_comes_back(name):
    vehicle, recording = flown(name)
    found = identify(vehicle, [recording])
    close(found.lag, LAG, 0.005)
    close(found.delay, DELAY, 0.01)
    close(found.total, LAG + DELAY, 0.002)
    for axis, factor in INERTIA.items():
        close(found.effectiveness[axis], THRUST / factor, 0.002)
    close(found.effectiveness['thrust'], THRUST, 0.01)
    assert found.noise == pytest.approx(0.01, rel=0.1)
    wanted = np.diag(vehicle.inertia) * [*INERTIA.values()]
    np.testing.assert_allclose(found.parameters['vehicle.inertia'], wanted, rtol=0.04)
    assert found.parameters['rotors.thrust_coefficient'] == pytest.approx(
        THRUST * vehicle.thrust_coefficient[0], rel=0.02)


def held(estimate, value):
    return estimate.low <= value <= estimate.high


def test_intervals_hold_as_often_as_they_say():
    # Seven numbers a flight; of 24 flights (seeds 0 to 23) 160 of 168 are held, 95 %.
    seeds = length(range(3), range(24))
    inside = []
    for seed in seeds:
        vehicle, recording = flown('hexarotor', seed=seed)
        found = identify(vehicle, [recording])
        pairs = [(found.lag, LAG), (found.delay, DELAY), (found.total, LAG + DELAY), (
            found.effectiveness['thrust'], THRUST)]
        pairs += [(found.effectiveness[axis], THRUST / INERTIA[axis]) for axis in INERTIA]
        inside += [held(*pair) for pair in pairs]
        # What holds everything says nothing.
        for axis in INERTIA:
            width = found.effectiveness[axis].high - found.effectiveness[axis].low
            assert width < 0.01 * found.effectiveness[axis].value
    assert np.mean(inside) > 0.85


def test_what_cannot_be_is_refused_and_what_is_missing_is_said(tmp_path, capsys):
    vehicle, recording = flown('hexarotor')
    spoiled = recording.with_stream('acc', recording.values['acc'] / 9.81)
    with pytest.raises(ParameterError, match=r'flight: acc: .* read as g'):
        identify(vehicle, [spoiled])
    time = recording.times['command']
    kept = (time < 5.0) | (time > 7.0)
    np.savez(tmp_path / 'flight.npz', **recording.values | {
        'command': recording.values['command'][kept], 't_command': time[kept], 't': time})
    main(['identify', str(tmp_path / 'flight.npz'), 'hexarotor'])
    assert 'command: nothing from 5.00 to 7.00 s' in capsys.readouterr().err


@pytest.mark.parametrize('begin', [0, 2000])
def test_a_gyro_that_is_frozen_is_said_and_judges_nothing(begin, tmp_path, capsys):
    _, recording = flown('hexarotor')
    gyro = recording.values['gyro'].copy()
    gyro[begin:] = gyro[begin]
    write(tmp_path / 'flight.csv', recording.with_stream('gyro', gyro))
    main(['identify', str(tmp_path / 'flight.csv'), 'hexarotor'])
    out, err = capsys.readouterr()
    assert f'flight.csv: gyro: does not change from {STEP * begin:.2f} s on' in err
    assert 'inf' not in out
    assert 'delay: a part of the flight does not show it' in out
    assert 'angular_velocity_noise: no ratio of the gyro is sure' in out


def test_several_flights_are_judged_by_each_other():
    vehicle, recording = flown('hexarotor')
    _, other = flown('hexarotor', seconds=8.0, seed=1)
    # A third flight of a vehicle whose rotors are in another order spoils what it is judged by.
    turned = other.with_stream('command', np.roll(other.values['command'], 1, axis=1))
    assert identify(vehicle, [recording, other]).effectiveness['roll'].r2 > 0.8
    spoiled = identify(vehicle, [recording, turned]).effectiveness['roll']
    assert spoiled.r2 < 0.5
    assert 'R^2' in spoiled.fault


def test_moments_of_no_body_are_not_written():
    vehicle, recording = flown('hexarotor')
    # A torque coefficient that is three times too large looks like a large inertia about z.
    wrong = replace(vehicle, torque_coefficient=3.0 * vehicle.torque_coefficient)
    found = identify(wrong, [recording])
    assert 'no body has the principal moments' in found.effectiveness['yaw'].fault
    assert found.parameters['vehicle.inertia'][2] == vehicle.inertia[2, 2]


def test_sure_inertias_that_a_guess_contradicts_are_not_left_without_a_reason():
    vehicle, recording = flown('hexarotor')
    gyro = recording.values['gyro'].copy()
    gyro[:, 2] = np.random.default_rng(3).normal(size=len(gyro))
    guess = replace(vehicle, inertia=np.diag([0.021, 0.011, 0.04]))
    found = identify(guess, [recording.with_stream('gyro', gyro)])
    assert not found.effectiveness['roll'].fault
    assert not found.effectiveness['pitch'].fault
    assert 'vehicle.inertia' not in found.parameters
    for axis in 'xy':
        why = found.left[f'vehicle.inertia about {axis}']
        assert why.startswith('no body has the principal moments'), why
        assert why.endswith('0.04]: correct the guess about z'), why
    assert 'R^2' in found.left['vehicle.inertia about z']


def test_noise_explains_nothing():
    vehicle, recording = flown('hexarotor')
    random = np.random.default_rng(3).normal(size=recording.values['gyro'].shape)
    found = identify(vehicle, [Recording(
        recording.times, {'command': recording.values['command'], 'gyro': random})])
    assert all(found.effectiveness[axis].fault for axis in INERTIA)
    assert found.lag.fault
    assert found.parameters == {}
    assert found.left['rotors.thrust_coefficient'] == 'no accelerometer'
    assert found.left['detector.angular_velocity_noise'] == 'no ratio of the gyro is sure'


@pytest.mark.parametrize(('factor', 'unit'), [(1e3, 'ms'), (1e6, 'us')])
def test_times_that_are_no_seconds_are_refused(factor, unit):
    vehicle, recording = flown('hexarotor')
    times = {name: factor * time for name, time in recording.times.items()}
    with pytest.raises(ParameterError, match=f'^{unit}: t: .* t is in seconds$'):
        identify(vehicle, [Recording(times, recording.values, unit)])


def test_revolutions_per_minute_are_refused():
    vehicle, recording = flown('hexarotor')
    rpm = recording.with_stream('command', recording.values['command'] * 30.0 / np.pi)
    with pytest.raises(ParameterError, match=r'^flight: command: up to .* 400 rad/s.* rpm'):
        identify(vehicle, [rpm])


def test_a_mirrored_frame_has_the_wrong_sign():
    vehicle, recording = flown('hexarotor')
    mirrored = recording.with_stream('gyro', recording.values['gyro'] * [1.0, -1.0, -1.0])
    found = identify(vehicle, [mirrored]).effectiveness
    assert not found['roll'].fault
    assert 'wrong sign' in found['pitch'].fault
    assert 'wrong sign' in found['yaw'].fault


def test_a_flight_that_is_too_short_is_refused():
    vehicle, recording = flown('hexarotor')
    times = {name: time[:900] for name, time in recording.times.items()}
    values = {name: value[:900] for name, value in recording.values.items()}
    with pytest.raises(ParameterError, match='1 blocks of 2 s of flight: expected 6 or more'):
        identify(vehicle, [Recording(times, values)])


def test_a_flight_without_command_and_gyro_at_once_is_refused():
    vehicle, recording = flown('hexarotor')
    times = {**recording.times, 'gyro': recording.times['gyro'] + 100.0}
    with pytest.raises(ParameterError, match='flight: 0 s: expected 2 s or more with command'):
        identify(vehicle, [recording, Recording(times, recording.values, 'flight')])


def test_a_flight_without_a_whole_block_judges_nothing():
    vehicle, recording = flown('hexarotor')
    short = Recording(*(
        {name: each[:550] for name, each in part.items()}
        for part in (recording.times, recording.values)))
    assert not identify(vehicle, [recording, short]).effectiveness['roll'].fault


@pytest.mark.parametrize(('law', 'power'), [('linear', 2.0), ('quadratic', 1.0)])
def test_throttles_become_speeds(law, power):
    vehicle, recording = flown('hexarotor')
    speeds = recording.values['command']
    throttles = recording.with_stream('command', (speeds / vehicle.speed_max) ** power)
    np.testing.assert_allclose(
        speeds_of(vehicle, throttles, law).values['command'], speeds, rtol=1e-12)
    with pytest.raises(ParameterError, match='expected rotor speeds'):
        speeds_of(vehicle, throttles, None)
    with pytest.raises(ParameterError, match='throttles from 0 to 1'):
        speeds_of(vehicle, recording, law)


def test_throttles_of_a_curve_become_speeds():
    vehicle = Vehicle.load('hexarotor_realistic')
    speeds = np.random.default_rng(0).uniform(60.0, 370.0, (20, 6))
    recording = Recording({}, {'command': np.asarray(vehicle.throttles(speeds))})
    found = speeds_of(vehicle, recording, 'curve').values['command']
    np.testing.assert_allclose(found, speeds, atol=0.2)


def write(path, recording):
    values = recording.values
    table = np.column_stack([recording.times['gyro'], *values.values()])
    titles = ['t', *(f'command_{i + 1}' for i in range(6)), *(
        f'{name}_{axis}' for name in ('gyro', 'acc') for axis in 'xyz')]
    np.savetxt(path, table, delimiter=',', header=','.join(titles), comments='', fmt='%.17g')


def test_files_of_a_flight_are_read(tmp_path):
    _, recording = flown('hexarotor')
    write(tmp_path / 'flight.csv', recording)
    arrays = {f't_{name}': recording.times[name] for name in recording.values}
    np.savez(tmp_path / 'flight.npz', **arrays, **recording.values)
    for suffix in 'csv', 'npz':
        found = read_recording(tmp_path / f'flight.{suffix}', 6)
        for name, values in recording.values.items():
            np.testing.assert_array_equal(found.values[name], values)
            np.testing.assert_array_equal(found.times[name], recording.times[name])
    np.savez(tmp_path / 'wide.npz', **{**recording.values, 'gyro': np.zeros((4, 4))})
    with pytest.raises(ParameterError, match='gyro: 4 columns, expected 3'):
        read_recording(tmp_path / 'wide.npz', 6)
    turned = read_recording(tmp_path / 'flight.csv', 6, 'frd').values
    np.testing.assert_array_equal(turned['gyro'], recording.values['gyro'] * [1, -1, -1])


def test_the_flight_of_a_simulation_is_read(tmp_path):
    rng, attitude = np.random.default_rng(0), np.tile([0.0, 0.0, 0.0, 1.0], (5, 1))
    moving = [rng.normal(size=(5, 3)) for _ in range(3)]
    flight = Flight(
        0.01 * np.arange(5), moving[0], attitude, *moving[1:], np.full((5, 6), 250.0),
        measured=np.vstack([np.full((1, 6), np.nan), rng.normal(size=(4, 6))]))
    flight.write_csv(tmp_path / 'flight.csv')
    found = read_recording(tmp_path / 'flight.csv', 6).values
    np.testing.assert_array_equal(found['command'], flight.speeds)
    np.testing.assert_array_equal(found['gyro'], flight.angular_velocity)
    np.testing.assert_array_equal(found['velocity'], flight.velocity)
    np.testing.assert_array_equal(found['speed'], flight.measured[1:])


@pytest.mark.parametrize('sub_steps', [1, 5])
def test_the_flight_of_bringup_gives_back_what_was_simulated(tmp_path, sub_steps):
    # A flight over ROS writes the same bytes: test_flights_over_ros.py.
    case = Case.load('hexarotor_realistic', [
        f'simulator.sub_steps:={sub_steps}', 'simulator.angular_velocity_noise:=0.01',
        'vehicle.inertia:=[0.015, 0.016, 0.028]'])
    rng = np.random.default_rng(0)
    goals = [
        Change(k * 1_500_000_000, waypoint=Waypoint.of(*rng.uniform(-2, 2, 3), rng.uniform(-2, 2)))
        for k in range(12)]
    flight = fly(case.controller(), case.allocator('exact'), case.plant(), goals[0].waypoint, 18.0,
                 changes=goals)
    flight.write_csv(tmp_path / 'flight.csv')
    guess = replace(case.vehicle, inertia=np.diag([1.4, 0.7, 1.2] * np.diag(case.vehicle.inertia)))
    recording = read_recording(tmp_path / 'flight.csv', case.vehicle.n)
    found = identify(guess, [recording])
    close(found.lag, 0.05, 0.02)
    close(found.delay, 0.01, 0.03)
    for axis, ratio in zip(INERTIA, [1.4, 0.7, 1.2], strict=True):
        close(found.effectiveness[axis], ratio, 0.02)


def test_a_stream_has_values_where_its_cells_are_filled(tmp_path):
    rows = ['t,command_1,command_2,gyro_x,gyro_y,gyro_z', '0,1,2,,,', '0.1,,,1,2,3',
            '0.2,3,4,5,6,7', '0.3,,,8,9,10']
    (tmp_path / 'a.csv').write_text('\n'.join(rows), encoding='utf-8')
    found = read_recording(tmp_path / 'a.csv', 2)
    np.testing.assert_array_equal(found.times['command'], [0.0, 0.2])
    np.testing.assert_array_equal(found.times['gyro'], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(found.values['gyro'][0], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(('text', 'fault'), [
    ('t,command_1\n0,1\n1,1', 'gyro: missing'),
    ('t,command_1,command_2\n0,1,1\n1,1,1', 'command_1, command_2: expected command_1'),
    ('t,command_1,gyro_x,gyro_y\n0,1,1,1\n1,1,1,1', 'gyro_y: expected gyro_x, gyro_y, gyro_z'),
    ('t,command_1,gyro_x,gyro_y,gyro_z\n0,1,1,1,1\n0,1,1,1,1', 'times of command that increase'),
    ('t,command_1,gyro_x,gyro_y,gyro_z\n0,1,1,one,1', 'line 2: expected a number'),
    ('command_1,gyro_x,gyro_y,gyro_z\n1,1,1,1', 't: missing'),
    ('', 't: missing, and no column of a flight'),
    ('a,b\n1,2', 't: missing, and no column of a flight'),
])
def test_a_wrong_file_is_refused(tmp_path, text, fault):
    (tmp_path / 'a.csv').write_text(text, encoding='utf-8')
    with pytest.raises(ParameterError, match=fault) as raised:
        read_recording(tmp_path / 'a.csv', 1)
    assert str(tmp_path / 'a.csv') in str(raised.value)


def test_the_command_writes_a_copy_with_what_is_sure(tmp_path, capsys):
    vehicle, recording = flown('hexarotor')
    write(tmp_path / 'flight.csv', recording)
    out = tmp_path / 'mine.yaml'
    assert main(['identify', str(tmp_path / 'flight.csv'), 'hexarotor', '--out', str(out)]) == 0
    assert 'lag: 0.0' in capsys.readouterr().out
    mine = Vehicle.load(out)
    wanted = np.diag(vehicle.inertia) * [*INERTIA.values()]
    np.testing.assert_allclose(np.diag(mine.inertia), wanted, rtol=0.04)
    assert '# [kg], paper' in out.read_text(encoding='utf-8')
    assert main(['identify', str(tmp_path / 'flight.csv'), 'quadrotor']) == 1
    assert 'expected command_1, command_2, command_3, command_4' in capsys.readouterr().err
    degrees = recording.with_stream('gyro', np.degrees(recording.values['gyro']))
    write(tmp_path / 'degrees.csv', degrees)
    assert main(['identify', str(tmp_path / 'degrees.csv'), 'hexarotor']) == 1
    assert 'gyro: ' in (err := capsys.readouterr().err)
    assert 'read as deg/s' in err
    # Yaw alone hardly turns the thrust.
    yaw = recording.with_stream('gyro', recording.values['gyro'] * [1.0, 1.0, 180.0 / np.pi])
    write(tmp_path / 'yaw.csv', yaw)
    assert main(['identify', str(tmp_path / 'yaw.csv'), 'hexarotor']) == 0
    assert 'warning: yaw: 6' in capsys.readouterr().err


def test_the_command_writes_nothing_where_a_sign_is_wrong(tmp_path, capsys):
    _, recording = flown('hexarotor')
    mirrored = recording.with_stream('gyro', recording.values['gyro'] * [1.0, -1.0, -1.0])
    write(tmp_path / 'flight.csv', mirrored)
    out = tmp_path / 'mine.yaml'
    assert main(['identify', str(tmp_path / 'flight.csv'), 'hexarotor', '--out', str(out)]) == 1
    text, error = capsys.readouterr()
    assert not out.exists()
    assert 'detector.delay: wrong sign: pitch, yaw' in text
    assert error.endswith('a sign is wrong: no parameter changes, and no file is written\n')


def test_values_of_a_file_change_and_its_comments_stay():
    text = ('# top\n/**:\n  ros__parameters:\n    vehicle:\n      mass: 1.0   # [kg]\n'
            '      inertia: [1.0,\n                2.0]   # two\n    detector.delay: 0.1\n')
    found = with_values(text, {'vehicle.inertia': [3.0, 4.0], 'detector.delay': 0.2,
                               'vehicle.gravity': 9.8, 'detector.noise': 1.0})
    assert found == (
        '# top\n/**:\n  ros__parameters:\n    detector.noise: 1.0\n    vehicle:\n'
        '      gravity: 9.8\n      mass: 1.0   # [kg]\n'
        '      inertia: [3.0, 4.0]   # two\n    detector.delay: 0.2\n')
    sections = ''.join(f'{name}:\n  ros__parameters:\n    b: 1\n' for name in 'ac')
    with pytest.raises(ParameterError, match='one section'):
        with_values(sections, {'b': 2})


def test_a_vehicle_without_inertia_is_refused():
    vehicle, recording = flown('hexarotor')
    with pytest.raises(ParameterError, match='inertia: missing; expected a first guess'):
        identify(replace(vehicle, inertia=None), [recording])
