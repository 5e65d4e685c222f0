"""Real flights of others: their files are read as they are, and counted once."""

import struct

import numpy as np
import pytest

from benchmarks.detection import real_flights
from benchmarks.detection.data_sets import SETS, crazypad_row, read_crazypad, read_nanobench
from ca_ros import Vehicle
from ca_ros.vehicle.effectiveness import rotor_wrenches

NAMES = [f'cmd_{name}' for name in ('thrust', 'roll', 'pitch', 'yaw')]
NAMES += [f'r_{name}' for name in ('roll', 'pitch', 'yaw')] + ['accelz']


def usd(rows):
    """Return a log of a Crazyflie's memory card; each row is a time [us] and the values."""
    titles = b''.join(f'controller.{name}(f)'.encode() + b'\0' for name in NAMES)
    head = struct.pack('<BHHH', 0xBC, 2, 2, 255) + b'fixedFrequency\0'
    head += struct.pack('<H', len(NAMES)) + titles
    head += struct.pack('<H', 7) + b'landed\0' + struct.pack('<H', 1) + b'mode(B)\0'
    data = b''.join(struct.pack(f'<HQ{len(NAMES)}f', 255, *row) for row in rows)
    event = struct.pack('<HQB', 7, 1500, 3)
    return head + data + event + b'\xbc\0\0\0\0'


def test_a_log_of_crazypad_becomes_front_left_up(tmp_path):
    file = tmp_path / 'E8_log00'
    hover = [32767.5, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 1.0]
    rolling = [32767.5, 6553.5, 0.0, 0.0, 0.1, 0.2, 0.3, 1.0]
    file.write_bytes(usd([(1_000_000, *hover), (1_010_000, *rolling)]))
    found = read_crazypad(file)
    np.testing.assert_allclose(found['t'], [1.0, 1.01])
    np.testing.assert_allclose(found['gyro'][0], [0.1, -0.2, 0.3], atol=1e-7)
    np.testing.assert_allclose(found['acc'][0], [0.0, 0.0, 9.81])
    np.testing.assert_allclose(found['command'][0], 0.5)
    # A roll command turns it to the right, about x.
    torque = rotor_wrenches(SETS['CrazyPAD'].vehicle) @ np.square(found['command'][1])
    assert torque[3] > 0.0
    assert abs(torque[4]) < 1e-9 * torque[3]


@pytest.mark.parametrize(('folder', 'row'), [
    ('normal_flight', 'whole propellers'),
    ('weight_on_string_W2_near_M3', 'weights on a string'),
    ('cut_propeller_M3_1mm', 'rotor 3 cut by 0.5 to 2 mm'),
    ('cut_propeller_M3_1.5mm_1mm_44.5mm', 'rotor 3 cut by 2.5 to 4 mm'),
    ('cut_m3_2mm_2mm', 'rotor 3 cut by 2.5 to 4 mm'),
    ('cut_M2_4.0\u043c\u043c_3.5\u043c\u043c_39.5\u043c\u043c_M1_3.5\u043c\u043c_3.5'
     '\u043c\u043c_40\u043c\u043c', 'rotors 1 and 2 cut by 6.5 to 8 mm'),
])
def test_the_name_of_a_folder_says_what_was_cut(tmp_path, folder, row):
    assert crazypad_row(tmp_path / folder / 'E8_log00') == row


def nanobench(path, throttle):
    """Write a flight of NanoBench, in which the throttle of rotor 1 ends at a value."""
    titles = ['t', *(f'motor_motor_m{i}' for i in range(1, 5))]
    titles += [f'imu_{name}_{axis}' for name in ('gyro', 'acc') for axis in 'xyz']
    rows = [[0.01 * k, *[40000.0] * 4, 0.1 * k, 0.2, 0.3, 0.0, 0.0, 1.0] for k in range(5)]
    rows[-1][1] = 65535.0 * throttle
    lines = [','.join(titles), *(','.join(map(str, row)) for row in rows)]
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_extrapolated_commands_and_copies_are_left_out(tmp_path, capsys):
    good, copy = (nanobench(tmp_path / f'B{i}.csv', 0.6) for i in (1, 2))
    wrong = nanobench(tmp_path / 'B3.csv', 29.0)
    np.testing.assert_allclose(read_nanobench(good)['acc'][:, 2], 9.81)
    found = real_flights.converted(SETS['NanoBench'], [good, copy, wrong], tmp_path / 'out')
    assert list(found) == [good]
    said = capsys.readouterr().err
    assert 'B2.csv is left out: a copy' in said
    assert 'B3.csv is left out: throttles from 0.61 to 29' in said


def test_a_folder_without_flights_is_said(tmp_path, capsys):
    assert real_flights.main([str(tmp_path / 'none'), '--out', str(tmp_path / 'out')]) == 1
    assert capsys.readouterr().err.count('no flights in') == len(SETS)


@pytest.mark.parametrize('name', SETS)
def test_a_first_guess_hovers(name):
    vehicle = SETS[name].vehicle
    assert isinstance(vehicle, Vehicle)
    wrench = rotor_wrenches(vehicle) @ np.full(vehicle.n, vehicle.weight / vehicle.n)
    np.testing.assert_allclose(wrench, [0, 0, vehicle.weight, 0, 0, 0], atol=1e-9)
