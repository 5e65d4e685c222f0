"""Plots of the static study: errors, times, and sections of the admissible set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ca_ros.allocation import Allocator
from ca_ros.evaluation.judge import ERRORS, VIOLATION, columns, evaluate
from ca_ros.evaluation.plot_style import legend, sheet, styles, title
from ca_ros.evaluation.sampling import gauge
from ca_ros.evaluation.sections import Section, sections
from ca_ros.flight.plots import COLORS, STYLE, save
from ca_ros.problem.admissible_set import AdmissibleSet

SHOWN = 10_000
"""Number of samples, the first ones, whose errors and violations are drawn."""

ERROR_MIN = 1e-18
"""Smaller errors, zero among them, are drawn here [N, N m]."""

COMMANDS, CELLS, BINS = 13, 500, 20

COMMANDED: dict[str, Any] = {'color': 'white', 'edgecolor': 'black', 'linewidth': 0.6, 's': 18}
ACHIEVED: dict[str, Any] = {'color': COLORS[1], 'linewidth': 0.0, 's': 8}
OUTLINE: dict[str, Any] = {'facecolor': 'none', 'edgecolor': 'black', 'linewidth': 0.8}


def draw(
    out: Path,
    admissible: AdmissibleSet,
    allocators: Mapping[str, Allocator],
    rows: pd.DataFrame,
    times: Mapping[str, Sequence[float]],
    timing: str,
    formats: Sequence[str],
) -> None:
    """Draw all plots of a static study into a folder; `times` are of its calls, by method."""
    shown = rows[rows['sample'] < SHOWN]
    single = timing == 'single calls'
    time = f'time of a {"call" if single else "wrench in a batch"} [s]'
    calls = pd.concat(pd.DataFrame({'method': name, 'time': own}) for name, own in times.items())
    errors = {name: words for name, words in ERRORS.items() if name in rows}
    with matplotlib.rc_context(STYLE):
        plots = {
            'errors': _draw_distributions(shown, errors),
            'latency': _draw_distributions(
                calls, {'time': time}, 'samples' if single else 'batches'
            ),
            'slices': _draw_slices(admissible, allocators),
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
    figure, head, body = sheet(3.0 + 2.0 * len(labels), 3.2, len(methods))
    panels = body.subplots(1, len(labels), sharey=True, squeeze=False)[0]
    for axes, (key, label) in zip(panels, labels.items(), strict=True):
        for name, own in methods:
            values, counts = np.unique(np.maximum(own[key], ERROR_MIN), return_counts=True)
            shares = np.concatenate([[0.0], np.cumsum(counts) / len(own)])
            values = np.concatenate([values[:1], values])
            axes.step(values, 100.0 * shares, where='post', label=title(name), **looks[name])
        axes.set_xscale('log')
        axes.set_xlabel(label)
        if key != 'time':
            axes.set_xlim(left=ERROR_MIN)
            exponents = range(-15, 1, 3)
            ticks = [ERROR_MIN, *(10.0**exponent for exponent in exponents)]
            axes.set_xticks(ticks, ['0', *(f'$10^{{{exponent}}}$' for exponent in exponents)])
    panels[0].set_ylabel(f'share of {len(rows) // len(methods)} {what} [%]')
    legend(head, panels[0].get_lines())
    return figure


def _draw_slices(admissible: AdmissibleSet, allocators: Mapping[str, Allocator]) -> Figure | None:
    """Draw what each method achieves for a grid of commands in sections of the set."""
    cuts = sections(admissible, ('roll', 'pitch'), ('roll', 'yaw'))
    if not cuts:
        return None
    figure, head, body = sheet(max(0.8 + 1.9 * len(allocators), 4.5), 0.4 + 2.1 * len(cuts), 3)
    panels = body.subplots(len(cuts), len(allocators), sharex='row', sharey='row', squeeze=False)
    for cut, row in zip(cuts, panels, strict=True):
        for (name, allocator), axes in zip(allocators.items(), row, strict=True):
            _draw_commands(axes, cut, admissible, name, allocator)
        row[0].set_ylabel(cut.labels[1])
        right: Any = row[-1].twinx()
        right.set_ylabel(cut.title, rotation=270, va='bottom')
        right.set_yticks([])
    for name, axes in zip(allocators, panels[0], strict=True):
        axes.set_title(title(name, 17))
    outline = Line2D([], [], color='black', linewidth=0.8, label='admissible set')
    commanded = axes.scatter([], [], **COMMANDED, label='commanded')
    legend(head, [outline, commanded, axes.scatter([], [], **ACHIEVED, label='achieved')])
    return figure


def _draw_commands(
    axes: Axes, cut: Section, admissible: AdmissibleSet, name: str, allocator: Allocator
) -> None:
    problem = admissible.problem
    demands = cut.wrenches(*np.meshgrid(*cut.grid(COMMANDS))).reshape(-1, len(problem.axes))
    demands = demands[admissible.contains(demands)]
    rows = evaluate(name, allocator, problem, demands, batch=True)
    commanded = demands[:, cut.rows]
    achieved = (rows.filter(regex=r'^f_\d+$').to_numpy() @ problem.gamma.T)[:, cut.rows]
    axes.fill(*cut.outline.T, **OUTLINE)
    axes.scatter(*commanded.T, **COMMANDED, zorder=2)
    moves = np.stack([commanded, achieved], axis=1)
    axes.add_collection(LineCollection(list(moves), color=COLORS[1], linewidth=0.8, zorder=3))
    axes.scatter(*achieved.T, **ACHIEVED, zorder=4)
    axes.set_xlabel(cut.labels[0])
    axes.grid(False)


def _draw_violations(admissible: AdmissibleSet, rows: pd.DataFrame) -> Figure:
    """Draw where in the set the pseudo-inverse violates bounds, and by how much."""
    problem = admissible.problem
    cuts = sections(admissible, ('roll', 'pitch'), ('roll', 'yaw'), ('thrust', 'roll'))
    figure = Figure(figsize=(7.0, 5.6), layout='constrained')
    panels = figure.subplots(2, 2).flatten()
    inverse, images = np.linalg.pinv(problem.gamma).T, []
    for cut, axes in zip(cuts, panels, strict=False):
        points = cut.wrenches(*np.meshgrid(*cut.grid(CELLS)))
        excess = problem.violation(points @ inverse)
        (outline,) = axes.fill(*cut.outline.T, facecolor='0.92')
        if (worst := float(excess[admissible.contains(points)].max())) > VIOLATION:
            # Rasterized: as a vector graphic each cell would be a polygon, 100 MB.
            field = np.where(excess > VIOLATION, excess, np.nan)
            look = {'cmap': 'viridis_r', 'vmin': 0.0, 'vmax': worst, 'rasterized': True}
            images.append(axes.pcolormesh(*cut.grid(CELLS), field, **look))
            images[-1].set_clip_path(outline)
            # Otherwise the outline would lie on the frame.
            axes.use_sticky_edges = False
        axes.fill(*cut.outline.T, **OUTLINE)
        axes.set(xlabel=cut.labels[0], ylabel=cut.labels[1])
        axes.set_title(cut.title, fontsize='medium')
        axes.grid(False)
    if images:
        worst = max(image.norm.vmax for image in images)
        for image in images:
            image.set_clim(0.0, worst)
        label = 'violation before saturation [N]; grey: none'
        figure.colorbar(images[0], ax=panels[[1, 3]], label=label, ticks=MaxNLocator(6))
    _draw_share(panels[len(cuts)], admissible, rows)
    for axes in panels[len(cuts) + 1 :]:
        axes.remove()
    return figure


def _draw_share(axes: Axes, admissible: AdmissibleSet, rows: pd.DataFrame) -> None:
    """Draw the share of samples with a violation over the distance from the centre."""
    distance = gauge(admissible, rows[columns(admissible.problem)].to_numpy())
    rows = rows.assign(distance=distance).sort_values('distance')
    order = np.arange(len(rows)) * min(BINS, len(rows)) // len(rows)
    bins = rows.groupby(order)
    share, size = bins['violated'].mean(), bins.size()
    error = 100.0 * np.sqrt(share * (1.0 - share) / size)
    look: dict[str, Any] = {'color': COLORS[0], 'marker': 'o', 'markersize': 3, 'linewidth': 1.0}
    axes.errorbar(bins['distance'].mean(), 100.0 * share, error, **look)
    axes.set(xlim=(0.0, max(1.0, float(distance.max()))), ylim=(-2.0, 102.0))
    axes.set_xlabel('from centre (0) to boundary (1) of the set')
    axes.set_ylabel('samples with a violation [%]')
    axes.set_title(f'{len(rows)} samples, ± one standard error', fontsize='medium')
