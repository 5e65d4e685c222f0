"""The thrust curve of a motor from the measurements of a test stand."""

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from ca_ros.arrays import Array
from ca_ros.errors import message
from ca_ros.input_files import read_text
from ca_ros.settings import ParameterError
from ca_ros.vehicle.thrust_curve import ThrustCurve, to_thrust

QUANTITIES = {
    'thrust': r'thrust',
    'torque': r'torque',
    'speed': r'rpm|speed|rad/s',
    'throttle': r'throttle',
    'pwm': r'pwm|esc|pulse',
    'voltage': r'volt',
}
"""The columns by what their titles contain."""

UNITS: dict[str, dict[str, float]] = {
    'thrust': {'n': 1.0, 'kgf': 9.80665, 'kg': 9.80665, 'gf': 9.80665e-3, 'g': 9.80665e-3},
    'torque': {'n m': 1.0, 'nm': 1.0, 'n·m': 1.0, 'n.m': 1.0, 'n*m': 1.0},
    'speed': {'rad/s': 1.0, 'rpm': np.pi / 30.0},
    'throttle': {'': 1.0, '1': 1.0, '%': 0.01},
    'pwm': {'': 1.0, 'us': 1.0, 'µs': 1.0, 'μs': 1.0},
    'voltage': {'': 1.0, 'v': 1.0},
}
"""Factors to SI units; throttle from 0 to 1, pulse widths in us."""

IGNORED = r'efficien'  # titles with ESC, motor or thrust that are none of these

GREATEST = 1e9  # of all sound values, in SI units
RANGES = {'throttle': (0.0, 1.0), 'voltage': (1e-3, GREATEST), 'pwm': (0.0, GREATEST)}
"""Least and greatest sound values in SI units."""

FEWEST = 4  # points that a fit needs at least
REST = 1000.0  # pulse width of rest, if the stand did not measure at rest [us]
FULL = 0.99  # throttle from which on it is full
FLAT = 1e-3  # least share of the thrust by which it has to grow over the points


@dataclass(frozen=True, eq=False)
class StandFit:
    """What a test stand tells of a motor.

    - `speeds` and `thrusts` (k,): the measured points, by increasing speed [rad/s, N]
    - `square` and `curve`: the best k_f w^2 by least squares, and the best a w^2 + b w + c or the
      table
    - `settings`: the settings of `rotors` that they give, by name
    - `throttles` (k,)
    - `expo`: the best THR_MDL_FAC; 0 without throttles
    - `note`: what was assumed; may be empty
    """

    speeds: Array
    thrusts: Array
    square: ThrustCurve
    curve: ThrustCurve
    settings: dict[str, object]
    throttles: Array | None
    expo: float
    note: str = ''

    def error(self, curve: ThrustCurve) -> tuple[float, float]:
        """Return the root mean square and the greatest error of a curve [N]."""
        apart = curve.thrust(self.speeds) - self.thrusts
        return float(np.sqrt(np.mean(apart**2))), float(np.abs(apart).max())

    def expo_error(self, expo: float) -> float:
        """Return the greatest error of a thrust that a THR_MDL_FAC gives for a throttle [N]."""
        assert self.throttles is not None
        top = self.thrusts.max()
        return float(np.abs(top * to_thrust(self.throttles, expo) - self.thrusts).max())


def read_stand(file: str | Path) -> dict[str, Array]:
    """Read a CSV file with a title for each column, such as ``thrust [gf]`` or ``Speed (RPM)``.

    A throttle may be a number or a percentage, such as 40%.

    Raises a ParameterError that names the file, the line, the column and the fault.

    The result: the columns in SI units by the names of `QUANTITIES`; others are ignored.
    """
    reader = csv.reader(StringIO(read_text(file, encoding='utf-8-sig', newline=''), newline=''))
    try:
        lines = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise ParameterError(message(error, file)) from None
    columns: dict[str, Array] = {}
    titles = lines[0][1] if lines else []
    if len(titles) == 1 and ';' in titles[0]:
        raise ParameterError(f'{file}: expected commas between the columns, got semicolons')
    for i, title in enumerate(titles):
        quantity, factor = _column(f'{file}: {title.strip()!r}', title.lower())
        if quantity is None:
            continue
        if quantity in columns:
            raise ParameterError(
                f'{file}: {title.strip()!r}: a second column of {quantity}: leave one of them out')
        least, most = (each / factor for each in RANGES.get(quantity, (-GREATEST, GREATEST)))
        values = []
        for line, row in lines[1:]:
            given = row[i].strip() if i < len(row) else ''
            # A throttle may be 40%, whatever the unit of its column.
            percent = quantity == 'throttle' and given.endswith('%')
            try:
                values.append(0.01 / factor * float(given[:-1]) if percent else float(given))
                sound = least <= values[-1] <= most
            except ValueError:
                sound = False
            if not sound:
                bounds = f' from {least:g} to {most:g}' if quantity in RANGES else ''
                raise ParameterError(
                    f'{file}: line {line}, {title.strip()!r}: expected a number{bounds}, got '
                    f'{given!r}')
        columns[quantity] = factor * np.array(values)
    return columns


def _column(place: str, title: str) -> tuple[str | None, float]:
    """Return the quantity of a column, None if there is none, and the factor to its SI unit."""
    name, unit = title, ''
    if found := re.search(r'[\[(](.*?)[\])]', title):
        name, unit = title[: found.start()], found[1].strip()
    quantity = next((key for key, word in QUANTITIES.items() if re.search(word, name)), None)
    if quantity is None or re.search(IGNORED, name):
        return None, 1.0
    if quantity == 'speed' and not unit and 'rpm' in name:
        unit = 'rpm'
    if unit not in UNITS[quantity]:
        words = ', '.join(filter(None, UNITS[quantity]))
        raise ParameterError(f'{place}: expected its unit in brackets, one of {words}')
    return quantity, UNITS[quantity][unit]


def fit(
    columns: Mapping[str, Array], speed_max: float | None = None, as_table: bool = False
) -> StandFit:
    """Fit the curves to the columns of `read_stand`.

    Raises a ParameterError if columns or points are missing, the stand did not reach full
    throttle, or the measured thrust does not increase.  With voltages, the throttle of a row
    belongs to its speed at the voltage of full throttle, in proportion to the voltage.

    - `columns`: thrust, and speed or a command (throttle or PWM); torque and voltage if they are
      known
    - `speed_max`: the speed at the greatest thrust [rad/s], if no speeds were measured: the speeds
      are then nominal, in proportion to the square root of the thrust
    - `as_table`: whether the curve is a table, with the mean of the points of each throttle
    """
    data, ends, note = _sound_rows(columns, speed_max)
    w, f, x = data['speed'], data['thrust'], data.get('throttle')
    k_f = float(w**2 @ f / (w**2 @ w**2))
    settings: dict[str, object] = {'thrust_coefficient': digits(k_f)}
    if 'torque' in data:
        ratio = float(f @ np.abs(data['torque']) / (f @ f))
        settings['torque_coefficient'] = digits(ratio * k_f)
    settings |= {'speed_min': digits(w[0]), 'speed_max': digits(w[-1])}
    if 'voltage' in data:
        settings['speed_max_per_volt'] = digits(w[-1] / data['voltage'][-1])
    points: dict[str, object] = {}
    measured, speeds, thrusts, expo = w, w, f, 0.0
    if x is not None:
        steps, member = np.unique(np.round(x, 4), return_inverse=True)
        # At another voltage, the same throttle turns the rotor in proportion to it.
        volts = data.get('voltage', np.ones(len(w)))
        at_full = w * volts[-1] / volts
        measured, speeds, thrusts = (
            np.bincount(member, v) / np.bincount(member) for v in (w, at_full, f)
        )
        # The last one is the greatest speed.
        measured[-1] = speeds[-1] = w[-1]
        if len(steps) < 2 or (np.diff(speeds) <= 0.0).any():
            raise ParameterError('the speed does not increase with the throttle')
        share, bend = f / f[-1], x**2 - x
        expo = float(np.clip((share - x) @ bend / max(bend @ bend, 1e-12), 0.0, 1.0))
        points = {'throttles': [digits(step) for step in steps], 'expo': digits(expo)}
    if ends is not None:
        points['pwm'] = list(ends)
    if as_table:
        curve = ThrustCurve.table(measured, thrusts)
        # With voltages, thrusts and throttles were measured at different speeds.
        both = np.unique([digits(speed) for speed in (*measured, *speeds)])
        if x is not None:
            known = np.append(0.0, speeds), np.append(0.0, steps)
            points['throttles'] = [digits(step) for step in np.interp(both, *known)]
        speeds = both
        points['thrusts'] = [digits(thrust) for thrust in curve.thrust(speeds)]
    else:
        powers = np.column_stack([w**2, w, np.ones(len(w))])
        numbers = [digits(number) for number in np.linalg.lstsq(powers, f, rcond=None)[0]]
        points['polynomial'] = numbers
        curve = ThrustCurve.polynomial(numbers, float(w[0]), float(w[-1]))
    if as_table or x is not None:
        points['speeds'] = [digits(speed) for speed in speeds]
    settings['thrust_curve'] = points
    return StandFit(w, f, ThrustCurve(coefficient=k_f), curve, settings, x, expo, note)


def _sound_rows(
    columns: Mapping[str, Array], speed_max: float | None
) -> tuple[dict[str, Array], tuple[float, float] | None, str]:
    """Return the rows in which the rotor turns, with speed and throttle, by increasing speed.

    After them the pulse widths of no and full throttle [us], None without PWM, and a note.  The
    arguments and errors are those of `fit`.
    """
    if 'thrust' not in columns:
        raise ParameterError('no column of thrust')
    data = dict(columns)
    if 'speed' not in data:
        if speed_max is None or not {'throttle', 'pwm'} & {*data}:
            raise ParameterError(
                'no column of speed: expected one, or --speed-max beside throttle or PWM')
        shares = np.maximum(data['thrust'], 0.0) / max(data['thrust'].max(initial=0.0), 1e-9)
        data['speed'] = speed_max * np.sqrt(shares)
    elif speed_max is not None:
        raise ParameterError('--speed-max: not with a column of speed')
    ends, note = None, ''
    turning = (data['speed'] > 0.0) & (data['thrust'] > 0.0)
    if 'pwm' in data and len(turning):
        if 'throttle' in data:
            raise ParameterError('columns of throttle and of PWM: leave one of them out')
        least, full = float(data['pwm'].min()), float(data['pwm'].max())
        if turning[data['pwm'].argmin()]:
            if least <= REST:
                raise ParameterError(f'the motor turned at {least:g} us: expected a row at rest')
            least, note = REST, f'no row at rest: throttle 0 is assumed to be {REST:g} us'
        ends = least, full
        data['throttle'] = (data['pwm'] - least) / max(full - least, 1e-9)
    if count := (data['thrust'] < 0.0).sum():
        note = '; '.join(filter(None, [note, f'rows of negative thrust left out: {count}']))
    if (count := turning.sum()) < FEWEST:
        raise ParameterError(f'{count} points with speed and thrust: expected {FEWEST} or more')
    order = np.argsort(data['speed'][turning], kind='stable')
    data = {name: values[turning][order] for name, values in data.items()}
    f, x = data['thrust'], data.get('throttle')
    if x is not None and x.max() < FULL:
        raise ParameterError(
            f'throttle ends at {x.max():g}: expected rows up to full throttle, 1 (for thrust over '
            'speed alone, leave throttle and voltage out)'
        )
    if f[-1] - f[0] <= FLAT * f[-1]:
        raise ParameterError('the thrust does not increase with the speed')
    return data, ends, note


def digits(number: float) -> float:
    """Return a number with six digits, as it is written to a file."""
    return float(f'{number:.6g}')
