"""Figures of the static study in sections of the admissible set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.evaluation import VIOLATION, Evaluation, evaluate
from ca_ros.evaluation.figure_style import legend, sheet, title
from ca_ros.evaluation.sampling import gauge
from ca_ros.evaluation.sections import Section, sections
from ca_ros.flight.plots import COLORS
from ca_ros.problem.admissible_set import AdmissibleSet

COMMANDS, CELLS, BINS = 13, 500, 20


def draw_slices(admissible: AdmissibleSet, allocators: Mapping[str, Allocator]) -> Figure | None:
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
    for (name, _), axes in zip(allocators.items(), panels[0], strict=True):
        axes.set_title(title(name))
    legend(
        head,
        [
            Line2D([], [], color='black', linewidth=0.8, label='admissible set'),
            axes.scatter([], [], **_COMMANDED, label='commanded'),
            axes.scatter([], [], **_ACHIEVED, label='achieved'),
        ],
    )
    return figure


_COMMANDED: dict[str, Any] = {'color': 'white', 'edgecolor': 'black', 'linewidth': 0.6, 's': 18}
_ACHIEVED: dict[str, Any] = {'color': COLORS[1], 'linewidth': 0.0, 's': 8}


def _draw_commands(
    axes: Axes,
    cut: Section,
    admissible: AdmissibleSet,
    name: str,
    allocator: Allocator,
) -> None:
    problem = admissible.problem
    demands = cut.wrenches(*np.meshgrid(*cut.grid(COMMANDS))).reshape(-1, len(problem.axes))
    demands = demands[admissible.contains(demands)]
    thrusts = evaluate(name, allocator, problem, demands, batch=True).thrusts
    commanded = demands[:, cut.rows]
    achieved = (thrusts @ problem.gamma.T)[:, cut.rows]
    axes.fill(*cut.outline.T, facecolor='none', edgecolor='black', linewidth=0.8)
    axes.scatter(*commanded.T, **_COMMANDED, zorder=2)
    moves = np.stack([commanded, achieved], axis=1)
    axes.add_collection(LineCollection(list(moves), color=COLORS[1], linewidth=0.8, zorder=3))
    axes.scatter(*achieved.T, **_ACHIEVED, zorder=4)
    axes.set_xlabel(cut.labels[0])
    axes.grid(False)


def draw_violations(admissible: AdmissibleSet, evaluation: Evaluation) -> Figure:
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
            image = axes.pcolormesh(
                *cut.grid(CELLS),
                field,
                cmap='viridis_r',
                vmin=0.0,
                vmax=worst,
                # As a vector graphic each cell would be a polygon: 100 MB.
                rasterized=True,
            )
            image.set_clip_path(outline)
            # Lest the outline lie on the frame.
            axes.use_sticky_edges = False
        axes.fill(*cut.outline.T, facecolor='none', edgecolor='black', linewidth=0.8)
        axes.set_xlabel(cut.labels[0])
        axes.set_ylabel(cut.labels[1])
        axes.set_title(cut.title(admissible.problem.axes), fontsize='medium')
        axes.grid(False)
    if image is not None:
        figure.colorbar(
            image,
            ax=panels[[1, 3]],
            label='violation before saturation [N]; grey: none',
            ticks=MaxNLocator(6),
        )
    _draw_share(panels[len(cuts)], admissible, evaluation)
    for axes in panels[len(cuts) + 1 :]:
        axes.remove()
    return figure


def _excess(admissible: AdmissibleSet, cut: Section) -> tuple[Array, float]:
    """Return by how much the pseudo-inverse violates bounds, and the greatest in the set [N]."""
    problem = admissible.problem
    points = cut.wrenches(*np.meshgrid(*cut.grid(CELLS)))
    thrusts = points @ np.linalg.pinv(problem.gamma).T
    excess = np.maximum(problem.lower - thrusts, thrusts - problem.upper).max(axis=-1)
    worst = float(excess[admissible.contains(points)].max())
    return np.where(excess > VIOLATION, excess, np.nan), worst


def _draw_share(axes: Axes, admissible: AdmissibleSet, evaluation: Evaluation) -> None:
    """Draw how the share of samples with a violation grows from the centre to the boundary."""
    distance = gauge(admissible, evaluation.demands)
    order = np.array_split(np.argsort(distance), min(BINS, len(distance)))
    share = np.array([evaluation.violated[part].mean() for part in order])
    size = np.array([len(part) for part in order])
    axes.errorbar(
        [distance[part].mean() for part in order],
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
    axes.set_title(f'{len(distance)} samples, ± one standard error', fontsize='medium')
