"""The plot of a benchmark: times in units of the clipped pseudo-inverse."""

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from benchmarks.contenders import BASELINE
from benchmarks.parts import SETS
from ca_ros.figures import COLORS, DASHED, label_decades, sheet, style
from ca_ros.studies.plot_style import title

ROWS = {
    'exact': 'exact', 'daqp_reused': 'DAQP, reused', 'daqp': 'DAQP', 'quadprog': 'quadprog',
    'piqp': 'PIQP', 'osqp': 'OSQP',
}  # fmt: skip
"""The contenders that are drawn, with their labels; the page has all."""


def draw(results: pd.DataFrame) -> Figure:
    """Draw times per call over the clipped pseudo-inverse from `summarize`, hollow where wrong.

    Without the contenders of `ROWS` the first six others are drawn.
    """
    calls = results.loc['calls'].reset_index()
    names = [name for name in calls['contender'].unique() if name != BASELINE]
    names = [name for name in ROWS if name in names] or names[:6]
    with matplotlib.rc_context(style()):
        figure, body = sheet(0.9 + 0.42 * len(names))
        axes = body.subplots()
        for i, (kind, color) in enumerate(zip(SETS, COLORS, strict=False)):
            own = calls[calls['wrenches'] == kind].set_index('contender').reindex(names)
            places = np.arange(len(names)) + 0.27 * (i - 1)
            wrong = own['faults'].fillna('') != ''
            faces = ['white' if each else color for each in wrong]
            bars = axes.barh(places, own['ratio'], 0.25, color=faces, edgecolor=color)
            pairs = zip(own['ratio'], wrong, strict=True)
            words = [f'{ratio:#.3g}' + ', wrong' * bad for ratio, bad in pairs]
            labels = axes.bar_label(bars, words, padding=3, fontsize=6.5)
            for label in labels:  # the line at 1 may be behind it
                label.set_path_effects([withStroke(linewidth=1.2, foreground='white')])
            axes.barh([0.0], [np.nan], color=color, label=kind)
        axes.axvline(1.0, **DASHED)
        axes.set_xscale('log')
        low, high = axes.get_xlim()
        axes.set_xlim(min(low, 0.4), 2.0 * high)
        label_decades(axes.xaxis, *axes.get_xlim())
        axes.set_yticks(range(len(names)), [ROWS.get(name) or title(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.grid(axis='y', visible=False)
        axes.set_xlabel('time per call over that of the clipped pseudo-inverse')
        axes.legend(ncols=3, loc='lower center', bbox_to_anchor=(0.5, 1.0))
    return figure
