"""Compare all methods on wrenches and in flight; fill the tables of docs/comparison.md.

Also draws the plot of the page.  Takes some minutes.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from flights import Outcome, both_masses, compared
from matplotlib.figure import Figure
from pages import DOCS, fill

from ca_ros import AdmissibleSet
from ca_ros.allocation import ALLOCATORS
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.plot_style import title
from ca_ros.evaluation.tables import latex, table
from ca_ros.evaluation.wrench_metrics import NOTED, metrics
from ca_ros.evaluation.wrench_sets import samples
from ca_ros.figures import save, sheet, style

AIRMODE = 'allocation.sequential_desaturation.airmode:=roll_pitch'

CONTENDERS: dict[str, tuple[str, tuple[str, ...]]] = {
    **{name: (name, ()) for name in ALLOCATORS if name != 'weighted_pseudo_inverse'},
    'direct_about_hover': ('direct_about_hover', ()),
    'sequential_desaturation, airmode': ('sequential_desaturation', (AIRMODE,)),
    'daqp_hierarchical': ('daqp_hierarchical', ()),
}
"""Method and parameters of each row."""

VEHICLES = ('quadrotor', 'hexarotor', 'octorotor', 'x8', 'y6')
SAMPLES, SEED = 1000, 0

GROUPS = {'upsets': 'upset', 'spins': 'spin', 'rotor lost': 'loss', 'slalom': 'slalom'}
"""How the names of the manoeuvres of each group begin."""

Outcomes = dict[tuple[str, str], Outcome]


def outcomes(label: str, vehicles: Sequence[str]) -> Outcomes:
    """Return the outcomes of all flights of a contender by vehicle and manoeuvre."""
    method, changes = CONTENDERS[label]
    return {
        (title, manoeuvre): outcome for name in vehicles
        for title, case in both_masses(name, changes, [method])
        for manoeuvre, outcome in compared(case, method)
    }


def static(name: str, labels: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the metrics of each contender on wrenches inside and outside the admissible set."""
    chosen = {label: CONTENDERS[label] for label in labels}
    cases = {label: Case.load(name, own, [method]) for label, (method, own) in chosen.items()}
    allocators = {label: cases[label].allocator(CONTENDERS[label][0]) for label in labels}
    admissible = AdmissibleSet(next(iter(cases.values())).problem)
    problem = admissible.problem
    found: dict[str, dict[str, Any]] = {}
    demands = {kind: samples(admissible, kind, SEED, 0, SAMPLES) for kind in ('volume', 'outside')}
    for label, allocator in allocators.items():
        thrusts = {kind: allocator.allocate_batch(u).thrusts for kind, u in demands.items()}
        residual = problem.residual(demands['volume'], thrusts['volume'])
        found[label] = {
            'missed': float((np.abs(residual) > NOTED * problem.extent).any(axis=1).mean()),
            'error': np.linalg.norm(residual, axis=1),
            'inside': metrics(problem, demands['volume'], thrusts['volume']),
            'outside': metrics(problem, demands['outside'], thrusts['outside']),
        }
    return found


def percent(share: float) -> str:
    """Return a share in percent with three digits."""
    return f'{abs(round(100.0 * share, 2)):.3g}'


def wrenches_table(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the table of the metrics on wrenches."""
    rows = []
    for label, own in found.items():
        outside, error = own['outside'], own['error']
        excess = f'{100.0 * abs(own["inside"]["energy_excess"]):.3f}'
        cells = percent(own['missed']), f'{error.mean():.1e} / {error.max():.1e}', excess
        shares = map(percent, (*outside['lost'].values(), outside['reversed']))
        rows.append((f'`{label}`', *cells, *shares))
    titles = (
        *('method', 'missed [%]', 'error, mean / max', 'energy above least [%]'),
        *('roll and pitch lost [%]', 'thrust lost [%]', 'yaw lost [%]'), 'reversed [%]',
    )
    return table(titles, rows)


def flights_table(found: Mapping[str, Outcomes]) -> str:
    """Return the table of recoveries, height lost, energy and smoothness."""

    def slalom(own: Outcomes) -> float:
        return sum(each.change for (_, name), each in own.items() if name == 'slalom')

    rows = []
    for label, own in found.items():
        recoveries = [recovered(own, start) for start in GROUPS.values()]
        drops = [each.height_lost for (_, name), each in own.items() if name.startswith('upset')]
        change = 100.0 * slalom(own) / slalom(found['exact'])
        rows.append((f'`{label}`', *recoveries, f'{np.median(drops):.2f}', f'{change:.1f}'))
    titles = (
        *('method', *GROUPS, 'height lost in upsets, median [m]'),
        'change of thrust, slalom [% of `exact`]',
    )
    return table(titles, rows)


def recovered(own: Outcomes, start: str) -> str:
    """Return how many flights of a group ended at their waypoints."""
    group = [each for (_, name), each in own.items() if name.startswith(start)]
    return f'{sum(each.recovered for each in group):.0f}/{len(group)}'


def realistic_table(ideal: Mapping[str, Outcomes], real: Mapping[str, Outcomes]) -> str:
    """Return the table of recoveries of an ideal vehicle, and of a realistic one."""
    rows = [
        (f'`{label}`', *(f'{recovered(ideal[label], start)}, {recovered(real[label], start)}'
                         for start in GROUPS.values()))
        for label in real
    ]  # fmt: skip
    return table(('method', *(f'{group}: ideal, realistic' for group in GROUPS)), rows)


def draw(wrenches: Mapping[str, Mapping[str, Any]], found: Mapping[str, Outcomes]) -> Figure:
    """Draw four metrics as bars, one row per method; black is `exact`."""
    outside = [own['outside'] for own in wrenches.values()]
    tilts = [100.0 * own['lost']['roll and pitch'] for own in outside]
    lost = [float(sum(not each.recovered for each in own.values())) for own in found.values()]
    panels: dict[str, list[float]] = {
        'attainable\nwrenches\nmissed [%]': [100.0 * own['missed'] for own in wrenches.values()],
        'roll and pitch\nlost, unat-\ntainable [%]': tilts,
        'reversed axis,\nunattainable\n[%]': [100.0 * own['reversed'] for own in outside],
        f'flights lost\nof {len(found["exact"])}': lost,
    }
    with matplotlib.rc_context(style()):
        figure, body = sheet(3.4)
        parts = body.subplots(1, len(panels), sharey=True)
        for axes, (words, values) in zip(parts, panels.items(), strict=True):
            colors = ['black' if name == 'exact' else '0.65' for name in found]
            bars = axes.barh([title(name) for name in found], values, color=colors)
            axes.bar_label(bars, [f'{value:.0f}' for value in values], padding=4)
            axes.set_title(words)
            axes.set_xlim(0.0, 1.25 * max(values))
            axes.set_xticks([])
            axes.grid(False)
            axes.spines['bottom'].set_visible(False)
        axes.invert_yaxis()
    return figure


def main() -> None:
    """Fill the page and draw the plot, or print the tables of another vehicle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--vehicle', help='print the tables of this vehicle, and fill no page')
    parser.add_argument(
        '--realistic', action='store_true', help='fill the table of the realistic vehicle alone'
    )
    parser.add_argument('--methods', nargs='+', default=list(CONTENDERS), choices=CONTENDERS)
    formats = ('markdown', 'latex')
    parser.add_argument('--tables', choices=formats, default='markdown', help='with --vehicle')
    options = parser.parse_args()
    labels = ['exact', *(label for label in options.methods if label != 'exact')]
    # The state of a tumbling vehicle overflows.
    warnings.simplefilter('ignore', RuntimeWarning)
    if options.realistic or not options.vehicle:
        ideal, real = (
            {label: outcomes(label, [name]) for label in labels}
            for name in ('hexarotor', 'hexarotor_realistic')
        )
        fill('comparison.md', realistic=realistic_table(ideal, real))
    if options.realistic:
        return
    vehicles = [options.vehicle] if options.vehicle else VEHICLES
    found = {label: outcomes(label, vehicles) for label in labels}
    wrenches = static(options.vehicle or 'hexarotor', labels)
    tables = {'wrenches': wrenches_table(wrenches), 'flights': flights_table(found)}
    if options.vehicle:
        text = '\n\n'.join(tables.values())
        print(latex(text) if options.tables == 'latex' else text)
    else:
        fill('comparison.md', **tables)
        save(draw(wrenches, found), DOCS / 'comparison', ['png'])


if __name__ == '__main__':
    main()
