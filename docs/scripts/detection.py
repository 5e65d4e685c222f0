"""Fly the detector on every plant; fill benchmarks/detection/results.md and docs/detection.md.

Less than what is published is a trial, of two minutes with ``--hours 0.05``: it flies seeds from 0
on, and writes copies of both pages to out/detection.  Tables of what cannot be flown here stay
as they are; so do the sentences of both pages.
"""

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import chain
from math import ceil
from pathlib import Path
from time import perf_counter

from pages import DOCS, fill

from ca_ros.studies.tables import table

sys.path.append(str(DOCS.parent))
from benchmarks.detection import own_plant, real_flights, rotorpy_flights, tables
from benchmarks.detection.__main__ import Found, parser_of_options, pool_of, run, tables_of
from benchmarks.detection.flights import DURATION, POOLED, PUBLISHED, VEHICLES
from benchmarks.detection.reallocation import WAYS

HOURS = 3.4  # of a vehicle and a condition, as published; the other plants go with it
RESULTS, PAGE = DOCS.parent / 'benchmarks' / 'detection' / 'results.md', DOCS / 'detection.md'
OUT = DOCS.parent / 'out' / 'detection'
MINUTES, LOSSES = 120, 100  # in rotorpy

Rows = list[dict[str, str]]
"""The rows of a table of a page: cells by title."""


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
            soon = each[vehicle, 'landings', 'total']
            parts.append((
                f'{landings.landing_alarms}/{landings.landings}',
                f'{pushes.push_alarms}/{pushes.pushes}', str(sharp.alarms), *named(each, vehicle),
                f'{sum(outcome.arm for outcome in soon)}/{len(soon)}'))
        rows.append((f'`{vehicle}`', *('; '.join(cells) for cells in zip(*parts, strict=True))))
    titles = ('vehicle', 'landings with an alarm', 'pushes with an alarm', 'aggressive, alarms',
              'arm right', 'wrong', 'median, 90 % [ms]', 'after a take-off')
    return tables.table(titles, rows)


def without_states(found: Sequence[Found]) -> str:
    """Return the table of a detector whose states stop."""
    rows = []
    for vehicle in VEHICLES:
        pooled = [found[0][vehicle, name, ''] for name in POOLED]
        landings = found[0][vehicle, 'landings', '']
        rows.append((
            f'`{vehicle}`', str(sum(each.alarms for each in pooled)),
            f'{sum(each.hours for each in pooled):.2f}',
            f'{landings.landing_alarms}/{landings.landings}', *named(found[0], vehicle)))
    titles = 'vehicle', 'alarms', 'hours', 'landings with an alarm', 'arm right', 'wrong'
    return tables.table((*titles, 'median, 90 % [ms]'), rows)


def named(found: Found, vehicle: str) -> tuple[str, str, str]:
    """Return how many total losses are named right and wrong, and the times."""
    outcomes = list(chain.from_iterable(found[vehicle, name, 'total'] for name in POOLED))
    return (
        f'{sum(each.arm for each in outcomes)}/{len(outcomes)}',
        str(sum(each.wrong for each in outcomes)),
        ', '.join(tables.quantile(outcomes, q) for q in (0.5, 0.9)))


def partly_lost(found: Sequence[Found]) -> str:
    """Return the table of the quadrotor's flights with a weak rotor, one for each share left."""
    rows = []
    for words, each in zip(PARTS['left'].variants, found, strict=True):
        flights = [
            [flight for name in POOLED for flight in each['quadrotor', name, way]]
            for way in WAYS[:-1]]
        fly_on = (f'{sum(flight.flies for flight in own)}/{len(own)}' for own in flights)
        rows.append(('`quadrotor`', f'{100.0 * float(words.split()[1]):.0f} %', *fly_on))
    first, *others = WAYS[:-1]
    return tables.table(('vehicle', 'left', f'{first}: fly on', *others), rows)


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
    'latency': Part('--publish --losses 0 --hours 3 --conditions latency'),
    'total': Part('--publish --hours 0 --losses 400 --kinds total'),
    'kinds': Part("--publish --hours 0 --losses 400 --kinds '50 %' fade stuck"),
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

    Raises a `NotHereError` if this is not possible here.
    """
    if name == 'own_plant':
        every, seeds = max(1, round(1.0 / share)), max(1, round(share))
        text = own_plant.run(pool.map, seeds, every)
        line = f'`python -m benchmarks.detection.own_plant --seeds {seeds}`'
        line += f', one failure in {every}' if every > 1 else ''
        return {name: f'{line}{flown_with(own_plant.FIRST)}\n\n{text}'}
    if name == 'rotorpy':
        try:
            rotorpy_flights.check()
        except RuntimeError as error:
            raise NotHereError(error) from None
        first = 0 if trial else PUBLISHED
        minutes, losses = (max(len(VEHICLES), ceil(share * each)) for each in (MINUTES, LOSSES))
        text = rotorpy_flights.run(pool, minutes, losses, first)
        line = '`python docs/scripts/detection.py --only rotorpy'
        line += f'{f" --hours {HOURS * share:g}" * (share != 1.0)}`'
        return {name: f'{line}{flown_with(first)}\n\n{text}'}
    if clones is None:
        raise NotHereError('needs --flights')
    found = real_flights.run(pool, clones, DOCS.parent / 'out' / 'real_flights')
    if missing := fewer(found):
        raise NotHereError(f'flights that are published are missing: {", ".join(missing)}')
    line = '`python docs/scripts/detection.py --only real_flights --flights FOLDER`'
    sound, propellers = real_flights.tables_of(found)
    return {name: f'{line}{flown_with(None)}\n\n{sound}', 'propellers': propellers}


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


def read(text: str, mark: str) -> list[Rows]:
    """Return the tables of a marked part of a page."""
    [part] = re.findall(rf'<!-- {mark} -->\n(.*?)<!-- end of {mark} -->', text, re.DOTALL)
    found = []
    for lines in re.findall(r'(?:^\|.*\n)+', part, re.MULTILINE):
        titles, _, *rows = (
            [cell.strip() for cell in line.strip('|').split('|')] for line in lines.splitlines())
        found.append([dict(zip(titles, row, strict=True)) for row in rows])
    return found


def total(cells: Iterator[str] | Sequence[str]) -> tuple[int, int]:
    """Return the sum of cells such as ``3/402: 0.7 [0.2, 2.2]``: events and trials."""
    pairs = [tuple(map(int, cell.split(':')[0].split('/'))) for cell in cells]
    return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)


def of(cells: Iterator[str] | Sequence[str]) -> str:
    """Return the sum of such cells in words."""
    return '{} of {}'.format(*total(cells))


def column(rows: Rows, title: str, **where: str) -> list[str]:
    """Return the cells of a column, in the rows where others have certain values."""
    found = [row[title] for row in rows if all(row[key] == each for key, each in where.items())]
    if not found:
        raise ValueError(f'no row with {where}')
    return found


def summed(rows: Rows, title: str) -> float:
    """Return the sum of a column whose cells may have several numbers."""
    return sum(float(each) for cell in column(rows, title) for each in cell.split(', '))


def alarms_of(rows: Rows) -> str:
    """Return alarms and hours of a table of false alarms."""
    hours = summed(rows, 'hours')
    return f'{summed(rows, "alarms"):.0f} in {hours:.{0 if hours > 9.95 else 1}f} h'


def false_alarms(results: str) -> str:
    """Return the page's table of false alarms."""
    [pooled], (_, landings), (_, pushes), [late] = (
        read(results, name) for name in ('pooled', 'landings', 'pushes', 'latency'))
    take_off = int(summed(landings, 'alarms in take-off'))
    pushed = [total([cell]) for cell in column(pushes, 'pushes with an alarm [%]')]
    return table(('false alarms, all five vehicles', ''), [
        ('usual, turbulence of 4 to 8 m/s, aggressive at 9 m/s', alarms_of(pooled)),
        ('landings, wind up to 5 m/s',
         f'{of(column(landings, "landings with an alarm [%]"))}; {take_off or "no"} '
         f'alarm{"s" * (take_off > 1)} in take-off'),
        ('pushes of 0.3 m g for 0.1 to 1 s',
         f'{of(column(pushes, "pushes with an alarm [%]"))}: '
         f'{", ".join(str(alarms) for alarms, _ in pushed)} of {pushed[0][1]} in the order below'),
        ('10 ms of age and delay told, 20 ms true', alarms_of(late)),
    ], 2)


def losses(results: str) -> str:
    """Return the page's table of losses."""
    (whole, conditions), [kinds] = (read(results, name) for name in ('total', 'kinds'))
    right = 'arm right [%]'
    rows = []
    for row in whole:
        name = {'vehicle': row['vehicle']}
        [soon] = column(conditions, right, condition='after a take-off', **name)
        [half], [fades] = (column(kinds, right, failure=kind, **name) for kind in ('50 %', 'fade'))
        [median] = column(kinds, 'median [ms]', failure='50 %', **name)
        cells = row[right], row['wrong [%]'], soon, half, fades
        lost, wrong, soon, half, fades = (cell.split(':')[0] for cell in cells)
        times = f'{row["median [ms]"]}, {row["90 % [ms]"]}'
        rows.append(
            (row['vehicle'], lost, wrong.split('/')[0], times, soon, f'{half}, {median}', fades))
    return table(('', 'all thrust lost: arm right within 2 s', 'wrong', 'median, 90 % [ms]',
                  'soon after a take-off', 'half lost: arm right, median [ms]', 'fades of 2 s'),
                 rows, len(rows[0]))


def elsewhere(results: str) -> str:
    """Return the page's table of other plants, sensors and failures."""
    landings, losses, right, wrong = (
        'landings with an alarm', 'arm right', 'named right [%]', 'wrong')
    _, in_mujoco = read(results, 'mujoco')
    free, lost = read(results, 'rotorpy')
    [sensors], [stopped], [kinds], [ours] = (
        read(results, name) for name in ('imu', 'stopped', 'kinds', 'own plant'))
    rows = [
        ("landings on MuJoCo's contacts", of(column(in_mujoco, f'{landings} [%]')), '', ''),
        ('behind rotorpy', alarms_of(free), of(column(lost, 'arm right [%]')),
         str(total(column(lost, 'wrong [%]'))[0])),
    ]
    words = ('without an accelerometer', 'on the same seeds with it (`--imu`)',
             'it and angular velocity alone (`--imu alone`)')
    for i, name in enumerate(words):
        each = [{key: cell.split('; ')[i] for key, cell in row.items() if '; ' in cell}
                for row in sensors]
        rows.append((
            name, f'{of(column(each, landings))} landings, '
            f'{of(column(each, "pushes with an alarm"))} pushes, '
            f'{summed(each, "aggressive, alarms"):.0f} in aggressive flight',
            of(column(each, losses)), f'{summed(each, wrong):.0f}'))
    rows.append((
        'from 2 s after states stop (`--imu stopped`)',
        f'{of(column(stopped, landings))} landings, {alarms_of(stopped)} of flight',
        of(column(stopped, losses)), f'{summed(stopped, wrong):.0f}'))
    rows.append((
        'a rotor whose speed is stuck', '', of(column(kinds, 'arm right [%]', failure='stuck')),
        str(total(column(kinds, 'wrong [%]', failure='stuck'))[0])))
    failures = [
        ('on the plant of ca_ros, two rotors at once', {'failure': 'two at once'}),
        ('one, and another a second later', {'failure': 'one, then another'}),
        ('a servo of `hexarotor_tilting` sticks',
         {'failure': 'servo sticks', 'vehicle': '`hexarotor_tilting`'}),
        ('a servo of `tricopter` sticks', {'failure': 'servo sticks', 'vehicle': '`tricopter`'})]
    rows += [
        (name, '', of(column(ours, right, **where)),
         str(sum(map(int, column(ours, wrong, **where)))))
        for name, where in failures]
    return table(('other flights', 'false alarms', 'named right', 'another named'), rows, 4)


def way_back(results: str) -> str:
    """Return the page's table of flights that go on."""
    [told], [left] = read(results, 'told'), read(results, 'left')
    rows = []
    for vehicle in dict.fromkeys(column(told, 'vehicle')):
        counts = [total(column(told, f'{way}: fly on [%]', vehicle=vehicle)) for way in WAYS]
        rows.append((f'{vehicle}, of {counts[0][1]}', *(str(flights) for flights, _ in counts)))
    for row in left:
        counts = [total([row[each]]) for each in (f'{WAYS[0]}: fly on', *WAYS[1:-1])]
        rows.append((f'{row["vehicle"]}, {row["left"]} left, of {counts[0][1]}',
                     *(str(flights) for flights, _ in counts), ''))
    return table(('flights that go on', 'loss, told after 0.1 s', 'loss, as detected',
                  'nothing told', 'a loss told that is none', 'the same for 1 s'), rows, 6)


SHOWN = {
    'NanoBench': ('NanoBench', 'Crazyflie 2.1'),
    'indiflight': ('indiflight, by measured speeds', '5 inch quadrotor'),
    'data-driven-system-identification': ('data-driven-system-identification', 'Crazyflie'),
    'ACSL': ('ACSL', 'X8'),
    'CrazyPAD, whole propellers': ('CrazyPAD, whole propellers', 'Crazyflie 2.1'),
}
"""Sets of real flights on the page, and their vehicles."""


def real(results: str) -> str:
    """Return the page's table of real flights, and what it says of cut propellers."""
    [found], [propellers] = read(results, 'real flights'), read(results, 'propellers')
    phases = 'alarms: launch', 'flight', 'landing'
    rows = []
    for key, (name, vehicle) in SHOWN.items():
        [row] = (row for row in found if row['set'] == key)
        taken = of([row['taken rotors named right [%]']])
        median = row['median, 90 % [ms]'].split(',')[0]
        wrong = row['wrong'] if row['wrong'] != '0' else 'none'
        rows.append((
            name, vehicle, f'{row["in the air [s]"]} s, {row["flights"]} flights',
            ', '.join(row[phase] for phase in phases),
            f'{"arms, " * (vehicle == "X8")}{taken}, median {median} ms, {wrong} wrong',
            row['warnings of the lag']))
    titles = ('set', 'vehicle', 'in the air', 'alarms: launch, flight, landing',
              'taken rotors named right', 'warnings of the lag')
    alarms = sum(int(row[phase]) for row in found for phase in phases)
    seconds = summed(found, 'in the air [s]')
    low, high = tables.rate(alarms, seconds / 3600.0).split('[')[1].strip(']').split(', ')
    cut, most, weights = (
        '{} of {}'.format(*(
            sum(int(row[title]) for row in propellers if row['propellers'].startswith(words))
            for title in ('rotor 3', 'flights')))
        for words in ('rotor 3 cut', 'rotor 3 cut by 6.5', 'weights'))
    words = (
        f'Alarms: {alarms} in {seconds / 60.0:.0f} minutes, so {low} to {high} an hour. '
        f"Of CrazyPAD's cut propellers\nrotor 3 is named first in {cut} flights, in {most} if "
        f'both blades together lost more than 6 mm. Weights name\nrotor 3 in {weights}.')
    return f'{table(titles, rows, len(titles))}\n\n{words}'


def page_tables(results: str) -> dict[str, str]:
    """Return the marked parts of docs/detection.md, made of results.md."""
    made = real, way_back, false_alarms, losses, elsewhere
    return {each.__name__: each(results) for each in made}


def main(argv: Sequence[str] | None = None) -> None:
    """Fly, and fill the pages or their copies."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--hours', type=float, default=HOURS,
        help=f'of a vehicle and a condition in the air; all else goes with it; {HOURS} by default')
    add('--jobs', type=int, help='processes')
    add('--only', nargs='+', default=[*PARTS, *OTHERS], choices=[*PARTS, *OTHERS], metavar='NAME',
        help=f'tables: {", ".join([*PARTS, *OTHERS])}')
    add('--flights', type=Path, metavar='FOLDER',
        help='has the clones of python -m benchmarks.detection.real_flights --help')
    add('--publish', action='store_true',
        help='fly the seeds of what is published, and fill the pages, also in less than '
        f'{HOURS} hours')
    options = parser.parse_args(argv)
    share = options.hours / HOURS
    if not share > 0.0:
        parser.error(f'--hours: expected a positive number, got {options.hours}')
    trial = share < 1.0 and not options.publish
    results, page = RESULTS, PAGE
    if trial:
        results, page = (OUT / path.name for path in (RESULTS, PAGE))
        OUT.mkdir(parents=True, exist_ok=True)
        for path, copy in ((RESULTS, results), (PAGE, page)):
            copy.write_text(path.read_text(encoding='utf-8'), encoding='utf-8')
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
    print(f'written: {results}, {page}')


if __name__ == '__main__':
    main()
