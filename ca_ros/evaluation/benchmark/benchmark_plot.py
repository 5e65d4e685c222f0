"""The plot of a benchmark: times per call, and how they grow with the number of rotors."""

from __future__ import annotations

from typing import Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ca_ros.evaluation.benchmark.contenders import BASELINE
from ca_ros.evaluation.benchmark.loads import LOADS
from ca_ros.evaluation.plot_style import title
from ca_ros.flight.figures import COLORS, DASHED, WIDTHS, across, label_decades, sheet, style

MARKERS = dict(zip(LOADS, 'os^vD', strict=False))
LINES = dict(zip(LOADS, ('--', ':', '-', '-.', (0, (6, 1, 1, 1))), strict=False))
ABOVE: dict[str, Any] = {'loc': 'lower center', 'bbox_to_anchor': (0.5, 1.0)}


def draw(results: pd.DataFrame, width: float = WIDTHS['page']) -> Figure:
    """Draw the results of a run, from `summarize`; markers of wrong answers are hollow.

    The figure has a width [mm].
    """
    calls, in_c, growth = (results[results['part'] == part] for part in ('calls', 'C', 'rotors'))
    calls = pd.concat([calls, in_c.assign(contender=in_c['contender'] + ' in C')])
    with matplotlib.rc_context(style(width)):
        height = 1.4 + 0.26 * max(calls['contender'].nunique(), 9)
        beside = across(2, 3.0) == 2
        figure, body = sheet(height if beside or growth.empty else height + 3.2)
        if growth.empty:
            _draw_calls(body.subplots(), calls)
        else:
            row: Any = {'ncols': 2, 'width_ratios': (3, 2)}
            column: Any = {'nrows': 2, 'height_ratios': (height, 3.2)}
            first, second = body.subplots(**(row if beside else column))
            _draw_calls(first, calls)
            _draw_growth(second, growth)
    return figure


def _draw_calls(axes: Axes, calls: pd.DataFrame) -> None:
    names = list(calls['contender'].unique())
    for color, (load, marker) in zip(COLORS, MARKERS.items(), strict=False):
        look: dict[str, Any] = {'color': color, 'marker': marker, 'linestyle': 'none'}
        axes.plot([], [], label=load, **look)
        for own in calls[calls['load'] == load].itertuples():
            row = names.index(own.contender)
            ends = 1e6 * own.time_low, 1e6 * own.time_high
            axes.plot(ends, [row, row], color=color, linewidth=1.0)
            filling = 'white' if own.faults else color
            axes.plot(1e6 * own.time, row, **look, markerfacecolor=filling)
    look = {'color': 'grey', 'marker': 'D', 'markerfacecolor': 'white', 'linestyle': 'none'}
    axes.plot([], [], label='wrong', **look)
    last = 'flight' if 'flight' in set(calls['load']) else 'uniform'
    unit = calls[(calls['load'] == last) & (calls['contender'] == BASELINE)]
    axes.axvline(1e6 * unit['time'].iloc[0], **DASHED)
    axes.set_xscale('log')
    label_decades(axes.xaxis, *axes.get_xlim())
    axes.set_yticks(range(len(names)), [title(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel('time per call [µs]')
    axes.legend(ncols=2, **ABOVE)


def _draw_growth(axes: Axes, growth: pd.DataFrame) -> None:
    handles = []
    looks: dict[str, dict[str, Any]] = {
        load: {'marker': MARKERS[load], 'linestyle': LINES[load], 'markersize': 3.5}
        for load in LINES
    }
    for i, (name, own) in enumerate(growth.groupby('contender', sort=False)):
        # The width tells contenders apart in grey.
        line: dict[str, Any] = {'color': COLORS[i], 'linewidth': (0.7, 2.2, 1.2)[i % 3]}
        handles.append(Line2D([], [], label=title(name), **line))
        for load, part in own.groupby('load'):
            axes.plot(part['rotors'], 1e6 * part['time'], **line, **looks[load])
    handles += [Line2D([], [], label=load, color='grey', **look) for load, look in looks.items()]
    axes.set_xscale('log', base=2)
    axes.set_yscale('log')
    label_decades(axes.yaxis, *axes.get_ylim())
    axes.set_xticks([4, 8, 16, 32], ['4', '8', '16', '32'])
    axes.minorticks_off()
    axes.set_xlabel("rotors of the paper's hexarotor")
    axes.set_ylabel('time per call [µs]')
    axes.legend(handles=handles, ncols=2, columnspacing=1.0, handlelength=2.0, **ABOVE)
