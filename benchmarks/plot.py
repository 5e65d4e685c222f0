"""The plot of a benchmark: times per call."""

from __future__ import annotations

from typing import Any

import matplotlib
import pandas as pd
from matplotlib.figure import Figure

from benchmarks.contenders import BASELINE
from benchmarks.parts import SETS
from ca_ros.evaluation.plot_style import title
from ca_ros.figures import COLORS, DASHED, label_decades, sheet, style

MARKERS = dict(zip(SETS, 'os^', strict=True))


def draw(results: pd.DataFrame) -> Figure:
    """Draw times per call from `summarize`; markers of wrong answers are hollow."""
    calls, in_c = (
        results[results.index.get_level_values('part') == part].reset_index()
        for part in ('calls', 'C')
    )
    calls = pd.concat([calls, in_c.assign(contender=in_c['contender'] + ' in C')])
    names = list(calls['contender'].unique())
    with matplotlib.rc_context(style()):
        figure, body = sheet(1.4 + 0.26 * len(names))
        axes = body.subplots()
        for color, (kind, marker) in zip(COLORS, MARKERS.items(), strict=False):
            look: dict[str, Any] = {'color': color, 'marker': marker, 'linestyle': 'none'}
            axes.plot([], [], label=kind, **look)
            for own in calls[calls['wrenches'] == kind].itertuples():
                row, ends = names.index(own.contender), (1e6 * own.time_low, 1e6 * own.time_high)
                axes.plot(ends, [row, row], color=color, linewidth=1.0)
                filling = 'white' if own.faults else color
                axes.plot(1e6 * own.time, row, **look, markerfacecolor=filling)
        axes.plot([], [], 'D', color='grey', markerfacecolor='white', label='wrong')
        axes.axvline(1e6 * calls.loc[calls['contender'] == BASELINE, 'time'].iloc[-1], **DASHED)
        axes.set_xscale('log')
        label_decades(axes.xaxis, *axes.get_xlim())
        axes.set_yticks(range(len(names)), [title(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlabel('time per call [µs]')
        axes.legend(ncols=4, loc='lower center', bbox_to_anchor=(0.5, 1.0))
    return figure
