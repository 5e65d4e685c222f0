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
from ca_ros.arrays import Array
from ca_ros.evaluation.judge import COLUMNS, VIOLATION, evaluate
from ca_ros.evaluation.plot_style import legend, sheet, styles, title
from ca_ros.evaluation.sampling import gauge
from ca_ros.evaluation.sections import Section, sections
from ca_ros.flight.plots import COLORS, STYLE, save
from ca_ros.problem.admissible_set import AdmissibleSet

SHOWN = 10_000
"""Samples, the first ones, of which errors and violations are drawn."""

ERROR_MIN = 1e-18
"""Smaller errors, zero among them, are drawn here [N, N m]."""

COMMANDS, CELLS, BINS = 13, 500, 20

COMMANDED: dict[str, Any] = {'color': 'white', 'edgecolor': 'black', 'linewidth': 0.6, 's': 18}
ACHIEVED: dict[str, Any] = {'color': COLORS[1], 'linewidth': 0.0, 's': 8}


def draw(
    out: Path,
    admissible: AdmissibleSet,
    allocators: Mapping[str, Allocator],
    rows: pd.DataFrame,
    timing: str,
    formats: Sequence[str],
) -> None:
    """Draw all plots of a static study into a folder."""
    shown = rows[rows['sample'] < SHOWN]
    with matplotlib.rc_context(STYLE):
        plots = {
            'errors': _draw_errors(shown),
            'latency': _draw_latency(rows, timing),
            'slices': _draw_slices(admissible, allocators),
        }
        if 'pseudo_inverse' in allocators:
            own = shown[shown['method'] == 'pseudo_inverse']
            plots['violations'] = _draw_violations(admissible, own)
    for name, plot in plots.items():
        if plot is not None:
            save(plot, out / name, formats)


def _draw_errors(rows: pd.DataFrame) -> Figure:
    """Draw the cumulative distributions of the force and torque errors of each method."""
    methods = rows.groupby('method', sort=False)
    figure, head, body = sheet(7.0, 3.2, len(methods))
    force, torque = body.subplots(1, 2, sharey=True)
    for axes, key, unit in ((force, 'force_error', 'N'), (torque, 'torque_error', 'N m')):
        _steps(axes, {name: np.maximum(own[key], ERROR_MIN) for name, own in methods})
        axes.set_xlim(left=ERROR_MIN)
        axes.set_xticks(
            [ERROR_MIN, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0],
            ['0', *(f'$10^{{{exponent}}}$' for exponent in (-15, -12, -9, -6, -3, 0))],
        )
        axes.set_xlabel(f'{key.replace("_", " ")} [{unit}]')
    force.set_ylabel(f'share of {len(rows) // len(methods)} samples [%]')
    legend(head, force.get_lines())
    return figure


def _draw_latency(rows: pd.DataFrame, timing: str) -> Figure:
    """Draw the cumulative distribution of the time of a call of each method."""
    methods = rows.groupby('method', sort=False)
    figure, head, body = sheet(5.0, 3.2, len(methods))
    axes = body.subplots()
    _steps(axes, {name: own['time'] for name, own in methods})
    axes.set_xlabel(f'time of a {"call" if timing == "single calls" else "wrench in a batch"} [s]')
    axes.set_ylabel('share of samples [%]')
    legend(head, axes.get_lines())
    return figure


def _steps(axes: Axes, samples: Mapping[str, Any]) -> None:
    """Draw distribution functions, which begin at zero, over a logarithmic axis."""
    looks = styles(list(samples))
    for name, own in samples.items():
        values, counts = np.unique(own, return_counts=True)
        shares = np.concatenate([[0.0], np.cumsum(counts) / len(own)])
        values = np.concatenate([values[:1], values])
        axes.step(values, 100.0 * shares, where='post', label=title(name), **looks[name])
    axes.set_xscale('log')


def _draw_slices(admissible: AdmissibleSet, allocators: Mapping[str, Allocator]) -> Figure | None:
    """Draw what becomes of a grid of commands in sections of the set, for each method."""
    cuts = sections(admissible, ('roll', 'pitch'), ('roll', 'yaw'))
    if not cuts:
        return None
    figure, head, body = sheet(max(0.8 + 1.9 * len(allocators), 4.5), 0.4 + 2.1 * len(cuts), 3)
    panels = body.subplots(len(cuts), len(allocators), sharex='row', sharey='row', squeeze=False)
    for cut, row in zip(cuts, panels, strict=True):
        for (name, allocator), axes in zip(allocators.items(), row, strict=True):
            _draw_commands(axes, cut, admissible, name, allocator)
        row[0].set_ylabel(cut.labels[1])
        # On the right, where a second vertical axis would have its label.
        row[-1].annotate(
            cut.title(admissible.problem.axes),
            (1.0, 0.5),
            xytext=(4, 0),
            xycoords='axes fraction',
            textcoords='offset points',
            rotation=270,
            ha='left',
            va='center',
        )
    for name, axes in zip(allocators, panels[0], strict=True):
        axes.set_title(title(name))
    legend(
        head,
        [
            Line2D([], [], color='black', linewidth=0.8, label='admissible set'),
            axes.scatter([], [], **COMMANDED, label='commanded'),
            axes.scatter([], [], **ACHIEVED, label='achieved'),
        ],
    )
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
    axes.fill(*cut.outline.T, facecolor='none', edgecolor='black', linewidth=0.8)
    axes.scatter(*commanded.T, **COMMANDED, zorder=2)
    moves = np.stack([commanded, achieved], axis=1)
    axes.add_collection(LineCollection(list(moves), color=COLORS[1], linewidth=0.8, zorder=3))
    axes.scatter(*achieved.T, **ACHIEVED, zorder=4)
    axes.set_xlabel(cut.labels[0])
    axes.grid(False)


def _draw_violations(admissible: AdmissibleSet, rows: pd.DataFrame) -> Figure:
    """Draw where in the set the pseudo-inverse violates bounds, and by how much."""
    cuts = sections(admissible, ('roll', 'pitch'), ('roll', 'yaw'), ('thrust', 'roll'))
    figure = Figure(figsize=(7.0, 5.6), layout='constrained')
    panels = figure.subplots(2, 2).flatten()
    fields = [_excess(admissible, cut) for cut in cuts]
    worst = max((worst for _, worst in fields), default=0.0)
    image = None
    for cut, (field, _), axes in zip(cuts, fields, panels, strict=False):
        (outline,) = axes.fill(*cut.outline.T, facecolor='0.92')
        if worst > VIOLATION:
            # Rasterized: as a vector graphic each cell would be a polygon, 100 MB.
            look = {'cmap': 'viridis_r', 'vmin': 0.0, 'vmax': worst, 'rasterized': True}
            image = axes.pcolormesh(*cut.grid(CELLS), field, **look)
            image.set_clip_path(outline)
            # Otherwise the outline would lie on the frame.
            axes.use_sticky_edges = False
        axes.fill(*cut.outline.T, facecolor='none', edgecolor='black', linewidth=0.8)
        axes.set_xlabel(cut.labels[0])
        axes.set_ylabel(cut.labels[1])
        axes.set_title(cut.title(admissible.problem.axes), fontsize='medium')
        axes.grid(False)
    if image is not None:
        label = 'violation before saturation [N]; grey: none'
        figure.colorbar(image, ax=panels[[1, 3]], label=label, ticks=MaxNLocator(6))
    _draw_share(panels[len(cuts)], admissible, rows)
    for axes in panels[len(cuts) + 1 :]:
        axes.remove()
    return figure


def _excess(admissible: AdmissibleSet, cut: Section) -> tuple[Array, float]:
    """Return by how much the pseudo-inverse violates bounds, and the greatest in the set [N]."""
    problem = admissible.problem
    points = cut.wrenches(*np.meshgrid(*cut.grid(CELLS)))
    excess = problem.violation(points @ np.linalg.pinv(problem.gamma).T)
    worst = float(excess[admissible.contains(points)].max())
    return np.where(excess > VIOLATION, excess, np.nan), worst


def _draw_share(axes: Axes, admissible: AdmissibleSet, rows: pd.DataFrame) -> None:
    """Draw how the share of samples with a violation grows from the centre to the boundary."""
    names = [COLUMNS.get(axis, axis) for axis in admissible.problem.axes]
    rows = rows.assign(distance=gauge(admissible, rows[names].to_numpy())).sort_values('distance')
    order = np.arange(len(rows)) * min(BINS, len(rows)) // len(rows)
    bins = rows.groupby(order)
    share, size = bins['violated'].mean(), bins.size()
    axes.errorbar(
        bins['distance'].mean(),
        100.0 * share,
        100.0 * np.sqrt(share * (1.0 - share) / size),
        color=COLORS[0],
        marker='o',
        markersize=3,
        linewidth=1.0,
    )
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-2.0, 102.0)
    axes.set_xlabel('from centre (0) to boundary (1) of the set')
    axes.set_ylabel('samples with a violation [%]')
    axes.set_title(f'{len(rows)} samples, ± one standard error', fontsize='medium')
