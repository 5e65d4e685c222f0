"""Identify simulated flights in wind and gusts; print the figures of docs/identify.md.

With a folder that has the clones of `benchmarks.detection.real_flights`, real flights of others
instead, for the page's table.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from pages import DOCS, fill

from ca_ros.control.waypoint import Waypoint
from ca_ros.settings import ParameterError
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.studies.cases import Case
from ca_ros.studies.tables import table
from ca_ros.vehicle.formats.recording import read_recording
from ca_ros.vehicle.identification import Identification, identify

sys.path.append(str(DOCS.parent))
from benchmarks.detection.data_sets import SETS, files
from benchmarks.detection.real_flights import converted, guessed, identification

VEHICLE = 'hexarotor_realistic'
FLIGHTS = 24
LEG, LEGS = 1.5, 24  # time to each waypoint, and how many there are [s]
GUESS = [1.4, 0.7, 1.2]  # inertia of the first guess, over the true one
LAG, DELAY = 0.05, 0.01  # of the simulator [s]
AXES = 'roll', 'pitch', 'yaw'

REAL = {
    'data-driven-system-identification': (['*/log15'], ['*/log16'], ['*/log10']),
    'indiflight': (
        ['**/LOG00281.BFL'], ['**/LOG00267.BFL'], ['**/LOG00340.BFL'], ['**/LOG00342.BFL'],
        ['**/LOG00230.BFL'], ['**/LOG00258.BFL']),
    'ACSL': (
        ['**/log_20240613_*.log', '**/log_20240621_*.log'], ['**/log_20240613_115633.log'],
        ['**/log_20240613_121802.log'], ['**/log_20240621_*.log']),
    'NanoBench': tuple([f'datasets/dataset/{name}_rep1.csv'] for name in (
        'B2_circle_slow', 'B3_figure8_slow', 'B5_helix_slow', 'B2_circle_fast')),
    'CrazyPAD': (['**/normal_flight/E*'],),
}
"""The flights of each row of the table, by set."""

SHORT = {
    'vehicle.inertia': 'inertia', 'rotors.thrust_coefficient': 'thrust',
    'detector.motor_time_constant': 'lag', 'detector.delay': 'delay'}
"""Parameters that a row names if they are sure."""


def identified(case: Case, seed: int) -> Identification:
    """Fly to random waypoints at 100 Hz, and identify the vehicle from the flight's file."""
    rng = np.random.default_rng(seed)
    goals = [
        Change(round(1e9 * LEG * k),
               waypoint=Waypoint.of(*rng.uniform(-2.0, 2.0, 3), rng.uniform(-2.0, 2.0)))
        for k in range(LEGS)]
    flight = fly(case.controller(), case.allocator('exact'), case.plant(), goals[0].waypoint,
                 LEG * LEGS, changes=goals)
    guess = replace(case.vehicle, inertia=np.diag(GUESS * np.diag(case.vehicle.inertia)))
    with TemporaryDirectory() as folder:
        file = Path(folder) / 'flight.csv'
        flight.write_csv(file)
        return identify(guess, [read_recording(file, case.vehicle.n)])


def row(name: str, patterns: list[str], clones: Path) -> list[str]:
    """Return the row of some real flights."""
    data = SETS[name]
    with TemporaryDirectory() as place:
        found = files(clones / data.folder, tuple(patterns))
        known = list(converted(data, found, Path(place)).values())
        seconds = sum(float(np.ptp(np.load(file)['t'])) for file in known)
        words = [name, ', '.join(file.stem.removeprefix('log_') for file in found)]
        words.append(f'{seconds:.0f}')
        try:
            result = identification(data, known, guessed(data, known, Path(place)))
        except ParameterError as error:
            return [*words, '', f'refused: {error}', '']
    r2 = [f'{result.effectiveness[axis].r2:.2f}' if axis in result.effectiveness else 'none'
          for axis in (*AXES, 'thrust')]
    sure = [short for key, short in SHORT.items() if key in result.parameters]
    if 'inertia' in sure:
        sure[0] = 'inertia about ' + ', '.join(
            axis for axis in 'xyz' if f'vehicle.inertia about {axis}' not in result.left)
    times = f'{1e3 * result.lag.value:.0f}, {1e3 * result.delay.value:.0f}'
    return [*words, times, ', '.join(r2), ', '.join(sure) or 'nothing']


def main() -> None:
    """Print the figures, or fill the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('clones', nargs='?', type=Path, help='folder with clones of real flights')
    clones = parser.parse_args().clones
    if clones is None:
        simulated()
        return
    rows = [row(name, each, clones) for name, every in REAL.items() for each in every]
    titles = 'set', 'flights', 'time [s]', 'lag, delay [ms]', 'R² roll, pitch, yaw, thrust', 'sure'
    fill('identify.md', real_flights=table(titles, rows, len(titles)))


def simulated() -> None:
    """Print the error of each number, and how often its interval holds the truth."""
    truth = {'lag': LAG, 'delay': DELAY, **dict(zip(AXES, GUESS, strict=True))}
    errors: dict[str, list[float]] = {}
    held: dict[str, int] = {}
    for seed in range(FLIGHTS):
        case = Case.load(VEHICLE, [
            f'simulator.seed:={seed}', f'simulator.motor_time_constant:={LAG}',
            f'simulator.command_delay:={DELAY}'])
        found = identified(case, seed)
        pairs = {'lag': found.lag, 'delay': found.delay}
        pairs |= {axis: found.effectiveness[axis] for axis in AXES}
        for name, each in pairs.items():
            errors.setdefault(name, []).append(each.value / truth[name] - 1.0)
            held[name] = held.get(name, 0) + (each.low <= truth[name] <= each.high)
    for name, each in errors.items():
        low, middle, high = 100.0 * np.quantile(each, [0.0, 0.5, 1.0])
        print(f'{name}: {middle:+.1f} % in the median, {low:+.1f} to {high:+.1f} %; '
              f'{held[name]} of {FLIGHTS} intervals hold it')


if __name__ == '__main__':
    main()
