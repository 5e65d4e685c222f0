"""The tables of docs/detection.md, made of those of benchmarks/detection/results.md."""

import re
import sys
from collections.abc import Sequence

from pages import DOCS

sys.path.append(str(DOCS.parent))
from benchmarks.detection.reallocation import WAYS
from benchmarks.detection.tables import rate, table

Rows = list[dict[str, str]]
"""The rows of a table of a page: cells by title."""

RIGHT, WRONG = 'arm right [%]', 'wrong [%]'


def read(text: str, mark: str) -> list[Rows]:
    """Return the tables of a marked part of a page."""
    [part] = re.findall(rf'<!-- {mark} -->\n(.*?)<!-- end of {mark} -->', text, re.DOTALL)
    found = []
    for lines in re.findall(r'(?:^\|.*\n)+', part, re.MULTILINE):
        titles, _, *rows = (
            [cell.strip() for cell in line.strip('|').split('|')] for line in lines.splitlines())
        found.append([dict(zip(titles, row, strict=True)) for row in rows])
    return found


def where(rows: Rows, **cells: str) -> Rows:
    """Return the rows where some cells have certain values."""
    found = [row for row in rows if cells.items() <= row.items()]
    if not found:
        raise ValueError(f'no row with {cells}')
    return found


def total(rows: Rows, title: str) -> tuple[int, int]:
    """Return the sum of cells such as ``3/402: 0.7 [0.2, 2.2]``: events and trials."""
    pairs = [row[title].split(':')[0].split('/') for row in rows]
    return sum(int(events) for events, _ in pairs), sum(int(trials) for _, trials in pairs)


def of(rows: Rows, title: str) -> str:
    """Return the sum of such cells in words."""
    return '{} of {}'.format(*total(rows, title))


def summed(rows: Rows, title: str) -> float:
    """Return the sum of a column: of all numbers of its cells, or of the events of such cells."""
    return sum(float(each) for row in rows for each in row[title].split('/')[0].split(', '))


def alarms_of(rows: Rows) -> str:
    """Return alarms and hours of a table of false alarms."""
    hours = summed(rows, 'hours')
    return f'{summed(rows, "alarms"):.0f} in {hours:.{0 if hours > 9.95 else 1}f} h'


def named(rows: Rows, right: str = RIGHT, wrong: str = WRONG) -> tuple[str, str]:
    """Return how many failures are named right and wrong, which columns say."""
    return of(rows, right), f'{summed(rows, wrong):.0f}'


def false_alarms(results: str) -> str:
    """Return the page's table of false alarms."""
    [pooled], (_, landings), (_, pushes), [others], [late] = (
        read(results, name)
        for name in ('pooled', 'landings', 'pushes', 'pushes elsewhere', 'latency'))
    take_off = int(summed(landings, 'alarms in take-off'))
    pushed = [total([row], 'pushes with an alarm [%]') for row in pushes]
    return table(('false alarms, all five vehicles', ''), [
        ('usual, turbulence of 4 to 8 m/s, aggressive at 9 m/s', alarms_of(pooled)),
        ('landings, wind up to 5 m/s',
         f'{of(landings, "landings with an alarm [%]")}; {take_off or "no"} '
         f'alarm{"s" * (take_off > 1)} in take-off'),
        ('pushes of 0.3 m g for 0.1 to 1 s, slow flight',
         f'{of(pushes, "pushes with an alarm [%]")}: '
         f'{", ".join(str(alarms) for alarms, _ in pushed)} of {pushed[0][1]} in the order below'),
        *((words, f'{of(others, title)}: {", ".join(row[title].split("/")[0] for row in others)}')
          for words, title in (
              ('the same in turbulence', 'pushes in turbulence [%]'),
              ('the same in aggressive flight', 'aggressive pushes [%]'),
              ('of 1 to 3 s, slow flight', 'long pushes [%]'))),
        ('10 ms of age and delay told, 20 ms true', alarms_of(late)),
    ])


def losses(results: str) -> str:
    """Return the page's table of losses."""
    (whole, conditions), [kinds] = (read(results, name) for name in ('total', 'kinds'))
    rows = []
    for row in whole:
        vehicle, times = row['vehicle'], f'{row["median [ms]"]}, {row["90 % [ms]"]}'
        [soon] = where(conditions, condition='after a take-off', vehicle=vehicle)
        [half], [fade] = (where(kinds, failure=kind, vehicle=vehicle) for kind in ('50 %', 'fade'))
        lost, at_once, weak, faded = (
            each[RIGHT].split(':')[0] for each in (row, soon, half, fade))
        rows.append((vehicle, lost, row[WRONG].split('/')[0], times, at_once,
                     f'{weak}, {half["median [ms]"]}', faded))
    return table(('', 'all thrust lost: arm right within 2 s', 'wrong', 'median, 90 % [ms]',
                  'soon after a take-off', 'half lost: arm right, median [ms]', 'fades of 2 s'),
                 rows)


def elsewhere(results: str) -> str:
    """Return the page's table of other plants, sensors and failures."""
    landings = 'landings with an alarm'
    _, in_mujoco = read(results, 'mujoco')
    free, lost = read(results, 'rotorpy')
    [px4], [sensors], [stopped], [kinds], [ours] = (
        read(results, name) for name in ('px4', 'imu', 'stopped', 'kinds', 'own plant'))
    minutes = summed(px4, 'in the air [s]') / 60.0
    alarms = summed(px4, 'alarms: in the air') + summed(px4, 'on the ground')
    rows = [
        ("landings on MuJoCo's contacts", of(in_mujoco, f'{landings} [%]'), '', ''),
        ('behind rotorpy', alarms_of(free), *named(lost)),
        ("behind PX4's controller and EKF2 in its simulator SIH",
         f'{alarms:.0f} in {minutes:.0f} minutes and {summed(px4, "landings"):.0f} landings',
         *named(px4, 'taken rotors named right [%]', 'wrong')),
    ]
    words = ('without an accelerometer', 'on the same seeds with it (`--imu`)',
             'it and angular velocity alone (`--imu alone`)')
    for i, name in enumerate(words):
        each = [{key: cell.split('; ')[i] for key, cell in row.items() if '; ' in cell}
                for row in sensors]
        rows.append((
            name, f'{of(each, landings)} landings, {of(each, "pushes with an alarm")} pushes, '
            f'{summed(each, "aggressive, alarms"):.0f} in aggressive flight',
            *named(each, 'arm right', 'wrong')))
    rows += [
        ('from 2 s after states stop (`--imu stopped`)',
         f'{of(stopped, landings)} landings, {alarms_of(stopped)} of flight',
         *named(stopped, 'arm right', 'wrong')),
        ('a rotor whose speed is stuck', '', *named(where(kinds, failure='stuck')))]
    failures = [
        ('on the plant of ca_ros, two rotors at once', {'failure': 'two at once'}),
        ('one, and another a second later', {'failure': 'one, then another'}),
        ('a servo of `hexarotor_tilting` sticks',
         {'failure': 'servo sticks', 'vehicle': '`hexarotor_tilting`'}),
        ('a servo of `tricopter` sticks', {'failure': 'servo sticks', 'vehicle': '`tricopter`'})]
    rows += [(name, '', *named(where(ours, **cells), 'named right [%]', 'wrong'))
             for name, cells in failures]
    return table(('other flights', 'false alarms', 'named right', 'another named'), rows)


def way_back(results: str) -> str:
    """Return the page's table of flights that go on."""
    [told], [left] = read(results, 'told'), read(results, 'left')

    def row(name: str, rows: Rows, titles: Sequence[str]) -> tuple[str, ...]:
        counts = [total(rows, title) for title in titles]
        cells = (str(flights) for flights, _ in counts)
        return f'{name}, of {counts[0][1]}', *cells, *[''] * (len(WAYS) - len(counts))

    of_told = [f'{way}: fly on [%]' for way in WAYS]
    of_left = f'{WAYS[0]}: fly on', *WAYS[1:-1]
    vehicles = dict.fromkeys(each['vehicle'] for each in told)
    return table(
        ('flights that go on', 'loss, told after 0.1 s', 'loss, as detected', 'nothing told',
         'a loss told that is none', 'the same for 1 s'),
        [*(row(name, where(told, vehicle=name), of_told) for name in vehicles),
         *(row(f'{each["vehicle"]}, {each["left"]} left', [each], of_left) for each in left)])


SHOWN = {
    'NanoBench': 'Crazyflie 2.1',
    'indiflight, by measured speeds': '5 inch quadrotor',
    'data-driven-system-identification': 'Crazyflie',
    'ACSL': 'X8',
    'CrazyPAD, whole propellers': 'Crazyflie 2.1',
}
"""Sets of real flights on the page, and their vehicles."""


def real(results: str) -> str:
    """Return the page's table of real flights, and what it says of cut propellers."""
    [found], [propellers] = read(results, 'real flights'), read(results, 'propellers')
    phases = 'alarms: launch', 'flight', 'landing'
    rows = []
    for name, vehicle in SHOWN.items():
        [row] = where(found, set=name.removesuffix(', by measured speeds'))
        median = row['median, 90 % [ms]'].split(',')[0]
        wrong = row['wrong'] if row['wrong'] != '0' else 'none'
        rows.append((
            name, vehicle, f'{row["in the air [s]"]} s, {row["flights"]} flights',
            ', '.join(row[phase] for phase in phases),
            f'{"arms, " * (vehicle == "X8")}{of([row], "taken rotors named right [%]")}, '
            f'median {median} ms, {wrong} wrong', row['warnings of the lag']))
    titles = ('set', 'vehicle', 'in the air', 'alarms: launch, flight, landing',
              'taken rotors named right', 'warnings of the lag')
    alarms = sum(int(summed(found, phase)) for phase in phases)
    seconds = summed(found, 'in the air [s]')
    low, high = rate(alarms, seconds / 3600.0).split('[')[1].strip(']').split(', ')
    cut, most, weights = (
        '{:.0f} of {:.0f}'.format(*(
            summed([row for row in propellers if row['propellers'].startswith(words)], title)
            for title in ('rotor 3', 'flights')))
        for words in ('rotor 3 cut', 'rotor 3 cut by 6.5', 'weights'))
    return (
        f'{table(titles, rows)}\n'
        f'Alarms: {alarms} in {seconds / 60.0:.0f} minutes, so {low} to {high} an hour. '
        f"Of CrazyPAD's cut propellers\nrotor 3 is named first in {cut} flights, in {most} if "
        f'both blades together lost more than 6 mm. Weights name\nrotor 3 in {weights}.')


def page_tables(results: str) -> dict[str, str]:
    """Return the marked parts of docs/detection.md, made of results.md."""
    made = real, way_back, false_alarms, losses, elsewhere
    return {each.__name__: each(results).strip() for each in made}
