"""The plot of what methods achieve in a plane section of the admissible set."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.figures import COLORS, across, inches, sheet
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.studies.errors import evaluate
from ca_ros.studies.plot_style import PANELS_MAX, panel_titles
from ca_ros.studies.sets.sections import Section, sections

COMMANDS = 13  # number of commands along each axis of a section

OUTSIDE, BEYOND = 24, 1.3
"""Number of commands outside, and how far: their distance from the middle over the boundary's."""

SAME = 0.01
"""Methods share a panel if their points differ by less, as a share of the section's size."""

POINT: dict[str, Any] = {'linestyle': 'none', 'marker': 'o', 'markeredgewidth': 0.6}
COMMANDED: dict[str, Any] = {
    **POINT, 'markerfacecolor': 'white', 'markeredgecolor': 'black', 'markersize': 4.2,
}  # fmt: skip
ACHIEVED: dict[str, Any] = {**POINT, 'color': COLORS[1], 'markeredgewidth': 0.0, 'markersize': 2.8}
OUTLINE: dict[str, Any] = {'facecolor': 'none', 'edgecolor': 'black', 'linewidth': 0.8}


def draw_slices(
    admissible: AdmissibleSet, allocators: Mapping[str, Allocator]
) -> Figure | None:
    """Draw what methods achieve for commands in a section of the set, and around it.

    Methods that achieve the same share a panel.  None without a section to draw.
    """
    cuts = sections(admissible, ('roll', 'yaw')) or sections(admissible, ('roll', 'pitch'))
    if not cuts:
        return None
    [cut] = cuts
    demands = _demands(cut, admissible)
    panels = _achieved(cut, admissible, allocators, demands)
    shown = panels[:PANELS_MAX]
    # Four are two and two.
    columns = across(min(len(shown), 2 if len(shown) == 4 else 3), 1.6)
    titles, notes = panel_titles([names for names, _ in panels], inches() / columns - 0.5)
    rows = -(-len(shown) // columns)
    outline = Line2D([], [], color='black', linewidth=0.8, label='admissible set')
    looks = {'commanded': COMMANDED, 'achieved': ACHIEVED}
    points = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    figure, body = sheet(2.3 * rows, [outline, *points], [*notes, f'Section: {cut.title}'])
    grid = body.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).flatten()
    for axes, words, (_, achieved) in zip(grid, titles, shown, strict=False):
        _draw(axes, cut, demands[:, cut.rows], achieved)
        axes.set_title(words)
        axes.label_outer()
    for axes in grid[len(shown) :]:
        axes.remove()
    return figure


def _demands(cut: Section, admissible: AdmissibleSet) -> Array:
    """Return a grid of commands inside, and some outside."""
    demands = cut.wrenches(*np.meshgrid(*cut.grid(COMMANDS))).reshape(-1, len(cut.reference))
    return np.concatenate([demands[admissible.contains(demands)], _outside(cut)])


def _outside(cut: Section) -> Array:
    """Return commands that are spread evenly around the section."""
    corners = np.vstack([cut.outline, cut.outline[:1]]) / np.ptp(cut.outline, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    places = np.arange(OUTSIDE) / OUTSIDE * lengths[-1]
    around = [np.interp(places, lengths, values) for values in corners.T]
    middle = cut.outline.mean(axis=0)
    points = middle + BEYOND * (np.transpose(around) * np.ptp(cut.outline, axis=0) - middle)
    return cut.wrenches(*points.T)


def _achieved(
    cut: Section, admissible: AdmissibleSet, allocators: Mapping[str, Allocator], demands: Array
) -> list[tuple[list[str], Array]]:
    """Return what is achieved in the section's plane (N, 2), and the methods that achieve it."""
    problem = admissible.problem
    found: list[tuple[list[str], Array]] = []
    for name, allocator in allocators.items():
        rows = evaluate(name, allocator, problem, demands, batch=True)
        own = (rows.filter(regex=r'^f_\d+$').to_numpy() @ problem.gamma.T)[:, cut.rows]
        for names, achieved in found:
            if np.all(np.abs(own - achieved) < SAME * np.ptp(cut.outline, axis=0)):
                names.append(name)
                break
        else:
            found.append(([name], own))
    return found


def _draw(axes: Axes, cut: Section, commanded: Array, achieved: Array) -> None:
    axes.fill(*cut.outline.T, **OUTLINE)
    axes.plot(*commanded.T, **COMMANDED, zorder=2)
    moves = np.stack([commanded, achieved], axis=1)
    axes.add_collection(LineCollection(list(moves), color=COLORS[1], linewidth=0.8, zorder=3))
    axes.plot(*achieved.T, **ACHIEVED, zorder=4)
    axes.set(xlabel=cut.labels[0], ylabel=cut.labels[1])
    axes.grid(False)
