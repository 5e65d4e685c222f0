"""Tables of what was counted, with 95 % intervals."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.special import betaincinv, gammaincinv

from benchmarks.detection.flights import POOLED, Count, Outcome
from benchmarks.detection.reallocation import WAYS, Acted, Flown


def rate(events: int, hours: float) -> str:
    """Return events an hour with the exact interval of a Poisson process."""
    low = gammaincinv(events, 0.025) if events else 0.0
    high = gammaincinv(events + 1, 0.975)
    return f'{_short(events / hours)} [{_short(low / hours)}, {_short(high / hours)}]'


def share(events: int, trials: int) -> str:
    """Return events of trials with the interval of Clopper and Pearson [%]."""
    low = betaincinv(events, trials - events + 1, 0.025) if events else 0.0
    high = betaincinv(events + 1, trials - events, 0.975) if events < trials else 1.0
    found, low, high = (f'{100.0 * each:.1f}' for each in (events / trials, low, high))
    return f'{events}/{trials}: {found} [{low}, {high}]'


def _short(x: float) -> str:
    return f'{x:.0f}' if x >= 99.5 else f'{x:.1f}'


def alarms(found: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of false alarms an hour, a vehicle a row."""
    names = list(dict.fromkeys(name for counts in found.values() for name in counts))
    pool = set(POOLED) <= set(names)
    head = ['vehicle', *names, *['pooled'] * pool, 'alarms', 'hours', 'turned over']
    rows = []
    for vehicle, counts in found.items():
        own = [counts[name] for name in names]
        total = [sum((counts[name] for name in POOLED), Count())] if pool else []
        rows.append([
            f'`{vehicle}`', *(rate(each.alarms, each.hours) for each in [*own, *total]),
            ', '.join(str(each.alarms) for each in own),
            ', '.join(f'{each.hours:.2f}' for each in own),
            str(sum(each.overturned for each in own))])
    return table(head, rows)


def contacts(found: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of landings, take-offs and pushes with an alarm."""
    rows = []
    for vehicle, counts in found.items():
        count = sum(counts.values(), Count())
        rows.append([
            f'`{vehicle}`',
            share(count.landing_alarms, count.landings) if count.landings else '',
            str(count.takeoff_alarms) if count.landings else '',
            share(count.push_alarms, count.pushes) if count.pushes else ''])
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
        rows.append([
            f'`{key[0]}`', *key[1:],
            *(share(sum(bool(getattr(each, name)) for each in outcomes), len(outcomes))
              for name in ('named', 'arm', 'right', 'wrong')),
            str(sum(each.same_arm for each in outcomes)),
            *(quantile(outcomes, q) for q in (0.5, 0.9)),
            str(sum(each.early for each in outcomes)),
        ])
    return table(head, rows)


def goes_on(found: Mapping[tuple[str, ...], Sequence[Flown]]) -> str:
    """Return the table of flights that go on; keys have vehicle, condition, way.

    *Arms* counts those that the detector names, those of which it tells the rotor, and how often
    this is the sound one.
    """
    rows = []
    for vehicle, name in dict.fromkeys(key[:2] for key in found):
        flights = [found[vehicle, name, way] for way in WAYS]
        rows.append([
            f'`{vehicle}`', name,
            *(share(sum(each.flies for each in own), len(own)) for own in flights),
            _arms(found[vehicle, name, 'detected']), *(_spread(own) for own in flights),
        ])
    head = ['vehicle', 'condition', *(f'{way}: fly on [%]' for way in WAYS), 'arms, told, wrong',
            *(f'{way}: tilt, drop' for way in WAYS)]
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
