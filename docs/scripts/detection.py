"""Fly the detector on every plant; fill benchmarks/detection/results.md and docs/detection.md.

Less than what is published is a trial (``--hours 0.05``, some minutes): it flies seeds from 0
on, and writes copies of both pages to out/detection.  Tables of what cannot be flown here stay
as they are; so do the sentences of both pages.
"""

import argparse
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from time import perf_counter
from typing import Any

from detection_page import page_tables, read
from pages import DOCS, fill

sys.path.append(str(DOCS.parent))
from benchmarks.detection import own_plant, real_flights, rotorpy_flights, tables
from benchmarks.detection.__main__ import Found, parser_of_options, pool_of, run, tables_of
from benchmarks.detection.flights import DURATION, POOLED, PUBLISHED, VEHICLES, Count, Outcome
from benchmarks.detection.reallocation import WAYS
from ca_ros.arguments import positive

HOURS = 3.4  # of a vehicle and a condition, as published; the other plants go with it
RESULTS, PAGE = DOCS.parent / 'benchmarks' / 'detection' / 'results.md', DOCS / 'detection.md'
OUT = DOCS.parent / 'out' / 'detection'
MINUTES, LOSSES = 120, 100  # in rotorpy
PUSHED = 'pushes in turbulence', 'aggressive pushes', 'long pushes'


class NotHereError(Exception):
    """Something that is needed to fly is not here."""


def plain(found: Sequence[Found]) -> str:
    """Return the tables of one command."""
    return '\n'.join(text for _, text in tables_of(found[0]))


def by_sensors(found: Sequence[Found]) -> str:
    """Return the table of detectors with other inputs: cells have one part for each."""
    rows = []
    for vehicle in VEHICLES:
        parts = []
        for each in found:
            landings, pushes, sharp = (
                each[vehicle, name, ''] for name in ('landings', 'pushes', 'aggressive'))
            soon, *_ = named(each[vehicle, 'landings', 'total'])
            parts.append((
                f'{landings.landing_alarms}/{landings.landings}',
                f'{pushes.push_alarms}/{pushes.pushes}', str(sharp.alarms),
                *named(pooled(each, vehicle, 'total', [])), soon))
        rows.append((f'`{vehicle}`', *('; '.join(cells) for cells in zip(*parts, strict=True))))
    titles = ('vehicle', 'landings with an alarm', 'pushes with an alarm', 'aggressive, alarms',
              'arm right', 'wrong', 'median, 90 % [ms]', 'after a take-off')
    return tables.table(titles, rows)


def by_pushes(found: Sequence[Found]) -> str:
    """Return the table of pushes with an alarm, a condition a column."""
    rows = []
    for vehicle in VEHICLES:
        counts = [each[vehicle, name, ''] for each, name in zip(found, PUSHED, strict=True)]
        rows.append((f'`{vehicle}`', *(
            tables.share(count.push_alarms, count.pushes) for count in counts)))
    return tables.table(('vehicle', *(f'{name} [%]' for name in PUSHED)), rows)


def without_states(found: Sequence[Found]) -> str:
    """Return the table of a detector whose states stop."""
    rows = []
    for vehicle in VEHICLES:
        sound, landings = pooled(found[0], vehicle, '', Count()), found[0][vehicle, 'landings', '']
        rows.append((
            f'`{vehicle}`', str(sound.alarms), f'{sound.hours:.2f}',
            f'{landings.landing_alarms}/{landings.landings}',
            *named(pooled(found[0], vehicle, 'total', []))))
    titles = 'vehicle', 'alarms', 'hours', 'landings with an alarm', 'arm right', 'wrong'
    return tables.table((*titles, 'median, 90 % [ms]'), rows)


def partly_lost(found: Sequence[Found]) -> str:
    """Return the table of the quadrotor's flights with a weak rotor, one for each share left."""
    rows = []
    for words, each in zip(PARTS['left'].variants, found, strict=True):
        flights = (pooled(each, 'quadrotor', way, []) for way in WAYS[:-1])
        fly_on = (f'{sum(flight.flies for flight in own)}/{len(own)}' for own in flights)
        rows.append(('`quadrotor`', f'{100.0 * float(words.split()[1]):.0f} %', *fly_on))
    first, *others = WAYS[:-1]
    return tables.table(('vehicle', 'left', f'{first}: fly on', *others), rows)


def pooled(found: Found, vehicle: str, kind: str, nothing: Any) -> Any:
    """Return what was found of a kind in the conditions that are added, from nothing on."""
    return sum((found[vehicle, name, kind] for name in POOLED), nothing)


def named(outcomes: Sequence[Outcome]) -> tuple[str, str, str]:
    """Return how many losses are named right and wrong, and the times."""
    return (
        f'{sum(each.arm for each in outcomes)}/{len(outcomes)}',
        str(sum(each.wrong for each in outcomes)),
        ', '.join(tables.quantile(outcomes, q) for q in (0.5, 0.9)))


@dataclass(frozen=True)
class Part:
    """Flights of ``python -m benchmarks.detection``.

    - `command`: its options; `variants`: more of them, one for each run
    - `tables`: makes the tables of what the runs found
    """

    command: str
    variants: tuple[str, ...] = ('',)
    tables: Callable[[Sequence[Found]], str] = plain

    def fly(self, pool: ProcessPoolExecutor, share: float, trial: bool) -> str:
        """Return the line with the command, and the tables."""
        command = scaled(self.command, share, trial)
        options = [
            parser_of_options().parse_args(shlex.split(f'{command} {more}'))
            for more in self.variants]
        line = f'`python -m benchmarks.detection {command}`'
        if self.variants != ('',):
            line += ''.join(f', with `{more}`' if more else ', as it is' for more in self.variants)
        found = [run(each, pool) for each in options]
        return f'{line}{flown_with(PUBLISHED * options[0].publish)}\n\n{self.tables(found)}'


PARTS = {
    'pooled': Part('--publish --losses 0 --hours 3.4 --conditions usual turbulence aggressive'),
    'landings': Part('--publish --losses 0 --hours 2.6 --conditions landings'),
    'pushes': Part('--publish --losses 0 --hours 15 --conditions pushes'),
    'pushes_elsewhere': Part(
        '--publish --losses 0 --hours 7.5',
        tuple(f"--conditions '{name}'" for name in PUSHED), by_pushes),
    'latency': Part('--publish --losses 0 --hours 3 --conditions latency'),
    'total': Part('--publish --hours 0 --losses 400 --kinds total'),
    'kinds': Part("--publish --hours 0 --losses 400 --kinds '50 %' '30 %' fade stuck"),
    'mujoco': Part('--publish --hours 0 --losses 0 --mujoco 1.3'),
    'imu': Part('--publish --hours 0.1 --losses 30 --kinds total --conditions landings aggressive '
                'pushes', ('', '--imu', '--imu alone'), by_sensors),
    'stopped': Part('--hours 0.34 --losses 60 --kinds total --conditions usual turbulence '
                    'aggressive landings --imu stopped', tables=without_states),
    'told': Part('--publish --hours 0 --losses 0 --flights 81'),
    'left': Part('--hours 0 --losses 0 --flights 90 --vehicles quadrotor',
                 ('--left 0.3', '--left 0.5'), partly_lost),
    'acting': Part('--publish --hours 0 --losses 0 --acting 0.3 --conditions landings aggressive '
                   'pushes'),
    'afterwards': Part('--publish --hours 0 --losses 0 --afterwards 0.5'),
}
"""The plant of benchmarks.detection, by the mark of the tables in results.md."""

OTHERS = 'own_plant', 'rotorpy', 'real_flights'
"""The plants of others, and ours; the last fills *propellers*, too."""


def scaled(command: str, share: float, trial: bool) -> str:
    """Return a command that flies a share of the hours and of the failures, at least one each."""

    def times(match: re.Match[str]) -> str:
        name, amount = match[1], float(match[2])
        if name in ('losses', 'flights'):
            return f'--{name} {ceil(share * amount)}'
        return f'--{name} {max(share * amount, DURATION / 3600.0) if amount else 0.0:.3g}'

    if share != 1.0:
        names = 'hours|losses|flights|mujoco|acting|afterwards'
        command = re.sub(rf'--({names}) ([\d.]+)', times, command)
    return command.replace('--publish ', '') if trial else command


def flown_with(first: int | None) -> str:
    """Return the end of the line above a table: commit of the detector, and first seed."""
    log, changes = (
        subprocess.run(['git', *words, '--', 'ca_ros'], cwd=DOCS.parent, capture_output=True,
                       text=True, check=False).stdout.strip()
        for words in (['log', '-1', '--format=%h'], ['diff', '--shortstat', 'HEAD']))
    commit = (log or 'an unknown commit') + ' and changes' * bool(changes)
    seeds = '' if first is None else f', seeds from {first} on'
    return f' (detector of {commit}{seeds}):'


def fly_other(
    name: str, pool: ProcessPoolExecutor, share: float, trial: bool, clones: Path | None
) -> dict[str, str]:
    """Fly one of `OTHERS`; return what the marked parts of results.md get.

    Raises a `NotHereError` or a ModuleNotFoundError if this is not possible here.
    """
    first: int | None = 0 if trial else PUBLISHED
    more = {}
    if name == 'own_plant':
        every, seeds, first = max(1, round(1.0 / share)), max(1, round(share)), own_plant.FIRST
        line = f'`python -m benchmarks.detection.own_plant --seeds {seeds}`'
        line += f', one failure in {every}' * (every > 1)
        text = own_plant.run(pool.map, seeds, every)
    elif name == 'rotorpy':
        line = '`python docs/scripts/detection.py --only rotorpy'
        line += f'{f" --hours {HOURS * share:g}" * (share != 1.0)}`'
        minutes, losses = (max(len(VEHICLES), ceil(share * each)) for each in (MINUTES, LOSSES))
        text = rotorpy_flights.run(pool, minutes, losses, first or 0)
    elif clones is None:
        raise NotHereError('needs --flights')
    else:
        found, first = real_flights.run(pool, clones, DOCS.parent / 'out' / 'real_flights'), None
        if missing := fewer(found):
            raise NotHereError(f'flights that are published are missing: {", ".join(missing)}')
        line = '`python docs/scripts/detection.py --only real_flights --flights FOLDER`'
        text, more['propellers'] = real_flights.tables_of(found)
    return {name: f'{line}{flown_with(first)}\n\n{text}', **more}


def fewer(found: Mapping[str, Mapping[str, Sequence[object]]]) -> list[str]:
    """Return where real flights, by set and row, are fewer than in results.md."""
    text = RESULTS.read_text(encoding='utf-8')
    [sound], [propellers] = read(text, 'real flights'), read(text, 'propellers')
    places = [(*row['set'].partition(', ')[::2], row['flights']) for row in sound]
    places += [('CrazyPAD', row['propellers'], row['flights']) for row in propellers]
    counts = [(name, row, len(found[name].get(row, [])), int(flights))
              for name, row, flights in dict.fromkeys(places)]
    return [f'{name}{row and " "}{row} {count} of {flights}'
            for name, row, count, flights in counts if count < flights]


def main(argv: Sequence[str] | None = None) -> None:
    """Fly, and fill the pages or their copies."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--hours', type=positive(float), default=HOURS,
        help=f'of a vehicle and a condition in the air; all else goes with it; {HOURS} by default')
    add('--jobs', type=positive(int), help='processes')
    add('--only', nargs='+', default=[*PARTS, *OTHERS], choices=[*PARTS, *OTHERS], metavar='NAME',
        help=f'tables: {", ".join([*PARTS, *OTHERS])}')
    add('--flights', type=Path, metavar='FOLDER',
        help='has the clones of python -m benchmarks.detection.real_flights --help')
    options = parser.parse_args(argv)
    if options.flights is not None and not options.flights.is_dir():
        parser.error(f'--flights: no such folder: {options.flights}')
    share = options.hours / HOURS
    trial, results, page = share < 1.0, RESULTS, PAGE
    if trial:
        OUT.mkdir(parents=True, exist_ok=True)
        results, page = (Path(shutil.copy(path, OUT)) for path in (RESULTS, PAGE))
    filled = False
    with pool_of(options.jobs) as pool:
        for name in options.only:
            begin = perf_counter()
            try:
                if name in PARTS:
                    found = {name: PARTS[name].fly(pool, share, trial)}
                else:
                    found = fly_other(name, pool, share, trial, options.flights)
            except (NotHereError, ModuleNotFoundError) as error:
                print(f'{name}: left as it is: {error}', file=sys.stderr)
                continue
            fill(str(results), **{mark: text.strip() for mark, text in found.items()})
            fill(str(page), **page_tables(results.read_text(encoding='utf-8')))
            print(f'{name}: {perf_counter() - begin:.0f} s', flush=True)
            filled = True
    if filled:
        print(f'written: {results}, {page}')


if __name__ == '__main__':
    main()
