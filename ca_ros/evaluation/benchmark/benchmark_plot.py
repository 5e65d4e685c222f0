"""The plot of a benchmark: times per call, and how they grow with the rotors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ca_ros.evaluation.plot_style import title
from ca_ros.flight.plots import COLORS, DASHED, STYLE

MARKERS = {'uniform': 'o', 'boundary': 's', 'flight': '^'}
ROTORS = [4, 8, 16, 32]


def draw(found: Mapping[str, Any]) -> Figure:
    """Draw a run as in benchmark.json; what was answered wrongly is hollow."""
    with matplotlib.rc_context(STYLE):
        names = list(found['contenders'])
        figure = Figure(figsize=(8.0, 1.4 + 0.26 * max(len(names), 9)), layout='constrained')
        if not found['growth']:
            _draw_calls(figure.subplots(), found['calls'], names)
            return figure
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _draw_calls(left, found['calls'], names)
        _draw_growth(right, found['growth'])
    return figure


def _draw_calls(axes: Axes, calls: Mapping[str, Any], names: list[str]) -> None:
    handles = []
    for color, (load, marker) in zip(COLORS, MARKERS.items(), strict=False):
        look: dict[str, Any] = {'color': color, 'marker': marker, 'linestyle': 'none'}
        handles.append(Line2D([], [], label=load, **look))
        for row, name in enumerate(names):
            own = calls[load][name]
            low, median, high = (1e6 * own['mean'][part] for part in ('low', 'median', 'high'))
            axes.plot([low, high], [row, row], color=color, linewidth=1.0)
            filling = color if own['correct'] else 'white'
            axes.plot(median, row, **look, markerfacecolor=filling)
    axes.axvline(1e6 * calls['flight'][names[0]]['mean']['median'], **DASHED)
    axes.set_xscale('log')
    axes.set_yticks(range(len(names)), [title(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel('time per call [µs]')
    look = {'color': 'grey', 'marker': 'D', 'markerfacecolor': 'white', 'linestyle': 'none'}
    handles.append(Line2D([], [], label='wrong', **look))
    axes.legend(handles=handles, loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=4)


def _draw_growth(axes: Axes, growth: Mapping[str, Any]) -> None:
    for color, name in zip(COLORS, growth['flight'], strict=False):
        for load, dashes in (('flight', '-'), ('uniform', '--')):
            own = growth[load][name]
            axes.plot(
                [int(n) for n in own],
                [1e6 * each['mean']['median'] for each in own.values()],
                color=color,
                linestyle=dashes,
                marker=MARKERS[load],
                markersize=3.5,
                label=f'{title(name)}, {load}',
            )
    axes.set_xscale('log', base=2)
    axes.set_yscale('log')
    axes.set_xticks(ROTORS, [str(n) for n in ROTORS])
    axes.minorticks_off()
    axes.set_xlabel("rotors of the paper's hexarotor")
    axes.set_ylabel('time per call [µs]')
    axes.legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=7, handlelength=3)
