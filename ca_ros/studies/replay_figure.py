"""The picture of a replayed flight: what was likely when, in which phase, and what was named."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ca_ros.arrays import Array
from ca_ros.detection.replay import Naming, Replay
from ca_ros.figures import COLORS, save, sheet, style

MINUTE = 60.0  # that is shown [s]
SHADES = {'ground': '#bbbbbb', 'launch': '#f7dfa5', 'flight': '#ffffff', 'landing': '#cfe3f1'}
SOUND, TAKEN = COLORS[0], COLORS[1]  # of the recorded motion, and of one without a rotor
PARTS = 400  # of the width, in each of which the greatest probability is drawn
LATE = 0.85  # share of the width after which words stand before a mark
HEIGHT = 0.8  # of a probability of 1, over the distance between rows

Loss = tuple[int, float, Replay]
"""A rotor that was taken, from 0, when [s], and what the detector then saw."""


def draw(found: Replay, losses: Sequence[Loss], file: Path) -> None:
    """Draw a minute about the first name or loss, a row for each rotor and for a disturbance.

    The format is one of `ca_ros.figures.FORMATS`.
    """
    with matplotlib.rc_context(style()):
        save(figure_of(found, losses), file, [file.suffix[1:]])


def figure_of(found: Replay, losses: Sequence[Loss]) -> Figure:
    """Return the picture."""
    times, n = found.times, found.probabilities.shape[1] - 1
    events = [each.time for each in found.named] + [time for _, time, _ in losses]
    start = min(events, default=0.0) - 0.5 * MINUTE
    start = max(0.0, min(start, times[-1] - MINUTE))
    end = min(times[-1], start + MINUTE)
    looks: list[Any] = [Patch(facecolor=SOUND, label='as recorded')]
    if losses:
        looks.append(Patch(facecolor=TAKEN, label='with a rotor taken'))
        looks.append(Line2D([], [], color='black', linestyle=':', label='rotor taken'))
    if found.named or any(each.named for *_, each in losses):
        looks.append(Line2D([], [], color='black', marker='v', linestyle='', label='named'))
    inside = (times >= start) & (times <= end)
    looks += [
        Patch(facecolor=shade, edgecolor='0.5', label=phase) for phase, shade in SHADES.items()
        if (found.phases[inside] == phase).any()]
    figure, body = sheet(0.7 + 0.28 * (n + 1), looks)
    axes = body.subplots()
    changes = np.flatnonzero(found.phases[1:] != found.phases[:-1]) + 1
    for i, k in pairwise([0, *changes.tolist(), len(times) - 1]):
        shade = SHADES[str(found.phases[i])]
        axes.axvspan(times[i], times[k], color=shade, linewidth=0, zorder=0)
    axes.set(xlim=(start, end), ylim=(-0.1, n + 1.05), xlabel='time [s]')
    parts = np.linspace(start, end, PARTS + 1)
    _rows(axes, parts, times, found.probabilities, SOUND)
    _names(axes, n, found.named)
    for rotor, time, lost in losses:
        first = [each for each in lost.named if each.time >= time][:1]
        until = first[0].time if first else lost.times[-1]
        shown = (lost.times >= time) & (lost.times <= until)
        _rows(axes, parts, lost.times[shown], lost.probabilities[shown], TAKEN)
        axes.vlines(time, n - rotor, n - rotor + 1.0, color='black', linestyle=':')
        _names(axes, n, first, time)
    axes.set_yticks(range(n + 1), ['disturbance', *(f'rotor {i}' for i in range(n, 0, -1))])
    axes.grid(visible=False, axis='x')
    axes.set_title('probability, from 0 to 1 in each row')
    return figure


def _rows(axes: Axes, parts: Array, times: Array, probabilities: Array, color: str) -> None:
    """Draw the greatest probability (K, n + 1) in each part of the time, a row for each column."""
    inside = (times >= parts[0]) & (times <= parts[-1])
    at = np.clip(np.searchsorted(parts, times[inside], side='right') - 1, 0, len(parts) - 2)
    n = probabilities.shape[1] - 1
    for i, column in enumerate(probabilities[inside].T):
        greatest = np.zeros(len(parts) - 1)
        np.maximum.at(greatest, at, column)
        row = n - i
        axes.stairs(row + HEIGHT * greatest, parts, baseline=row, fill=True, color=color)


def _names(axes: Axes, n: int, named: Sequence[Naming], since: float | None = None) -> None:
    """Mark what is named with its time, or how long it took since another time [s]."""
    for each in named:
        words = f'{each.time:.1f} s' if since is None else f'+{1e3 * (each.time - since):.0f} ms'
        for rotor in each.rotors:
            axes.plot(each.time, n - rotor + HEIGHT, 'v', color='black', markersize=4)
        top = n - min(each.rotors) + 0.5 * HEIGHT
        start, end = axes.get_xlim()
        late = each.time > start + LATE * (end - start)
        axes.annotate(
            words, (each.time, top), (-5.0 if late else 5.0, 0.0), va='center',
            ha='right' if late else 'left', textcoords='offset points',
            bbox={'facecolor': 'white', 'linewidth': 0.0, 'pad': 0.5})
