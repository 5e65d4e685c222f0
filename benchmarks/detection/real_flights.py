"""Real flights of others through the detector.

``python -m benchmarks.detection.real_flights FOLDER``: FOLDER has a clone of each repository of
`data_sets.SETS`.  For each set `ca_ros identify` finds the vehicle from some flights, and the
others are replayed.  Sets and files that are missing are left out.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.detection.data_sets import SETS, WHOLE, DataSet, files
from benchmarks.detection.recordings import (
    PHASES,
    Replayed,
    alarms,
    named_right,
    no_losses,
    random_losses,
    through_detector,
)
from benchmarks.detection.tables import rate, table
from ca_ros.studies.identify import report
from ca_ros.vehicle.formats.edited_yaml import with_values
from ca_ros.vehicle.formats.recording import read_recording
from ca_ros.vehicle.identification import SURE_R2, Identification, identify, speeds_of
from ca_ros.vehicle.vehicle import Vehicle

AIR_MIN = 2.0  # a file with less time in the air is no flight [s]
SOUND = '', WHOLE  # rows of flights whose vehicle is sound
CARRIED = 0.5  # least sum of squared commands in flight, over its 90 % quantile


def converted(data: DataSet, names: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """Write flights as `ca_ros replay` reads them; return the files by name.

    Copies of a flight, and what cannot be used, are left out.
    """
    found, seen = dict[Path, Path](), set[bytes]()
    folder.mkdir(parents=True, exist_ok=True)
    for file in names:
        target = folder / f'{file.parent.name}__{file.stem}.npz'
        try:
            streams: dict[str, Any] = data.read(file)
        except (ImportError, OSError, ValueError) as error:
            print(f'{folder.name}: {file.name} is left out: {error}', file=sys.stderr)
            continue
        motion = streams['gyro'].tobytes()
        if motion in seen:
            print(f'{folder.name}: {file.name} is left out: a copy', file=sys.stderr)
            continue
        seen.add(motion)
        np.savez_compressed(target, **streams)
        found[file] = target
    return found


def thrust_coefficient(data: DataSet, known: Sequence[Path]) -> float:
    """Return the thrust coefficient that carries the weight in the mean of some flights [kg m]."""
    squares = []
    for file in known:
        with np.load(file) as streams:
            speeds = streams['command'] * (data.vehicle.speed_max if data.throttle else 1.0)
        each = np.square(speeds).sum(axis=1)
        squares.append(each[each > CARRIED * np.percentile(each, 90)])
    return data.vehicle.weight / float(np.concatenate(squares).mean())


def guessed(data: DataSet, known: Sequence[Path], folder: Path, like: Path | None = None) -> Path:
    """Write the first guess of a vehicle, or that of another file, and return its file.

    Its thrust coefficient carries the weight in flight.
    """
    target = folder / 'guess.yaml'
    if like is None:
        data.vehicle.save(target)
    text = (like or target).read_text(encoding='utf-8')
    thrust = thrust_coefficient(data, known)
    torque = thrust * (data.vehicle.torque_coefficient / data.vehicle.thrust_coefficient)[0]
    text = with_values(text, {
        'rotors.thrust_coefficient': thrust, 'rotors.torque_coefficient': float(torque)})
    target.write_text(text, encoding='utf-8')
    return target


def identification(data: DataSet, known: Sequence[Path], guess: Path) -> Identification:
    """Return what `ca_ros identify` finds from some flights."""
    vehicle = Vehicle.load(guess)
    return identify(vehicle, [
        speeds_of(vehicle, read_recording(file, vehicle.n), data.throttle) for file in known])


def identified(data: DataSet, known: Sequence[Path], folder: Path) -> Path:
    """Write what `ca_ros identify` finds to a vehicle's file, beside its report; return the file.

    Lag and delay are written also where only their intervals are too wide: both together are
    known better.
    """
    target, like = folder / 'vehicle.yaml', folder.parent / data.like / 'vehicle.yaml'
    guess = guessed(data, known, folder, like if data.like else None)
    found = identification(data, known, guess)
    values = dict(found.parameters)
    if found.lag.r2 > SURE_R2:
        values |= {'detector.motor_time_constant': round(found.lag.value, 5),
                   'detector.delay': round(found.delay.value, 5)}
    target.write_text(
        with_values(guess.read_text(encoding='utf-8'), values), encoding='utf-8')
    (folder / 'identify.txt').write_text('\n'.join(report(found)) + '\n', encoding='utf-8')
    return target


def flown(
    name: str, clones: Path, out: Path, pool: ProcessPoolExecutor, losses: bool
) -> dict[str, list[Replayed]]:
    """Identify and replay a set; return its flights by row of the table."""
    data = SETS[name]
    clone, folder = clones / data.folder, out / name
    named = files(clone, data.known), files(clone, data.replayed)
    flights = converted(data, list(dict.fromkeys([*named[0], *named[1]])), folder)
    known = [flights[file] for file in named[0] if file in flights]
    others = [file for file in named[1] if file in flights and file not in named[0]]
    if not known or not others:
        print(f'{name}: no flights in {clone}', file=sys.stderr)
        return {}
    if data.like and not (out / data.like / 'vehicle.yaml').exists():
        print(f'{name}: identify {data.like} first', file=sys.stderr)
        return {}
    vehicle = identified(data, known, folder)
    rows = [data.row(file) for file in others]
    jobs = [
        pool.submit(through_detector, flights[file], vehicle, data.throttle, 'flu',
                    partial(random_losses, seed=i) if losses and row in SOUND else no_losses)
        for i, (file, row) in enumerate(zip(others, rows, strict=True))]
    found: dict[str, list[Replayed]] = {row: [] for row in sorted(set(rows))}
    for row, job in zip(rows, jobs, strict=True):
        flight = job.result()
        print(f'{name} {row}: {flight}', flush=True)
        if flight.found.in_air > AIR_MIN:
            found[row].append(flight)
    return found


def in_the_air(found: dict[str, dict[str, list[Replayed]]]) -> str:
    """Return the table of alarms, and of rotors that were taken."""
    lines = []
    for name, rows in found.items():
        for row, flights in rows.items():
            if row not in SOUND:
                continue
            landings = sum(int((np.diff(each.found.flying.astype(int)) < 0).sum())
                           for each in flights)
            phases, hours = alarms(flights), sum(each.found.in_air for each in flights) / 3600.0
            taken = [each for flight in flights for each in flight.taken]
            lines.append([
                ', '.join(filter(None, [name, row])), str(len(flights)), f'{3600.0 * hours:.0f}',
                str(landings),
                *(str(phases[phase]) for phase in PHASES),
                rate(sum(phases.values()), hours),
                *named_right(taken),
                str(sum(bool(each.fault) for each in flights))])
    return table(
        ['set', 'flights', 'in the air [s]', 'landings', 'alarms: launch', 'flight', 'landing',
         'an hour', 'taken rotors named right [%]', 'wrong', 'median, 90 % [ms]',
         'warnings of the lag'],
        lines)


def on_propellers(flights: dict[str, list[Replayed]]) -> str:
    """Return the table of what was named first where something was done to propellers."""
    lines = []
    for row, own in flights.items():
        first = [flight.found.named[0].rotors if flight.found.named else () for flight in own]
        means = [each.found.probabilities[each.found.flying].mean(axis=0) for each in own]
        scores = np.mean(means, axis=0)
        lines.append([
            row, str(len(own)),
            *(str(sum(each == (i,) for each in first)) for i in range(len(scores) - 1)),
            str(sum(len(each) > 1 for each in first)), str(sum(not each for each in first)),
            ', '.join(f'{each:.2f}' for each in scores)])
    rotors = [f'rotor {i + 1}' for i in range(len(scores) - 1)]
    return table(
        ['propellers', 'flights', *(f'named first: {rotors[0]}', *rotors[1:]), 'several',
         'none', 'mean probability of each rotor in the air, of a disturbance'], lines)


def run(
    pool: ProcessPoolExecutor, folder: Path, out: Path, sets: Sequence[str] = tuple(SETS),
    losses: bool = True,
) -> dict[str, dict[str, list[Replayed]]]:
    """Identify and replay sets; return their flights by set and row of the table.

    `folder` has the clones.  `losses`: rotors are also taken from the recorded motion.
    """
    return {name: flown(name, folder, out, pool, losses) for name in sets}


def tables_of(found: dict[str, dict[str, list[Replayed]]]) -> Iterator[str]:
    """Yield the table of sound vehicles, and those of propellers to which something was done."""
    yield in_the_air(found)
    for flights in found.values():
        if set(flights) - set(SOUND):
            yield on_propellers(flights)


def main(argv: Sequence[str] | None = None) -> int:
    """Identify, replay and print; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection.real_flights', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='clones: ' + ', '.join(data.source for data in SETS.values()))
    add = parser.add_argument
    add('folder', type=Path, help='has the clones')
    add('--sets', nargs='+', default=[*SETS], choices=SETS, metavar='NAME')
    add('--no-losses', action='store_true', help='take no rotor from the recorded motion')
    add('--jobs', type=int, help='processes')
    add('--out', type=Path, default=Path('out/real_flights'), metavar='DIR')
    options = parser.parse_args(argv)
    with ProcessPoolExecutor(options.jobs) as pool:
        found = run(pool, options.folder, options.out, options.sets, not options.no_losses)
    if not any(found.values()):
        return 1
    text = '\n'.join(tables_of(found))
    (options.out / 'real_flights.md').write_text(text, encoding='utf-8')
    print(text)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
