"""A flight over the real nodes, in lockstep."""

import signal
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import pandas as pd
import yaml

from ca_ros.allocation import ALLOCATORS
from ca_ros.allocation.settings import own_methods
from ca_ros.errors import CaRosError
from ca_ros.parameter_files import FileSettings
from ca_ros.process.processes import end, start
from ca_ros.settings import table
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import Case
from ca_ros.studies.comparison import FOR_COMPARISON

ENDING = 30.0  # time that an interrupted flight has to end [s]


def check(methods: Sequence[str]) -> None:
    """Raise a CaRosError unless the methods can be flown over nodes here."""
    if find_spec('rclpy') is None:
        raise CaRosError('--ros needs ROS 2: there is no rclpy in this Python')
    for method in methods:
        if method in FOR_COMPARISON:
            known = ', '.join(ALLOCATORS)
            raise CaRosError(f'--ros: the nodes have {known}, but not {method}')


def fly_over_ros(case: Case, method: str, duration: float, words: Sequence[str]) -> Flight:
    """Fly with `bringup`, which gets further words, in the ROS domain of the environment.

    Raises a CaRosError with the last line that `bringup` wrote if there is no flight.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        names = table(FileSettings, own=own_methods(method))
        own = {name: value for name, value in case.parameters.items() if name in names}
        own['allocation.method'] = method
        parameters = {'/**': {'ros__parameters': own}}
        (out / 'vehicle.yaml').write_text(yaml.safe_dump(parameters), encoding='utf-8')
        command = [sys.executable, '-m', 'ca_ros_cli', 'bringup', '--mode', 'lockstep']
        command += ['--figures', 'none']
        command += ['--duration', repr(duration), '--out', folder]
        command += ['--vehicle', str(out / 'vehicle.yaml'), *words]
        with (out / 'log').open('w+', encoding='utf-8') as log:
            # In a session of its own: Ctrl-C reaches only this process, which passes it on once.
            process = start(command, stdout=log, stderr=log)
            try:
                process.wait()
            finally:
                end([process], signal.SIGINT, ENDING)
            # A flight that missed its waypoint also counts.
            if (out / 'flight.csv').is_file():
                return read_flight(out / 'flight.csv')
            log.seek(0)
            last = [line.strip() for line in log if line.strip()][-1:] or ['no output']
            raise CaRosError(f'{method}: no flight over ROS: {last[0]}')


def read_flight(path: Path) -> Flight:
    """Return the flight that `Flight.write_csv` wrote to a file, to the last bit."""
    # The parser of pandas may be off in the last bit.
    rows = pd.read_csv(path, dtype=str).astype(float)
    speeds = [name for name in rows if name.startswith('speed_')]
    angles = [name for name in rows if name.startswith('angle_')]
    names = (['x', 'y', 'z'], ['qx', 'qy', 'qz', 'qw'], ['vx', 'vy', 'vz'], ['wx', 'wy', 'wz'])
    columns = (rows[chosen].to_numpy() for chosen in (*names, speeds, angles))
    return Flight(rows['t'].to_numpy(), *columns)
