"""The thrust curve of a motor from the measurements of a test stand."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ca_ros.arrays import Array
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

FEWEST = 4  # points that a fit needs at least


@dataclass(frozen=True, eq=False)
class StandFit:
    """What a test stand tells of a motor.

    - `speeds` and `thrusts` (k,): the measured points, by increasing speed [rad/s, N]
    - `square` and `curve`: the best k_f w^2 by least squares, and the best a w^2 + b w + c or the
      table
    - `settings`: the settings of `rotors` that they give, by name
    - `throttles` (k,)
    - `expo`: the best THR_MDL_FAC; 0 without throttles
    """

    speeds: Array
    thrusts: Array
    square: ThrustCurve
    curve: ThrustCurve
    settings: dict[str, object]
    throttles: Array | None
    expo: float

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

    Raises a ParameterError that names the file, the column and the fault.

    The result: the columns in SI units by the names of `QUANTITIES`; others are ignored.
    """
    try:
        with open(file, newline='', encoding='utf-8-sig') as stream:
            rows = [row for row in csv.reader(stream) if any(word.strip() for word in row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f'{file}: {error}') from None
    columns: dict[str, Array] = {}
    for i, title in enumerate(rows[0] if rows else []):
        quantity, factor = _column(f'{file}: {title.strip()!r}', title.lower())
        if quantity is None:
            continue
        if quantity in columns:
            raise ParameterError(f'{file}: {title.strip()!r}: a second column of {quantity}')
        try:
            values = factor * np.array([float(row[i]) for row in rows[1:]])
        except (IndexError, ValueError) as error:
            raise ParameterError(f'{file}: {title.strip()!r}: {error}') from None
        if not np.isfinite(values).all():
            raise ParameterError(f'{file}: {title.strip()!r}: expected finite numbers')
        columns[quantity] = values
    return columns


def _column(place: str, title: str) -> tuple[str | None, float]:
    """Return the quantity of a column, None if there is none, and the factor to its SI unit."""
    name, unit = title, ''
    if found := re.search(r'[\[(](.*?)[\])]', title):
        name, unit = title[: found.start()], found[1].strip()
    quantity = next((key for key, word in QUANTITIES.items() if re.search(word, name)), None)
    if quantity is None:
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

    Raises a ParameterError if columns or points are missing, or the measured thrust does not
    increase.

    - `columns`: thrust, and speed or a command (throttle or PWM); torque and voltage if they are
      known
    - `speed_max`: the speed at the greatest thrust [rad/s], if no speeds were measured: the speeds
      are then nominal, in proportion to the square root of the thrust
    - `as_table`: whether the curve is a table, with the mean of the points of each throttle
    """
    if 'thrust' not in columns:
        raise ParameterError('no column of thrust')
    data = dict(columns)
    if 'speed' not in data:
        if speed_max is None or not {'throttle', 'pwm'} & {*data}:
            needed = 'one, or --speed-max beside throttle or PWM'
            raise ParameterError(f'no column of speed: expected {needed}')
        shares = np.maximum(data['thrust'], 0.0) / data['thrust'].max()
        data['speed'] = speed_max * np.sqrt(shares)
    ends = None
    if 'throttle' not in data and 'pwm' in data:
        ends = float(data['pwm'].min()), float(data['pwm'].max())
        data['throttle'] = (data['pwm'] - ends[0]) / max(ends[1] - ends[0], 1e-9)
    turning = (data['speed'] > 0.0) & (data['thrust'] > 0.0)
    if turning.sum() < FEWEST:
        count = turning.sum()
        raise ParameterError(f'{count} points with speed and thrust: expected {FEWEST} or more')
    order = np.argsort(data['speed'][turning], kind='stable')
    data = {name: values[turning][order] for name, values in data.items()}
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
    speeds, thrusts = w, f
    expo = 0.0
    if x is not None:
        steps, member = np.unique(np.round(x, 4), return_inverse=True)
        speeds, thrusts = (np.bincount(member, v) / np.bincount(member) for v in (w, f))
        # The last one is the greatest speed.
        speeds[-1] = w[-1]
        if len(steps) < 2 or (np.diff(speeds) <= 0.0).any():
            raise ParameterError('the speed does not increase with the throttle')
        share, bend = f / f[-1], x**2 - x
        expo = float(np.clip((share - x) @ bend / max(bend @ bend, 1e-12), 0.0, 1.0))
        points = {'throttles': [digits(step) for step in steps], 'expo': digits(expo)}
    if ends is not None:
        points['pwm'] = list(ends)
    if as_table:
        points['thrusts'] = [digits(thrust) for thrust in thrusts]
        curve = ThrustCurve.table(speeds, thrusts)
    else:
        powers = np.column_stack([w**2, w, np.ones(len(w))])
        numbers = [digits(number) for number in np.linalg.lstsq(powers, f, rcond=None)[0]]
        points['polynomial'] = numbers
        curve = ThrustCurve.polynomial(numbers, float(w[0]), float(w[-1]))
    if as_table or x is not None:
        points['speeds'] = [digits(speed) for speed in speeds]
    settings['thrust_curve'] = points
    return StandFit(w, f, ThrustCurve(coefficient=k_f), curve, settings, x, expo)


def digits(number: float) -> float:
    """Return a number with six digits, as it is written to a file."""
    return float(f'{number:.6g}')
