"""Tables of what was counted, with 95 % intervals."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy import stats

from benchmarks.detection.flights import POOLED, Count, Outcome
from benchmarks.detection.reallocation import Acted, Flown


def rate(events: int, hours: float) -> str:
    """Return events an hour with the exact interval of a Poisson process."""
    low = stats.chi2.ppf(0.025, 2 * events) / 2.0 if events else 0.0
    high = stats.chi2.ppf(0.975, 2 * events + 2) / 2.0
    return f'{_short(events / hours)} [{_short(low / hours)}, {_short(high / hours)}]'


def share(events: int, trials: int) -> str:
    """Return events of trials with the interval of Clopper and Pearson [%]."""
    low = stats.beta.ppf(0.025, events, trials - events + 1) if events else 0.0
    high = stats.beta.ppf(0.975, events + 1, trials - events) if events < trials else 1.0
    found, low, high = (f'{100.0 * each:.1f}' for each in (events / trials, low, high))
    return f'{events}/{trials}: {found} [{low}, {high}]'


def _short(x: float) -> str:
    return f'{x:.0f}' if x >= 99.5 else f'{x:.1f}'


def _pooled(counts: Mapping[str, Count]) -> Count:
    total = Count()
    for name in POOLED:
        if name in counts:
            total.hours += counts[name].hours
            total.alarms += counts[name].alarms
    return total


def alarms(found: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of false alarms an hour, a vehicle a row."""
    names = list(dict.fromkeys(name for counts in found.values() for name in counts))
    pool = set(POOLED) <= set(names)
    head = ['vehicle', *names, *(['pooled'] if pool else []), 'alarms', 'hours', 'turned over']
    rows = []
    for vehicle, counts in found.items():
        cells = [rate(counts[name].alarms, counts[name].hours) for name in names]
        if pool:
            total = _pooled(counts)
            cells.append(rate(total.alarms, total.hours))
        cells.append(', '.join(str(counts[name].alarms) for name in names))
        cells.append(', '.join(f'{counts[name].hours:.2f}' for name in names))
        cells.append(str(sum(count.overturned for count in counts.values())))
        rows.append([f'`{vehicle}`', *cells])
    return table(head, rows)


def contacts(found: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of landings, take-offs and pushes with an alarm."""
    rows = []
    for vehicle, counts in found.items():
        every = list(counts.values())
        landings, pushes = (sum(getattr(each, name) for each in every)
                            for name in ('landings', 'pushes'))
        rows.append([
            f'`{vehicle}`',
            share(sum(each.landing_alarms for each in every), landings) if landings else '',
            str(sum(each.takeoff_alarms for each in every)) if landings else '',
            share(sum(each.push_alarms for each in every), pushes) if pushes else '',
        ])
    head = ['vehicle', 'landings with an alarm [%]', 'alarms in take-off',
            'pushes with an alarm [%]']
    return table(head, rows)


def names(found: Mapping[tuple[str, ...], Sequence[Outcome]], labels: Sequence[str]) -> str:
    """Return the table of failures; the keys have the labels.

    *Wrong* counts other arms and the partner named alone.
    """
    head = [*labels, 'named [%]', 'arm right [%]', 'rotor alone right [%]', 'wrong [%]',
            'of these the partner', 'median [ms]', '90 % [ms]', 'alarms before']
    rows = []
    for key, outcomes in found.items():
        total = len(outcomes)
        rows.append([
            f'`{key[0]}`', *key[1:],
            share(sum(bool(each.named) for each in outcomes), total),
            share(sum(each.arm for each in outcomes), total),
            share(sum(each.right for each in outcomes), total),
            share(sum(each.wrong for each in outcomes), total),
            str(sum(each.same_arm for each in outcomes)),
            *(quantile(outcomes, q) for q in (0.5, 0.9)),
            str(sum(each.early for each in outcomes)),
        ])
    return table(head, rows)


def goes_on(found: Mapping[tuple[str, ...], Sequence[Flown]], ways: Sequence[str]) -> str:
    """Return the table of flights that go on; keys have vehicle, condition, way.

    *Arms* counts those that the detector names, those of which it tells the rotor, and how often
    this is the sound one.
    """
    rows = []
    for vehicle, name in dict.fromkeys(key[:2] for key in found):
        flights = [found[vehicle, name, way] for way in ways]
        rows.append([
            f'`{vehicle}`', name,
            *(share(sum(each.flies for each in own), len(own)) for own in flights),
            _arms(found[vehicle, name, 'detected']), *(_spread(own) for own in flights),
        ])
    head = ['vehicle', 'condition', *(f'{way}: fly on [%]' for way in ways), 'arms, told, wrong',
            *(f'{way}: tilt, drop' for way in ways)]
    return table(head, rows)


def acted(found: Mapping[tuple[str, ...], Acted]) -> str:
    """Return the table of flights that act on what is named; keys have vehicle and condition."""
    rows = [
        [f'`{vehicle}`', name, rate(each.names, each.hours),
         f'{each.without / each.hours:.0f}', str(each.turned_over), f'{each.hours:.2f}']
        for (vehicle, name, *_), each in found.items()
    ]
    head = ['vehicle', 'condition', 'names an hour', 'seconds an hour without a sound rotor',
            'turned over', 'hours']
    return table(head, rows)


def _arms(flights: Sequence[Flown]) -> str:
    told = [each for each in flights if each.told]
    wrong = sum(each.rotor not in each.without for each in told)
    return f'{sum(each.arm for each in flights)}, {len(told)}, {wrong}'


def _spread(flights: Sequence[Flown]) -> str:
    tilt = np.degrees(np.median([each.tilt for each in flights]))
    return f'{tilt:.0f}°, {np.median([each.drop for each in flights]):.1f} m'


def quantile(outcomes: Iterable[Outcome], q: float) -> str:
    """Return a quantile of the time to the arm's name; failures without it come last."""
    times = sorted(each.after if each.arm else np.inf for each in outcomes)
    found = times[min(int(q * len(times)), len(times) - 1)]
    return f'{1e3 * found:.0f}' if np.isfinite(found) else 'never'


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines) + '\n'
