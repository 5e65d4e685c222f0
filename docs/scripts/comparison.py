"""Compare all methods on wrenches and in flight; fill the tables of docs/comparison.md.

Also draws the plot of the page.
"""

from collections.abc import Mapping, Sequence
from itertools import chain, product
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from pages import DOCS, both_masses, fill, spread

from ca_ros import AdmissibleSet
from ca_ros.allocation import ALLOCATORS
from ca_ros.figures import save, sheet, style
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic.manoeuvres import MANOEUVRES, fly_seeds
from ca_ros.studies.plot_style import title
from ca_ros.studies.tables import table
from ca_ros.studies.wrench_metrics import NOTED, metrics
from ca_ros.studies.wrench_sets import samples

AIRMODE = 'allocation.sequential_desaturation.airmode:=roll_pitch'

CONTENDERS: dict[str, tuple[str, tuple[str, ...]]] = {
    # With equal weights the one is another; OSQP alone rejects what is not attainable.
    **{name: (name, ()) for name in ALLOCATORS if name not in ('weighted_pseudo_inverse', 'osqp')},
    'direct_about_hover': ('direct_about_hover', ()),
    'sequential_desaturation, airmode': ('sequential_desaturation', (AIRMODE,)),
    'daqp_hierarchical': ('daqp_hierarchical', ()),
}
"""Method and parameters of each row."""

VEHICLES = ('quadrotor', 'hexarotor', 'octorotor', 'x8', 'y6')
REALISTIC = 'hexarotor_realistic'
SAMPLES, SEED = 1000, 0
SEEDS = 4  # of each manoeuvre
TITLES = [name.replace('_', ' ') for name in MANOEUVRES]


def flights(vehicles: Sequence[str]) -> pd.DataFrame:
    """Fly all manoeuvres, also heavy: rows as in manoeuvres.csv, with vehicle and contender."""
    return pd.DataFrame(chain(*spread(flights_of, [*product(vehicles, CONTENDERS)])))


def flights_of(name: str, label: str) -> list[dict[str, Any]]:
    """Fly a vehicle with a contender.

    A quadrotor falls without one of its rotors: this it does not fly.
    """
    method, changes = CONTENDERS[label]
    return [
        {**row, 'vehicle': name, 'contender': label}
        for _, case in both_masses(name, changes, [method])
        for row in fly_seeds(case, [method], [
            each for each in MANOEUVRES if each != 'rotor_lost' or case.vehicle.n > 4
        ], SEEDS)
    ]


def static(name: str) -> dict[str, dict[str, Any]]:
    """Return the metrics of each contender on wrenches inside and outside the admissible set."""
    admissible = AdmissibleSet(Case.load(name).problem)
    problem = admissible.problem
    found: dict[str, dict[str, Any]] = {}
    demands = {kind: samples(admissible, kind, SEED, 0, SAMPLES) for kind in ('volume', 'outside')}
    for label, (method, own) in CONTENDERS.items():
        allocator = Case.load(name, own, [method]).allocator(method)
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


def recoveries(rows: pd.DataFrame) -> pd.DataFrame:
    """Return how many flights recovered, by contender and manoeuvre."""
    counts = rows.groupby(['contender', 'manoeuvre'], sort=False)['recovered']
    return counts.agg(lambda own: f'{own.sum()}/{len(own)}').unstack()


def flights_table(rows: pd.DataFrame) -> str:
    """Return the table of recoveries, height lost and smoothness."""
    slalom = rows[rows['manoeuvre'] == 'slalom'].groupby('contender')['change'].sum()
    drops = rows[rows['manoeuvre'] == 'upsets'].groupby('contender')['height_lost'].median()
    hits = recoveries(rows)
    cells = [
        (f'`{label}`', *hits.loc[label, [*MANOEUVRES]], f'{drops[label]:.2f}',
         f'{100.0 * slalom[label] / slalom["exact"]:.1f}')
        for label in CONTENDERS
    ]  # fmt: skip
    more = 'height lost in upsets, median [m]', 'change of thrust, slalom [% of `exact`]'
    return table(('method', *TITLES, *more), cells)


def realistic_table(ideal: pd.DataFrame, real: pd.DataFrame) -> str:
    """Return the table of recoveries of an ideal vehicle, and of a realistic one."""
    both = recoveries(ideal) + ', ' + recoveries(real)
    cells = [(f'`{label}`', *both.loc[label, [*MANOEUVRES]]) for label in CONTENDERS]
    return table(('method', *(f'{each}: ideal, realistic' for each in TITLES)), cells)


def draw(wrenches: Mapping[str, Mapping[str, Any]], rows: pd.DataFrame) -> Figure:
    """Draw four metrics as bars, one row per method, those with the fewest flights lost first.

    Black is `exact`; bold numbers are the least of their panel.
    """
    outside = [own['outside'] for own in wrenches.values()]
    tilts = [100.0 * own['lost']['roll and pitch'] for own in outside]
    flown = rows.groupby('contender', sort=False)['recovered']
    lost = [*(flown.size() - flown.sum()).astype(float)]
    panels: dict[str, list[float]] = {
        'attainable\nwrenches\nmissed [%]': [100.0 * own['missed'] for own in wrenches.values()],
        'roll and pitch\nlost, unat-\ntainable [%]': tilts,
        'reversed axis,\nunattainable\n[%]': [100.0 * own['reversed'] for own in outside],
        f'flights lost\nof {flown.size()["exact"]}': lost,
    }
    with matplotlib.rc_context(style()):
        figure, body = sheet(3.4)
        parts = body.subplots(1, len(panels), sharey=True)
        names = [*CONTENDERS]
        order = np.lexsort((tilts, lost))
        for axes, (words, values) in zip(parts, panels.items(), strict=True):
            colors = ['black' if names[i] == 'exact' else '0.65' for i in order]
            bars = axes.barh([title(names[i]) for i in order], [values[i] for i in order],
                             color=colors)
            shown = [f'{values[i]:.0f}' for i in order]
            least = min(shown, key=float)
            for words_of, label in zip(shown, axes.bar_label(bars, shown, padding=4), strict=True):
                label.set_fontweight('bold' if words_of == least else 'normal')
            axes.set_title(words)
            axes.set_xlim(0.0, 1.25 * max(values))
            axes.set_xticks([])
            axes.grid(False)
            axes.spines['bottom'].set_visible(False)
        axes.invert_yaxis()
    return figure


def main() -> None:
    """Fill the page and draw the plot."""
    rows, real = flights(VEHICLES), flights([REALISTIC])
    wrenches = static('hexarotor')
    fill(
        'comparison.md', wrenches=wrenches_table(wrenches), flights=flights_table(rows),
        realistic=realistic_table(rows[rows['vehicle'] == 'hexarotor'], real),
    )
    save(draw(wrenches, rows), DOCS / 'comparison', ['png'])


if __name__ == '__main__':
    main()
