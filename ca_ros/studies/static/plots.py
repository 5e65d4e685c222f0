"""Plots of the static study: errors, times, and sections of the admissible set."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path as Polygon
from matplotlib.ticker import MaxNLocator

from ca_ros.allocation import Allocator
from ca_ros.figures import COLORS, WIDTHS, across, inches, label_decades, save, sheet, style
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.studies.errors import ERRORS, VIOLATION, columns
from ca_ros.studies.plot_style import entries_of, styles, title
from ca_ros.studies.sets.sections import sections
from ca_ros.studies.static.slices import OUTLINE, draw_slices

SHOWN = 10_000  # number of samples, the first ones, whose errors and violations are drawn
ERROR_MIN = 1e-18  # smaller errors, zero among them, are drawn here [N, N m]

CELLS, BINS = 500, 20


def draw(
    out: Path, admissible: AdmissibleSet, allocators: Mapping[str, Allocator], rows: pd.DataFrame,
    times: Mapping[str, Sequence[float]], timing: str, formats: Sequence[str],
    width: float = WIDTHS['page'],
) -> None:
    """Draw all plots of a static study into a folder; `times` are of its calls, by method."""
    shown = rows[rows['sample'] < SHOWN]
    single = timing == 'single calls'
    time = f'time of a {"call" if single else "wrench in a batch"} [µs]'
    calls = pd.concat(
        pd.DataFrame({'method': name, 'time': 1e6 * np.array(own)}) for name, own in times.items()
    )
    units = {*admissible.problem.axis_units}
    unit = f' [{units.pop()}]' if len(units) == 1 and units != {''} else ''
    unit = unit.replace('^2', '²')
    errors = {
        name: words + unit * (name == 'error') for name, words in ERRORS.items() if name in rows}
    with matplotlib.rc_context(style(width)):
        plots = {
            'errors': _draw_distributions(shown, errors),
            'latency': _draw_distributions(
                calls, {'time': time}, 'samples' if single else 'batches'
            ),
            'slices': draw_slices(admissible, allocators),
        }
        if 'pseudo_inverse' in allocators:
            own = shown[shown['method'] == 'pseudo_inverse']
            plots['violations'] = _draw_violations(admissible, own)
    for name, plot in plots.items():
        if plot is not None:
            save(plot, out / name, formats)


def _draw_distributions(
    rows: pd.DataFrame, labels: Mapping[str, str], what: str = 'samples'
) -> Figure:
    """Draw the cumulative distributions of columns for each method."""
    methods = rows.groupby('method', sort=False)
    looks = styles(list(methods.groups))
    columns = across(len(labels), 2.2)
    rows_of_panels = -(-len(labels) // columns)
    entries = entries_of([[name] for name in methods.groups])
    figure, body = sheet(0.5 + 2.5 * rows_of_panels, entries)
    panels = body.subplots(rows_of_panels, columns, sharey=True, squeeze=False).flatten()
    for axes, (key, label) in zip(panels, labels.items(), strict=True):
        for name, own in methods:
            values, counts = np.unique(np.maximum(own[key], ERROR_MIN), return_counts=True)
            shares = np.concatenate([[0.0], np.cumsum(counts) / len(own)])
            values = np.concatenate([values[:1], values])
            axes.step(values, 100.0 * shares, where='post', **looks[name])
        axes.set_xscale('log')
        axes.set_xlabel(label)
        if key == 'time':
            label_decades(axes.xaxis, *axes.get_xlim())
        else:
            axes.set_xlim(left=ERROR_MIN)
            exponents = range(-15, 1, 3)
            ticks = [ERROR_MIN, *(10.0**exponent for exponent in exponents)]
            axes.set_xticks(ticks, ['0', *(f'$10^{{{exponent}}}$' for exponent in exponents)])
    for axes in panels[::columns]:
        axes.set_ylabel(f'share of {len(rows) // len(methods)} {what} [%]')
    return figure


def _draw_violations(admissible: AdmissibleSet, rows: pd.DataFrame) -> Figure:
    """Draw where in the set the pseudo-inverse violates bounds, and by how much."""
    problem = admissible.problem
    cuts = sections(admissible, ('roll', 'pitch'), ('roll', 'yaw'), ('thrust', 'roll'))
    figure, body = sheet(1.6 + 0.6 * inches())
    panels = body.subplots(2, 2).flatten()
    inverse, images = np.linalg.pinv(problem.gamma).T, []
    for cut, axes in zip(cuts, panels, strict=False):
        x, y = np.meshgrid(*cut.grid(CELLS))
        excess = problem.violation(cut.wrenches(x, y) @ inverse)
        (outline,) = axes.fill(*cut.outline.T, facecolor='0.92')
        inside = Polygon(cut.outline).contains_points(np.column_stack([x.ravel(), y.ravel()]))
        if (worst := float(excess.ravel()[inside].max())) > VIOLATION:
            # Rasterized: as a vector graphic each cell would be a polygon, 100 MB.
            field = np.where(excess > VIOLATION, excess, np.nan)
            look = {'cmap': 'viridis_r', 'vmin': 0.0, 'vmax': worst, 'rasterized': True}
            images.append(axes.pcolormesh(*cut.grid(CELLS), field, **look))
            images[-1].set_clip_path(outline)
            # Otherwise the outline would lie on the frame.
            axes.use_sticky_edges = False
        axes.fill(*cut.outline.T, **OUTLINE)
        axes.set(xlabel=cut.labels[0], ylabel=cut.labels[1])
        axes.set_title(title(cut.title, 24))
        axes.grid(False)
    if images:
        worst = max(image.norm.vmax for image in images)
        for image in images:
            image.set_clim(0.0, worst)
        bar: Any = {'location': 'top', 'aspect': 40, 'ticks': MaxNLocator(6)}
        unit = problem.unit or ' of the effectors'
        label = f'violation before saturation [{unit.strip()}]; grey: none'
        body.colorbar(images[0], ax=panels, label=label, **bar)
    _draw_share(panels[len(cuts)], admissible, rows)
    for axes in panels[len(cuts) + 1 :]:
        axes.remove()
    return figure


def _draw_share(axes: Axes, admissible: AdmissibleSet, rows: pd.DataFrame) -> None:
    """Draw the share of samples with a violation over the distance from the centre."""
    wrenches = rows[columns(admissible.problem)].to_numpy()
    distance = admissible.problem.attainable_set.gauge(wrenches)
    rows = rows.assign(distance=distance).sort_values('distance')
    order = np.arange(len(rows)) * min(BINS, len(rows)) // len(rows)
    bins = rows.groupby(order)
    share, size = bins['violated'].mean(), bins.size()
    error = 100.0 * np.sqrt(share * (1.0 - share) / size)
    look: dict[str, Any] = {'color': COLORS[0], 'marker': 'o', 'markersize': 3, 'linewidth': 1.0}
    axes.errorbar(bins['distance'].mean(), 100.0 * share, error, **look)
    axes.set(xlim=(0.0, max(1.0, float(distance.max()))), ylim=(-2.0, 102.0))
    axes.set_xlabel('distance (boundary: 1)')
    axes.set_ylabel('with a violation [%]')
    axes.set_title(f'{len(rows)} samples,\n± standard error')
