"""Flights of PX4 through the detector, beside what PX4's land detector says.

``python -m benchmarks.detection.px4_flights VEHICLE.yaml FOLDER...``: each folder has logs (.ulg)
with the topics of ``examples/px4/log_flights.py``, and becomes a row of the table.

Each `EVERY` seconds of a log a rotor is taken from the recorded motion, the rotors in turn, if
vehicle_land_detected says "not landed" from `BEFORE` s before until `AFTER` s after.  There is no
other condition, and nothing is left out later.  Each is replayed from the beginning of the log.
An alarm is what the detector names in a log from which no rotor is taken.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.detection.recordings import Replayed, named_right, through_detector
from benchmarks.detection.tables import rate, table
from ca_ros.arguments import positive
from ca_ros.arrays import Array, BoolArray
from ca_ros.detection.injected_loss import WAIT
from ca_ros.detection.replay import Replay
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.vehicle import Vehicle

EVERY = 20.0  # [s]
BEFORE, AFTER = 1.0, WAIT  # [s]

TITLES = (
    'flights', 'logs', 'in the air [s]', 'landings', 'alarms: in the air', 'on the ground',
    'an hour', 'taken rotors named right [%]', 'wrong', 'not named', 'median, 90 % [ms]',
    'warnings of the lag')


def flights(times: Array, landed: BoolArray) -> Array:
    """Return when each flight begins and ends (K, 2), by the land detector's rows [s].

    A flight that does not end with a landing ends at infinity.
    """
    edges = np.diff(np.concatenate([[0], 1 - np.asarray(landed, int), [0]]))
    times = np.append(times, np.inf)
    return np.column_stack([times[edges > 0], times[edges < 0]])


def flights_of(log: Path) -> Array:
    """Return when each flight of a log begins and ends (K, 2) [s]."""
    from pyulog import ULog

    rows = ULog(str(log), ['vehicle_land_detected']).get_dataset('vehicle_land_detected').data
    return flights(rows['timestamp'] / 1e6, rows['landed'] != 0)


def in_turn(
    vehicle: Vehicle, recording: Recording, found: Replay, flown: Array
) -> Iterator[tuple[int, float]]:
    """Yield the rotors that are taken, and when [s] since the recording's beginning."""
    taken = 0
    for at in np.arange(EVERY, found.times[-1] - AFTER, EVERY).tolist():
        begin, end = (flown - recording.span[0]).T
        if ((begin <= at - BEFORE) & (at + AFTER <= end)).any():
            yield taken % vehicle.n, at
            taken += 1


def row(name: str, logs: Sequence[Replayed], flown: Sequence[Array]) -> list[str]:
    """Return a row of the table.

    - `flown`: when each flight of each log begins and ends (K, 2) [s]
    """
    on_ground = in_air = landings = 0
    seconds = 0.0
    for log, own in zip(logs, flown, strict=True):
        for each in log.found.named:
            at = log.begin + each.time
            flies = bool(((own[:, 0] <= at) & (at <= own[:, 1])).any())
            in_air, on_ground = in_air + flies, on_ground + (not flies)
        landings += int(np.isfinite(own[:, 1]).sum())
        seconds += float(np.diff(np.minimum(own, log.begin + log.found.times[-1])).sum())
    taken = [each for log in logs for each in log.taken]
    right, wrong, times = named_right(taken)
    return [
        name, str(len(logs)), f'{seconds:.0f}', str(landings), str(in_air), str(on_ground),
        rate(in_air + on_ground, seconds / 3600.0), right, wrong,
        str(sum(each.named is None for each in taken)), times,
        str(sum(bool(log.fault) for log in logs))]


def main(argv: Sequence[str] | None = None) -> int:
    """Replay and print; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection.px4_flights', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add('vehicle', type=Path)
    add('folders', type=Path, nargs='+', metavar='FOLDER')
    add('--throttle', choices=['linear', 'quadratic', 'curve'], default='linear')
    add('--jobs', type=positive(int), help='processes')
    options = parser.parse_args(argv)
    for folder in options.folders:
        if not any(folder.glob('*.ulg')):
            parser.error(f'{folder}: expected a folder with logs (.ulg)')
    rows = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for folder in options.folders:
            logs = sorted(folder.glob('*.ulg'))
            flown = [flights_of(log) for log in logs]
            jobs = [
                pool.submit(through_detector, log, options.vehicle, options.throttle,
                            losses=partial(in_turn, flown=own))
                for log, own in zip(logs, flown, strict=True)]
            found = []
            for job in jobs:
                found.append(job.result())
                print(found[-1], flush=True)
            rows.append(row(folder.name, found, flown))
    print(table(TITLES, rows))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
