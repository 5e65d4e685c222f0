"""A flight over the real nodes, in lockstep."""

from __future__ import annotations

import math
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import yaml

from ca_ros.allocation import ALLOCATORS as METHODS
from ca_ros.bringup.processes import start
from ca_ros.evaluation.cases import Case
from ca_ros.flight.record import Flight
from ca_ros.flight.waypoint import Waypoint

PATIENCE = 30.0
"""Time that a flight has to end after it was interrupted [s]."""


class RosFlightError(RuntimeError):
    """The nodes did not fly."""


def check(methods: Sequence[str]) -> None:
    """Raise a ValueError unless the methods can be flown over nodes here."""
    if find_spec('rclpy') is None:
        raise ValueError('--ros needs ROS 2: there is no rclpy in this Python')
    for method in methods:
        if method not in METHODS:
            raise ValueError(f'--ros: the nodes know {", ".join(METHODS)}, but not {method}')


def fly_over_ros(
    case: Case,
    method: str,
    waypoint: Waypoint,
    duration: float,
    stop: Sequence[int],
    ros: Sequence[str],
) -> Flight | None:
    """Fly with `bringup` in the ROS domain of the environment.

    Parameters
    ----------
    case : Case
    method : str
    waypoint : Waypoint
    duration : float
        [s]
    stop : sequence
        Not empty once the flight is to end.
    ros : sequence of str
        Arguments for ROS.

    Returns
    -------
    Flight or None
        None if it was ended.

    Raises
    ------
    RosFlightError
        If it did not fly, with the last line that it wrote.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        parameters = {'/**': {'ros__parameters': case.parameters}}
        (out / 'vehicle.yaml').write_text(yaml.safe_dump(parameters), encoding='utf-8')
        command = [sys.executable, '-m', 'ca_ros.bringup.bringup', '--mode', 'lockstep']
        command += ['--method', method, '--duration', repr(duration), '--out', folder]
        command += ['--vehicle', str(out / 'vehicle.yaml'), '--waypoint']
        command += [repr(coordinate) for coordinate in waypoint.position.tolist()]
        command += ['--heading', repr(math.degrees(waypoint.heading)), *ros]
        with (out / 'log').open('w+', encoding='utf-8') as log:
            # In a session of its own: a Ctrl-C is for this process, which passes it on once.
            process = start(command, stdout=log, stderr=log)
            try:
                while process.poll() is None and not stop:
                    time.sleep(0.05)
            finally:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
                    process.wait(PATIENCE)
            if stop:
                return None
            # Also a flight that has missed its waypoint is one.
            if (out / 'flight.csv').is_file():
                return read_flight(out / 'flight.csv')
            log.seek(0)
            last = [line.strip() for line in log if line.strip()][-1:] or ['it said nothing']
            raise RosFlightError(f'{method}: no flight over ROS: {last[0]}')


def read_flight(path: Path) -> Flight:
    """Return the flight that `Flight.write_csv` wrote to a file, to the last bit."""
    # pandas' own way to read numbers may be off in the last bit.
    rows = pd.read_csv(path, dtype=str).astype(float)
    names = (
        ['x', 'y', 'z'],
        ['qx', 'qy', 'qz', 'qw'],
        ['vx', 'vy', 'vz'],
        ['wx', 'wy', 'wz'],
        [name for name in rows if name.startswith('speed_')],
    )
    return Flight(rows['t'].to_numpy(), *(rows[chosen].to_numpy() for chosen in names))
