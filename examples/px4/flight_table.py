"""Measure PX4's logs of flights: python flight_table.py flights/*.ulg

Heights, tilts and positions are those of the simulator, not PX4's estimates.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pyulog import ULog
from sitl import MARK

FIRST, SOON = 1.0, 5.0  # times after the mark in which height and tilt are measured [s]
HOVER = 15.0  # time after the mark in which the spread is measured [s]
GROUND = 0.05  # height at which it has come down [m]
HARD = 1.0  # speed at the ground from which on it has fallen [m/s]

STATES = {4: 'Hold', 5: 'Return', 12: 'Descend', 13: 'Terminate', 14: 'offboard', 18: 'Land'}
EXTERNAL = 23  # the first external mode
TOPICS = [
    'vehicle_local_position_groundtruth', 'vehicle_attitude_groundtruth', 'vehicle_status',
    'vehicle_command', 'vehicle_local_position',
]


class Measured(NamedTuple):
    """What a log says; times are those after the mark [s], lengths in m, angles in degrees.

    - `lost_first`, `lost`: height lost in `FIRST` and in `SOON`
    - `tilt`: greatest tilt in `SOON`
    - `failsafe`: time until the fail-safe; NaN if there was none
    - `then`: the modes of PX4 that follow
    - `impact`: speed downwards at the ground [m/s]; NaN if it stayed in the air
    - `spread` (3,): standard deviation north, east, down in `HOVER`
    - `missed`: distances to the corners of the square
    - `time`, `height`: time and height from 2 s before the mark
    """

    lost_first: float
    lost: float
    tilt: float
    failsafe: float
    then: list[str]
    impact: float
    spread: np.ndarray
    missed: list[float]
    time: np.ndarray
    height: np.ndarray

    @property
    def fell(self) -> bool:
        """Whether it came to the ground too fast."""
        return self.impact > HARD


def measure(path: Path) -> Measured:
    """Measure the log of a flight; raise a ValueError if it has no mark."""
    log = ULog(str(path), TOPICS)
    data = {found.name: found.data for found in log.data_list}
    commands, status = data['vehicle_command'], data['vehicle_status']
    marks = np.flatnonzero(commands['command'] == MARK)
    begun = [int(commands['timestamp'][k]) for k in marks]
    begun += [time for time, name, _ in log.changed_parameters if name == 'SIH_LOST']
    if not begun:
        raise ValueError(f'{path}: no mark in this log')
    begin = min(begun)

    truth = data['vehicle_local_position_groundtruth']
    time = (truth['timestamp'].astype(np.int64) - begin) / 1e6
    position = np.column_stack([truth[axis] for axis in 'xyz'])
    height = np.maximum(-position[:, 2], 0.0)  # SIH's ground gives way
    after = time >= 0.0
    first, soon = after & (time <= FIRST), after & (time <= SOON)
    ground = np.flatnonzero(after & (height < GROUND))
    impact = np.nan
    if len(ground):
        down = time[ground[0]]
        impact = float(truth['vz'][(time > down - 0.2) & (time <= down)].max())

    attitude = data['vehicle_attitude_groundtruth']
    q = np.column_stack([attitude[f'q[{i}]'] for i in range(4)])
    tilt = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2), -1.0, 1.0)))
    turned = (attitude['timestamp'].astype(np.int64) - begin) / 1e6

    told = (status['timestamp'].astype(np.int64) - begin) / 1e6
    failed = told[(told >= 0.0) & (status['failsafe'] > 0)]
    states = [*status['nav_state'][told < 0.0][-1:], *status['nav_state'][told >= 0.0]]
    then = [int(now) for before, now in pairwise(states) if now != before]

    estimate, missed = data['vehicle_local_position'], []
    for k in marks:
        if commands['param4'][k] > 0.0:
            i = np.searchsorted(estimate['timestamp'], commands['timestamp'][k]) - 1
            corner = [commands['param3'][k], commands['param2'][k], -commands['param4'][k]]
            here = [estimate[axis][i] for axis in 'xyz']
            missed.append(float(np.linalg.norm(np.subtract(here, corner))))

    shown = time >= -2.0
    return Measured(
        lost_first=float(height[first][0] - height[first].min()),
        lost=float(height[soon][0] - height[soon].min()),
        tilt=float(tilt[(turned >= 0.0) & (turned <= SOON)].max()),
        failsafe=float(failed[0]) if len(failed) else np.nan,
        then=[STATES.get(s, 'ca_ros' if s >= EXTERNAL else str(s)) for s in then],
        impact=impact, spread=position[after & (time <= HOVER)].std(axis=0), missed=missed,
        time=time[shown], height=height[shown],
    )


def kind(path: Path) -> str:
    """Return the kind of a flight: its scenario without the rotor, and its interface."""
    scenario, label, _ = path.stem.rsplit('_', 2)
    return f'{re.sub("-[0-9]$", "", scenario)}, {label}'


def measured(logs: Sequence[Path]) -> dict[str, list[Measured]]:
    """Measure the logs of flights; return them by their kind."""
    groups: dict[str, list[Measured]] = {}
    for path in logs:
        if '.failed' in path.suffixes:
            continue
        try:
            groups.setdefault(kind(path), []).append(measure(path))
        except ValueError as error:
            print(error, file=sys.stderr)
    return groups


def spans(values: Sequence[float], digits: int = 2) -> str:
    """Return median, and least and greatest of several values."""
    found = [value for value in values if np.isfinite(value)]
    if not found:
        return '-'
    low, middle, high = (f'{value:.{digits}f}' for value in np.percentile(found, (0, 50, 100)))
    return middle if low == high else f'{middle} ({low} to {high})'


HEAD = [
    'flight', 'flights, fell', 'height lost in 1 s [m]', 'in 5 s [m]', 'greatest tilt [degrees]',
    'fail-safe after [s]', 'modes that follow', 'spread north, east, down [m]',
]


def row(name: str, flights: Sequence[Measured]) -> list[str]:
    """Return the cells of a kind of flight."""
    ends = sorted({', '.join(flight.then) or '-' for flight in flights})
    cells = [
        name, f'{len(flights)}, {sum(flight.fell for flight in flights)}',
        spans([flight.lost_first for flight in flights]),
        spans([flight.lost for flight in flights]),
        spans([flight.tilt for flight in flights], 0),
        spans([flight.failsafe for flight in flights]), '; '.join(ends),
        ', '.join(f'{np.median([flight.spread[i] for flight in flights]):.2f}' for i in range(3)),
    ]
    if missed := [each for flight in flights for each in flight.missed]:
        cells[-1] += f'; to the corners {spans(missed)}'
    return cells


def table(groups: dict[str, list[Measured]]) -> str:
    """Return the table in Markdown."""
    lines = [HEAD, ['---'] * len(HEAD), *(row(name, each) for name, each in groups.items())]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def main() -> None:
    """Print the table of the logs on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('logs', nargs='+', type=Path)
    print(table(measured(parser.parse_args().logs)))


if __name__ == '__main__':
    main()
