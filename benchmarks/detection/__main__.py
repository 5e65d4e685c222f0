"""Fly the detector of failures on a plant of its own: false alarms, and names of failed rotors.

It prints the tables and writes them to alarms.md; names.csv has a row for each failure.  Those of
results.md are by ``python docs/scripts/detection.py``.
"""

import argparse
import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.detection import tables
from benchmarks.detection.conditions import CAUSES, CONTACTS, FLOWN, LOSSES
from benchmarks.detection.flights import (
    DURATION,
    POOLED,
    PUBLISHED,
    STOPPED,
    TUNING,
    VEHICLES,
    Count,
    Outcome,
    fly,
)
from benchmarks.detection.reallocation import ACTING, AFTERWARDS, WAYS, act, call, fly_on
from ca_ros.arguments import amount, natural, positive
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.errors import CaRosError

BLOCK = 10  # flights of a job
TAKE_OFF = ('landings',)  # where rotors are lost soon after a take-off

Found = dict[tuple[str, ...], Any]
"""What was found, by vehicle, condition and kind of failure."""


def _setting(text: str) -> tuple[str, float]:
    name, _, value = text.partition('=')
    known = DetectorSettings.__dataclass_fields__
    if name not in known:
        raise argparse.ArgumentTypeError(
            f'{name}: no setting of the detector; expected one of {", ".join(known)}')
    return name, float(value)


def _blocks(first: int, count: int) -> list[range]:
    ends = range(first, first + count, BLOCK)
    return [range(begin, min(begin + BLOCK, first + count)) for begin in ends]


def _jobs(options: argparse.Namespace) -> list[tuple[Callable[[Any], Any], tuple[Any, ...]]]:
    """Return what is to be flown: a function, and its argument."""
    first = PUBLISHED if options.publish else options.first
    flights, contacts, acting, after = (
        round(each * 3600.0 / DURATION)
        for each in (options.hours, options.mujoco, options.acting, options.afterwards))
    losses, reallocated = (-(-each // len(POOLED)) for each in (options.losses, options.flights))
    most = max(flights, contacts, acting, after, losses, reallocated)
    if not options.publish and first + most > TUNING:
        raise CaRosError(f'seeds below {TUNING} are for trials: fly less')
    flown = CAUSES if options.causes else dict.fromkeys(options.conditions)
    soon = [kind for kind in options.kinds if kind == 'total']
    if options.imu in ('alone', 'stopped') and reallocated + acting + after:
        raise CaRosError(
            f'--imu {options.imu}: without --flights, --acting and --afterwards')
    given = {'force': options.imu, 'settings': dict(options.settings)}
    parts: list[tuple[Callable[[Any], Any], Any, Any, int]] = [
        (fly, flown, [''], flights), (fly, CONTACTS, [''], contacts),
        (fly, POOLED, options.kinds, losses), (fly, TAKE_OFF, soon, losses),
        (partial(fly_on, left=options.left), POOLED, WAYS, reallocated),
        (act, options.conditions, [ACTING], acting),
        (act, [each for each in POOLED if each in options.conditions], [AFTERWARDS], after),
    ]
    return [
        (function, (vehicle, name, kind, seeds, given))
        for function, names, kinds, count in parts for vehicle in options.vehicles
        for name in names for kind in kinds for seeds in _blocks(first, count)
    ]


def pool_of(jobs: int | None) -> ProcessPoolExecutor:
    """Return processes that fly; `jobs`: how many."""
    return ProcessPoolExecutor(jobs, mp_context=get_context('spawn'))


def run(options: argparse.Namespace, pool: ProcessPoolExecutor) -> Found:
    """Fly; return what was found by vehicle, condition and kind of failure."""
    found: Found = {}
    jobs = _jobs(options)
    if not jobs:
        raise CaRosError(
            f'nothing to fly: expected --losses, or --hours of {DURATION:g} s or more')
    for i, (key, part) in enumerate(pool.map(call, *zip(*jobs, strict=True))):
        found[key] = found[key] + part if key in found else part
        if sys.stderr.isatty():
            print(f'\r{i + 1}/{len(jobs)} {" ".join(key):40}', end='', file=sys.stderr)
    return found


def tables_of(found: Found) -> Iterator[tuple[str, str]]:
    """Yield the tables of what was found, and their titles."""
    counts: dict[str, dict[str, Count]] = {}
    kinds: dict[tuple[str, ...], list[Outcome]] = {}
    totals: dict[tuple[str, ...], list[Outcome]] = {}
    for (vehicle, name, loss), part in found.items():
        if not loss:
            counts.setdefault(vehicle, {})[name] = part
        if loss in LOSSES and name in POOLED:
            kinds[vehicle, loss] = kinds.get((vehicle, loss), []) + part
        if loss == 'total':
            totals[vehicle, 'after a take-off' if name in TAKE_OFF else name] = part
    if counts:
        yield 'False alarms an hour', tables.alarms(counts)
    if any(part.landings or part.pushes for each in counts.values() for part in each.values()):
        yield 'Landings, take-offs and pushes', tables.contacts(counts)
    if kinds:
        yield 'Failures, by kind', tables.names(kinds, ('vehicle', 'failure'))
    if totals:
        yield 'Total losses, by condition', tables.names(
            dict(sorted(totals.items())), ('vehicle', 'condition'))
    for ways, title, made in (
        (WAYS, 'with the health told to the allocator', tables.goes_on),
        ([ACTING], 'without a failure that act on each name', tables.acted),
        ([AFTERWARDS], 'after a loss that act on each name', tables.acted),
    ):
        if flights := {key: part for key, part in found.items() if key[2] in ways}:
            yield f'Flights {title}', made(flights)


def parser_of_options() -> argparse.ArgumentParser:
    """Return the parser of the options."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add('--hours', type=amount, default=0.2, help='of each vehicle in each condition [h]')
    add('--losses', type=natural, default=30, help='of each vehicle and kind')
    add('--flights', type=natural, default=0,
        help='of each vehicle in which the allocator is told')
    add('--left', type=amount, default=0.0,
        help='share of its thrust that the rotor of --flights keeps')
    add('--mujoco', type=amount, default=0.0, help='of each vehicle, landings in MuJoCo [h]')
    add('--acting', type=amount, default=0.0,
        help='of each vehicle and condition, in which the allocator does what it is told [h]')
    add('--afterwards', type=amount, default=0.0,
        help='the same, from when a rotor is lost: further names of sound ones [h]')
    add('--vehicles', nargs='+', default=VEHICLES, choices=VEHICLES)
    add('--conditions', nargs='*', default=[*FLOWN], choices=FLOWN, metavar='NAME',
        help=f'of the hours: {", ".join(FLOWN)}')
    add('--kinds', nargs='*', default=[*LOSSES], choices=LOSSES, metavar='KIND',
        help=f'of failures: {", ".join(LOSSES).replace("%", "%%")}')
    add('--causes', action='store_true', help='conditions in which one thing alone is not ideal')
    add('--set', dest='settings', type=_setting, nargs='+', default=[], metavar='NAME=VALUE',
        help='settings of the detector, as in velocity_noise=0.05')
    add('--imu', nargs='?', const='beside', default='', choices=['beside', 'alone', 'stopped'],
        help='the detector gets the specific force, too, or angular velocity and this alone, or '
        f'this from {STOPPED:g} s on')
    add('--publish', action='store_true', help=f'seeds from {PUBLISHED} on')
    add('--first', type=natural, default=0, help='seed of the first flight, without --publish')
    add('--jobs', type=positive(int), default=1, help='processes')
    add('--out', type=Path, default=Path('out/detection'), metavar='DIR')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Fly and print the tables; return the exit code."""
    options, begin = parser_of_options().parse_args(argv), perf_counter()
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        with pool_of(options.jobs) as pool:
            found = run(options, pool)
    except (CaRosError, ModuleNotFoundError, OSError) as error:
        print(f'detection: {error}', file=sys.stderr)
        return 1
    first = PUBLISHED if options.publish else options.first
    text = '\n'.join(f'## {title}\n\n{table}' for title, table in tables_of(found))
    text += f'\nSeeds from {first} on; 95 % intervals; {perf_counter() - begin:.0f} s.\n'
    (options.out / 'alarms.md').write_text(text, encoding='utf-8')
    with (options.out / 'names.csv').open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(['vehicle', 'condition', 'failure', 'rotor', 'named', 'after', 'early'])
        for key, part in found.items():
            if key[2] in LOSSES:
                for each in part:
                    named = ' '.join(str(rotor + 1) for rotor in each.named)
                    writer.writerow([*key, each.rotor + 1, named, each.after, each.early])
    print(f'{text}\nwritten: alarms.md and names.csv in {options.out}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
