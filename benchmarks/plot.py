"""The plot of a benchmark: times per call from Python and in C."""

from typing import Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.contenders import BASELINE
from ca_ros.figures import COLORS, label_decades, sheet, style
from ca_ros.studies.plot_style import title

ROWS = {
    BASELINE: 'clipped pseudo-inverse', 'exact': 'exact', 'daqp_reused': 'DAQP, reused',
    'daqp': 'DAQP', 'daqp_hierarchical': 'DAQP, hierarchical', 'quadprog': 'quadprog',
    'piqp': 'PIQP', 'osqp': 'OSQP',
}  # fmt: skip
"""The contenders that are drawn, with their labels; the page has all."""

PANELS = {'calls': 'from Python', 'C': 'in C'}
LOOKS = {
    'uniform': ('o', 'uniform'), 'boundary': ('s', 'boundary'), 'flight': ('^', 'flight'),
    'inside': ('<', 'just inside'), 'on': ('D', 'on the boundary'),
    'outside': ('>', 'just outside'),
}  # fmt: skip
"""Marker and label of each kind of wrenches; the last three are the parts of `boundary`."""

UNANSWERED = 'no answer'

Looks = dict[str, dict[str, Any]]


def draw(results: pd.DataFrame) -> Figure:
    """Draw times per call from `summarize`: hollow where answers are wrong, crossed where missing.

    Without the contenders of `ROWS` the first six others are drawn.
    """
    parts = {part: results.loc[part].reset_index() for part in PANELS if part in results.index}
    rows = {part: _names(calls) for part, calls in parts.items()}
    kinds: Looks = {
        kind: {} for kind in LOOKS if any(kind in {*own['wrenches']} for own in parts.values())}
    for (kind, look), color in zip(kinds.items(), COLORS, strict=False):
        look |= {'color': color, 'marker': LOOKS[kind][0]}
    heights = [len(names) for names in rows.values()]
    with matplotlib.rc_context(style()):
        figure, body = sheet(0.9 + 0.27 * sum(heights), _legend(kinds))
        panels = body.subplots(len(parts), 1, sharex=True, squeeze=False, height_ratios=heights)
        for axes, (part, calls) in zip(panels[:, 0], parts.items(), strict=True):
            _draw(axes, calls, rows[part], kinds)
            axes.set_title(PANELS[part])
        label_decades(axes.xaxis, *axes.get_xlim())
        axes.set_xlabel('time per call [µs]')
    return figure


def _names(calls: pd.DataFrame) -> list[str]:
    names = [*calls['contender'].unique()]
    return [name for name in ROWS if name in names] or names[:6]


def _legend(kinds: Looks) -> list[Line2D]:
    looks: list[dict[str, Any]] = [
        *({**look, 'label': LOOKS[kind][1]} for kind, look in kinds.items()),
        {'color': 'black', 'marker': 'o', 'markerfacecolor': 'white', 'label': 'wrong answers'},
        {'color': 'black', 'marker': 'x', 'label': 'no answer to some'},
    ]
    return [Line2D([], [], linestyle='none', **look) for look in looks]


def _draw(axes: Axes, calls: pd.DataFrame, names: list[str], kinds: Looks) -> None:
    drawn = [kind for kind in kinds if kind in {*calls['wrenches']}]
    for i, kind in enumerate(drawn):
        own = calls[calls['wrenches'] == kind].set_index('contender').reindex(names)
        for place, (time, faults) in enumerate(zip(own['time'], own['faults'], strict=True)):
            # Points of one row are one below the other, so that none hides another.
            at = 1e6 * time, place + 0.66 * ((i + 0.5) / len(drawn) - 0.5)
            words = [] if pd.isna(faults) else [each for each in faults.split(', ') if each]
            wrong = [each for each in words if not each.startswith(UNANSWERED)]
            look = {**kinds[kind], **({'markerfacecolor': 'white'} if wrong else {})}
            axes.plot(*at, linestyle='none', markersize=4.5, **look)
            if len(words) > len(wrong):
                axes.plot(*at, 'x', color='black', markersize=5.5, markeredgewidth=0.9)
    axes.set_xscale('log')
    axes.set_yticks(range(len(names)), [ROWS.get(name) or title(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
