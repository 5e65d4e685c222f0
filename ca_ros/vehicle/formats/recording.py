"""A recorded flight as a file: commands, gyro, accelerometer and what else there is."""

import csv
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array
from ca_ros.errors import message
from ca_ros.input_files import check_file
from ca_ros.settings import ParameterError
from ca_ros.vehicle.formats.bag import streams_of

STREAMS = {
    'command': ('command_', '', 1e6), 'gyro': ('gyro_', 'xyz', 1e4), 'acc': ('acc_', 'xyz', 1e5),
    'attitude': ('q', 'xyzw', 1e5), 'velocity': ('v', 'xyz', 1e6),
    'speed': ('speed_measured_', '', 1e6),
}
"""The streams of a recording: how the titles of their columns begin, and how they end.

Without ends the columns are those of the rotors, numbered from 1.  The last is the greatest number
that a vehicle has, also in rpm, deg/s or mm/s: `ca_ros.vehicle.plausibility` tells units.
"""

FRD = np.array([1.0, -1.0, -1.0])  # signs of front-right-down in front-left-up
G = 9.80665  # a specific force of 1 g [m/s^2]

STEP_MAX = 0.5  # the median step of a gyro is below it [s]

RECORDING_MAX = 1_000_000_000  # greatest size of a file [bytes]
SUFFIXES = '.csv', '.npz', '.ulg', '.mcap', '.db3'


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded flight, each stream with its own times.

    - `times`: times (K,) of each stream [s], increasing
    - `values`: the stream (K, c) by name: ``command`` and ``speed`` (measured) of n rotors, in
      rad/s, or as throttles from 0 to 1; ``gyro`` [rad/s], ``acc`` (specific force, [m/s^2]) and
      ``velocity`` [m/s] in the body frame, forward-left-up; ``attitude`` as quaternions x, y, z,
      w, body to world
    - `name`: of the file
    """

    times: dict[str, Array] = field(default_factory=dict)
    values: dict[str, Array] = field(default_factory=dict)
    name: str = ''

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time that command and gyro share [s]."""
        both = [self.times[name] for name in ('command', 'gyro')]
        return max(each[0] for each in both), min(each[-1] for each in both)

    def with_stream(self, name: str, values: Array) -> 'Recording':
        """Return the recording with other values of a stream."""
        return replace(self, values={**self.values, name: values})


def read_recording(file: str | Path, rotors: int, frame: str = 'flu') -> Recording:
    """Read a recorded flight of a vehicle.

    Parameters
    ----------
    file : str or Path
        A CSV file with a row of titles: ``t`` [s], ``command_1`` to ``command_n``, ``gyro_x`` to
        ``gyro_z``, and optionally ``acc_x`` ..., ``qx`` ... ``qw``, ``vx`` ...,
        ``speed_measured_1`` ...; other columns are ignored, and a stream has a value only in rows
        where all its cells are filled, as in the ``flight.csv`` of bringup.  Or an npz
        file with the same names, or with arrays (K, c) by the names of the streams, each with an
        array ``t_NAME`` if its times are not ``t``.  Or a log of PX4 (.ulg), if pyulog is
        installed, or a bag, if rosbags is: see `ca_ros.vehicle.formats.bag`.
    rotors : int
        Number of rotors of the vehicle.
    frame : {'flu', 'frd'}
        Frame of gyro, acc, velocity and attitude: forward-left-up, or forward-right-down (attitude
        to north-east-down).

    Returns
    -------
    Recording

    Raises
    ------
    ParameterError
        If the file cannot be read, command or gyro is missing, a stream has a wrong number of
        columns, times do not increase or are not in seconds, or a value cannot be.
    """
    path = Path(file)
    bag = (path / 'metadata.yaml').is_file()
    if not bag and path.suffix not in SUFFIXES:
        raise ParameterError(
            f'{path}: expected a flight in a file {", ".join(SUFFIXES)}, or a bag')
    for part in path.iterdir() if bag else [path]:
        check_file(part, RECORDING_MAX)
    try:
        read = {'.csv': _from_csv, '.npz': _from_npz, '.ulg': _from_ulog}
        columns = read.get('' if bag else path.suffix, _from_bag)(path)
    except (OSError, ParameterError) as error:
        raise ParameterError(message(error, path)) from None
    except Exception as error:
        # Damaged bytes raise whatever a parser meets, some of it in many lines or without words.
        first = str(error).partition('\n')[0] or type(error).__name__
        raise ParameterError(f'{path}: cannot be read as a flight: {first}') from None
    try:
        recording = _streams(columns, rotors)
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None
    if frame == 'frd' or path.suffix == '.ulg':
        recording = other_frame(recording)
    return replace(recording, name=path.name)


def other_frame(recording: Recording) -> Recording:
    """Return a recording from front-right-down in front-left-up, or the other way."""
    signs = {'gyro': FRD, 'acc': FRD, 'velocity': FRD, 'attitude': np.array([1, -1, -1, 1])}
    for name in signs.keys() & recording.values.keys():
        recording = recording.with_stream(name, recording.values[name] * signs[name])
    return recording


def _from_csv(path: Path) -> dict[str, Array]:
    """Return the columns of a CSV file that a recording has; empty cells are NaN."""
    with path.open(newline='', encoding='utf-8-sig') as stream:
        rows = csv.reader(stream)
        titles = [title.strip() for title in next(rows, [])]
        wanted = [i for i, title in enumerate(titles) if title == 't' or _stream_of(title)]
        table = []
        for row in rows:
            try:
                table.append([float(row[i]) if row[i].strip() else np.nan for i in wanted])
            except (ValueError, IndexError):
                raise ParameterError(
                    f'line {rows.line_num}: expected a number in each of {len(titles)} columns'
                ) from None
    if not wanted:
        raise ParameterError('t: missing, and no column of a flight, such as command_1 or gyro_x')
    numbers = np.array(table).reshape(-1, len(wanted))
    return {titles[i]: column for i, column in zip(wanted, numbers.T, strict=True)}


def _from_npz(path: Path) -> dict[str, Array]:
    """Return the arrays of an npz file as columns; the times of a stream are ``t_NAME``."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            numbers = {name: np.asarray(arrays[name], float) for name in arrays.files}
    except (BadZipFile, EOFError, TypeError, ValueError, zlib.error):
        raise ParameterError('damaged, or no npz file of numbers') from None
    columns: dict[str, Array] = {}
    for name, array in numbers.items():
        if name in STREAMS and array.ndim == 2:
            columns |= _columns(name, array)
        elif array.ndim == 1:
            columns[name] = array
    return columns


def _from_ulog(path: Path) -> dict[str, Array]:
    """Return the streams of a log of PX4 as columns, forward-right-down."""
    try:
        from pyulog import ULog
    except ImportError:
        raise ParameterError('a log of PX4 needs pyulog: pip install pyulog') from None
    columns: dict[str, Array] = {}
    topics = {each.name: each.data for each in ULog(str(path)).data_list if each.multi_id == 0}
    wanted = {
        'command': ('actuator_motors', [f'control[{i}]' for i in range(12)]),
        'gyro': ('vehicle_angular_velocity', [f'xyz[{i}]' for i in range(3)]),
        'acc': ('vehicle_acceleration', [f'xyz[{i}]' for i in range(3)]),
        'attitude': ('vehicle_attitude', [f'q[{i}]' for i in (1, 2, 3, 0)]),
    }
    for name, (topic, fields) in wanted.items():
        if topic in topics:
            times = topics[topic]['timestamp'].astype(float) / 1e6
            table = np.column_stack([topics[topic][each] for each in fields]).astype(float)
            # In lockstep, a late estimator gives two states the same stamp: the second one counts.
            last = np.diff(times, append=np.inf) != 0.0
            columns[f't_{name}'], table = times[last], table[last]
            # The motors that an airframe does not have are not a number.
            there = np.isfinite(table).any(axis=0) | (name != 'command')
            columns |= _columns(name, table[:, there])
    return columns


def _from_bag(path: Path) -> dict[str, Array]:
    """Return the streams of a bag as columns."""
    columns: dict[str, Array] = {}
    for name, (times, table) in streams_of(path).items():
        columns |= {f't_{name}': times, **_columns(name, table)}
    return columns


def _titles(name: str, rotors: int) -> list[str]:
    """Return the titles of the columns of a stream."""
    begin, ends, _ = STREAMS[name]
    return [f'{begin}{end}' for end in ends or range(1, rotors + 1)]


def _columns(name: str, table: Array) -> dict[str, Array]:
    """Return the columns of a stream (K, c) by title; raise a ParameterError if c is wrong."""
    titles = _titles(name, table.shape[1])
    if len(titles) != table.shape[1]:
        raise ParameterError(f'{name}: {table.shape[1]} columns, expected {len(titles)}')
    return dict(zip(titles, table.T, strict=True))


def _stream_of(title: str) -> str | None:
    """Return the stream that a column belongs to."""
    for name, (begin, ends, _) in STREAMS.items():
        if re.fullmatch(rf'{begin}{f"[{ends}]" if ends else "[0-9]+"}', title):
            return name
    return None


def _check(name: str, rows: NDArray[np.integer], times: Array, table: Array) -> None:
    """Raise a ParameterError that names the first impossible value, or if times are not seconds.

    `rows` (K,): the numbers of the rows, without that of the titles
    """
    most = STREAMS[name][2]
    wrong, expected = ~(abs(table) <= most).all(axis=1), f'numbers up to {most:g}'
    if name == 'attitude' and not wrong.any():
        wrong, expected = ~table.any(axis=1), 'a quaternion that is not zero'
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ParameterError(
            f'{name}: row {rows[i]}, t {times[i]:g}: {table[i].tolist()}: expected {expected}')
    step = float(np.median(np.diff(times)))
    if name == 'gyro' and step >= STEP_MAX:
        raise ParameterError(
            f't: steps of {step:g} s in the median: expected seconds, in steps below {STEP_MAX:g}')


def _streams(columns: Mapping[str, Array], rotors: int) -> Recording:
    """Return the streams of columns, each without the rows in which it has no value."""
    recording = Recording()
    for name in STREAMS:
        titles = _titles(name, rotors)
        given = [title for title in columns if _stream_of(title) == name]
        if not given:
            continue
        if sorted(given) != sorted(titles):
            raise ParameterError(
                f'columns {", ".join(sorted(given))}: expected {", ".join(titles)}'
            )
        times = columns.get(f't_{name}', columns.get('t'))
        if times is None:
            raise ParameterError(f't: missing; expected the times of {name} [s]')
        table = np.column_stack([columns[title] for title in titles])
        if len(times) != len(table):
            raise ParameterError(f'{name}: {len(table)} rows, but {len(times)} times')
        # NaN is an empty cell; what is infinite is refused below.
        filled = ~np.isnan(table).any(axis=1) & np.isfinite(times)
        times, table = times[filled], table[filled]
        if len(times) < 2:
            raise ParameterError(
                f'{name}: {len(times)} of {len(filled)} rows have a value: expected two or more')
        if not np.all(np.diff(times) > 0.0):
            raise ParameterError(f't: expected times of {name} that increase [s]')
        _check(name, np.flatnonzero(filled) + 1, times, table)
        recording.times[name], recording.values[name] = times, table
    missing = {'command', 'gyro'} - recording.values.keys()
    if missing:
        raise ParameterError(
            f'{", ".join(sorted(missing))}: missing; expected columns t, command_1 to '
            f'command_{rotors}, gyro_x, gyro_y, gyro_z'
        )
    return recording
