"""Real flights that others published: where they are, how they are read, and their vehicles.

A clone of each repository, at the commit of `DataSet.source`, lies in one folder.
"""

import csv
import re
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.formats.recording import FRD
from ca_ros.vehicle.state import rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

GRAVITY = 9.81  # [m/s^2]
PWM = 65535.0  # a Crazyflie's command at full throttle
WHOLE = 'whole propellers'
PROPELLER = 47.0  # length of a Crazyflie's propeller [mm]
ACC_UNIT = 2048.0  # an accelerometer's reading at one g, where a log does not tell it

Streams = dict[str, Array]
"""The arrays of a flight, as in an npz file of `read_recording`, forward-left-up."""


@dataclass(frozen=True)
class DataSet:
    """Flights of one vehicle.

    - `source`: repository and commit
    - `read`: reads a file
    - `known`, `replayed`: patterns of the files to identify from, and of those to replay; a file
      to identify from is not replayed
    - `vehicle`: a first guess, whose thrust coefficient is found from `known`
    - `throttle`: how thrust depends on the command, if this is no rotor speed
    - `like`: the set whose identified vehicle is the first guess
    - `row`: names the row of the table that a file belongs to, if the set has several
    """

    source: str
    read: Callable[[Path], Streams]
    known: tuple[str, ...]
    replayed: tuple[str, ...]
    vehicle: Vehicle
    throttle: str | None = None
    like: str = ''
    row: Callable[[Path], str] = lambda file: ''

    @property
    def folder(self) -> str:
        """The folder of the clone."""
        return self.source.split('@')[0].split('/')[1]


def crazyflie(mass: float) -> Vehicle:
    """Return a Crazyflie 2: rotors from the front right on, clockwise.

    Arms: Bitcraze's cfclient; inertia and torque: Foerster, System Identification of the
    Crazyflie 2.0, ETH Zurich, 2015.
    """
    return _square(
        mass, 0.0325, 0.0325, [(1, -1), (-1, -1), (-1, 1), (1, 1)], ('ccw', 'cw', 'ccw', 'cw'),
        [16.6e-6, 16.7e-6, 29.3e-6], 0.00596, 2500.0)


def _square(
    mass: float, x: float, y: float, signs: list[tuple[int, int]], spins: tuple[str, ...],
    inertia: list[float], torque: float, speed_max: float,
) -> Vehicle:
    """Return a vehicle with rotors at (+-x, +-y) [m], whose thrust is twice the weight at most.

    `torque`: torque coefficient over thrust coefficient [m].
    """
    thrust = 2.0 * mass * GRAVITY / len(signs) / speed_max**2
    return Vehicle(
        mass=mass, inertia=inertia, gravity=GRAVITY,
        positions=[[x * forward, y * left, 0.0] for forward, left in signs], spins=spins,
        thrust_coefficient=thrust, torque_coefficient=torque * thrust,
        speed_min=0.0, speed_max=speed_max)


def read_nanobench(file: Path) -> Streams:
    """Read a flight of NanoBench.

    Raises a ValueError for commands that end before the flight, and go on by extrapolation.
    """
    with file.open(newline='', encoding='utf-8') as stream:
        rows = csv.reader(stream)
        titles = next(rows)
        table = np.array([[float(cell) for cell in row] for row in rows])
    column = dict(zip(titles, table.T, strict=True))
    keep = np.diff(column['t'], prepend=-np.inf) > 0.0
    throttles = np.column_stack([column[f'motor_motor_m{i}'] for i in range(1, 5)]) / PWM
    if throttles.min() < 0.0 or throttles.max() > 1.0:
        raise ValueError(f'throttles from {throttles.min():.2g} to {throttles.max():.2g}')
    return {
        't': (column['t'] - column['t'][0])[keep], 'command': throttles[keep],
        'gyro': np.column_stack([column[f'imu_gyro_{axis}'] for axis in 'xyz'])[keep],
        'acc': GRAVITY * np.column_stack([column[f'imu_acc_{axis}'] for axis in 'xyz'])[keep],
    }


def read_usd(file: Path) -> Streams:
    """Read the binary log of a Crazyflie's memory card; times of its clock [s]."""
    data = file.read_bytes()
    version, count = struct.unpack_from('<HH', data, 1)
    if data[0] != 0xBC or version != 2:
        raise ValueError('expected a log of a Crazyflie, version 2')
    at, kinds = 5, dict[int, tuple[str, list[str], struct.Struct]]()

    def text() -> str:
        nonlocal at
        begin, at = at, data.index(0, at) + 1
        return data[begin:at - 1].decode()

    for _ in range(count):
        number, = struct.unpack_from('<H', data, at)
        at += 2
        kind = text()
        size, = struct.unpack_from('<H', data, at)
        at += 2
        names = [text() for _ in range(size)]  # such as gyro.x(f)
        letters = ''.join(name[-2] for name in names)
        kinds[number] = kind, [name[:-3] for name in names], struct.Struct(f'<{letters}')
    rows: list[tuple[float, ...]] = []
    titles: list[str] = []
    while at + 10 < len(data):
        number, time = struct.unpack_from('<HQ', data, at)
        if number not in kinds:  # the check sum
            break
        kind, names, layout = kinds[number]
        if kind == 'fixedFrequency':
            titles = names
            rows.append((1e-6 * time, *layout.unpack_from(data, at + 10)))
        at += 10 + layout.size
    return dict(zip(['t', *titles], np.array(rows).T, strict=True))


def read_log(file: Path) -> Streams:
    """Read a flight of data-driven-system-identification."""
    column = read_usd(file)
    return {
        't': column['t'],
        'command': np.column_stack([column[f'motor.m{i}'] for i in range(1, 5)]) / PWM,
        'gyro': np.radians(np.column_stack([column[f'gyro.{axis}'] for axis in 'xyz'])),
        'acc': GRAVITY * np.column_stack([column[f'acc.{axis}'] for axis in 'xyz']),
    }


def read_crazypad(file: Path) -> Streams:
    """Read a flight of CrazyPAD: commands by the Crazyflie's mixer, and no side forces.

    The log has the pitch rate with the other sign, and the specific force along z alone.
    """
    column = read_usd(file)
    thrust, roll, pitch, yaw = (
        column[f'controller.cmd_{name}'] for name in ('thrust', 'roll', 'pitch', 'yaw'))
    roll, pitch = roll / 2.0, pitch / 2.0
    mixed = np.column_stack([
        thrust - roll + pitch + yaw, thrust - roll - pitch - yaw,
        thrust + roll - pitch + yaw, thrust + roll + pitch - yaw])
    rates = np.column_stack([column[f'controller.r_{axis}'] for axis in ('roll', 'pitch', 'yaw')])
    force = np.zeros_like(rates)
    force[:, 2] = GRAVITY * column['controller.accelz']
    return {
        't': column['t'],
        'command': np.clip(mixed, 0.0, PWM) / PWM * (thrust > 0.0)[:, None],
        'gyro': rates * [1.0, -1.0, 1.0], 'acc': force,
    }


def crazypad_row(file: Path) -> str:
    """Return what was done to the propellers of a flight of CrazyPAD.

    Cuts are those of both blades together: the propeller is 47 mm long.
    """
    name = file.parent.name.replace('\u043c', 'm')  # a Cyrillic letter
    if not name.startswith('cut'):
        kinds = {'normal': WHOLE, 'tape': 'tape', 'add': 'weights',
                 'weight': 'weights on a string'}
        return kinds[name.split('_')[0]]
    first, _, other = name.partition('_M1_')
    sizes = [float(each) for each in re.findall(r'([\d.]+)mm', first)]
    cut = PROPELLER - sizes[-1] if sizes[-1] > PROPELLER / 2.0 else sum(sizes)
    of = 'rotors 1 and 2' if other else 'rotor 2' if 'M2' in first else 'rotor 3'
    most = next(each for each in (2, 4, 6, 8) if cut <= each)
    return f'{of} cut by {most - 1.5:g} to {most} mm'


def read_indiflight(file: Path) -> Streams:
    """Read a flight of indiflightSupport; the commands are the measured rotor speeds.

    Needs orangebox (tried with 0.4.0).
    """
    from orangebox import Parser  # type: ignore[import-untyped,import-not-found,unused-ignore]

    log: Any = Parser.load(str(file))
    titles = ['time', *(f'{name}[{i}]' for name in ('gyroADC', 'accSmooth') for i in range(3)),
              *(f'omega[{i}]' for i in range(4))]
    places = [log.field_names.index(title) for title in titles]
    rows = list[list[float]]()
    with suppress(IndexError, TypeError):  # where a log ends without its mark
        rows.extend([float(frame.data[i]) for i in places] for frame in log.frames())
    column = dict(zip(titles, np.array(rows).T, strict=True))
    unit = log.headers.get('acc_1G', ACC_UNIT)
    fine = 10.0 if log.headers.get('blackbox_high_resolution') else 1.0
    rates = np.column_stack([column[f'gyroADC[{i}]'] for i in range(3)])
    forces = np.column_stack([column[f'accSmooth[{i}]'] for i in range(3)])
    keep = np.diff(column['time'], prepend=-np.inf) > 0.0
    return {
        't': 1e-6 * (column['time'] - column['time'][0])[keep],
        'command': np.column_stack([column[f'omega[{i}]'] for i in range(4)])[keep],
        'gyro': (np.radians(rates) / fine)[keep], 'acc': (GRAVITY * forces / unit)[keep],
    }


def read_acsl(file: Path) -> Streams:
    """Read a flight of ACSL's X8: attitude and velocity, and commanded thrusts as speeds."""
    titles: list[str] = []
    rows: list[list[float]] = []
    for line in file.read_text(encoding='utf-8', errors='replace').splitlines():
        cells = [cell.strip() for cell in line.split('] ')[-1].split(',')][:-1]
        if 'Current time [s]' in cells:
            titles = cells
        elif titles and len(cells) == len(titles):
            rows.append([float(cell) for cell in cells])
    table = np.array(rows)
    table = table[np.diff(table[:, titles.index('Current time [s]')], prepend=-np.inf) > 0.0]
    column = dict(zip(titles, table.T, strict=True))

    def columns(name: str, ends: str, unit: str) -> Array:
        return np.column_stack([column[f'{name}{end} [{unit}]'] for end in ends])

    # Scalar first, forward-right-down to north-east-down.
    attitude = columns('Quaternion q', '1230', '-') * [1.0, -1.0, -1.0, 1.0]
    world = columns('Velocity ', 'xyz', 'm/s') * FRD
    velocity = np.array([
        rotation_matrix(q).T @ v for q, v in zip(attitude, world, strict=True)])
    thrusts = columns('Thrust motors X8COPTER T', '12345678', 'N')
    return {
        't': column['Current time [s]'], 'command': np.sqrt(np.maximum(thrusts, 0.0) / X8_THRUST),
        'gyro': FRD * columns('Angular velocity ', 'xyz', 'rad/s'),
        'attitude': attitude, 'velocity': velocity,
    }


X8_SPEED = 1500.0  # [rad/s]
X8_MASS = 2.67  # [kg]: mean of the commanded thrusts
X8_THRUST = 2.0 * X8_MASS * GRAVITY / 8.0 / X8_SPEED**2

SETS = {
    'data-driven-system-identification': DataSet(
        source='arplaboratory/data-driven-system-identification@2d267dd0', read=read_log,
        known=('logs_crazyflie/log15',),
        replayed=('logs_crazyflie/log10', 'logs_crazyflie/log16'),
        vehicle=crazyflie(0.03), throttle='quadratic'),
    'NanoBench': DataSet(
        source='syediu/nanobench-iros2026@0ae7d689', read=read_nanobench,
        known=('datasets/dataset/*_slow_rep3.csv',),
        replayed=('datasets/dataset/*.csv',),
        vehicle=crazyflie(0.03), throttle='quadratic', like='data-driven-system-identification'),
    'indiflight': DataSet(
        source='tudelft/indiflightSupport@44abf260', read=read_indiflight,
        known=('Documentation/Papers/Data/IROS2024_VideoShoot/*.BFL',
               'Documentation/Papers/Data/IROS2024_ExperimentData/LOG00269.BFL'),
        replayed=('Documentation/Papers/Data/IROS2024_ExperimentData/*.BFL',),
        # Ratios of the angular accelerations: its IndiflightProfile.txt; arms: a guess.
        vehicle=_square(
            0.45, 0.08, 0.08, [(-1, -1), (1, -1), (-1, 1), (1, 1)], ('cw', 'ccw', 'ccw', 'cw'),
            [9.4e-4, 1.45e-3, 2.0e-3], 0.022, 4200.0)),
    'ACSL': DataSet(
        source='andrealaffly/ACSL-flightstack-accessories@f26552a4', read=read_acsl,
        known=('Flight_Data/2024/06/20240613/PID/logs/*.log',),
        replayed=('Flight_Data/2024/06/20240621/PID/logs/*.log',
                  'Flight_Data/2024/07/20240729/MRAC/logs/log_20240729_163817.log'),
        # Arms, order and yaw: what makes its commanded torques of its commanded thrusts.
        vehicle=_square(
            X8_MASS, 0.0881, 0.1083,
            [(1, -1), (1, 1), (-1, 1), (-1, -1), (1, 1), (1, -1), (-1, -1), (-1, 1)],
            ('ccw', 'cw', 'ccw', 'cw', 'ccw', 'cw', 'ccw', 'cw'),
            [0.015, 0.015, 0.028], 0.01, X8_SPEED)),
    'CrazyPAD': DataSet(
        source='AerialRoboticsUUST/CrazyPAD@5448265f', read=read_crazypad,
        known=('data/controller_data/normal_flight/E8_*',),
        replayed=('data/controller_data/*/E*',),
        vehicle=crazyflie(0.03), throttle='quadratic', like='data-driven-system-identification',
        row=crazypad_row),
}


def files(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """Return the files of a set."""
    return sorted({file for pattern in patterns for file in folder.glob(pattern)})
