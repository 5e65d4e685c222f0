"""The style, the size and the files of all figures."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from ca_ros.arguments import named
from ca_ros.arrays import Array

if TYPE_CHECKING:
    # bringup flies without matplotlib.
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure, SubFigure

COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
"""The palette of Okabe and Ito, which colour-blind readers can tell apart."""

MORE = ('#882255', '#332288', '#999933', '#661100', '#44aa99', '#555555')
"""Darker colours of Paul Tol, for the lines that follow those of `COLORS`."""

STYLE: dict[Any, Any] = {
    'axes.titlelocation': 'left', 'axes.grid': True, 'axes.titlesize': 'medium', 'grid.alpha': 0.3,
    'axes.spines.top': False, 'axes.spines.right': False, 'legend.frameon': False,
    'lines.linewidth': 1.4,
}
DASHED: dict[str, Any] = {'color': 'black', 'linestyle': '--', 'linewidth': 0.8}
"""The style of waypoints and bounds."""

MOMENTS: dict[str, dict[str, Any]] = {
    'failure': {'color': 'black', 'linestyle': ':', 'linewidth': 0.8},
    'announced': {'color': '0.5', 'linestyle': '--', 'linewidth': 0.8},
    'detected': {'color': COLORS[3], 'linestyle': '-.', 'linewidth': 0.8},
}
"""The styles of the times of a flight at which a rotor fails, and at which it becomes known."""

DASHES: Any = ('-', (0, (5, 1)), (0, (1, 1)), (0, (4, 1, 1, 1)))

INCH = 25.4
WIDTHS = {'column': 88.0, 'page': 181.0}
"""Widths [mm] of figures in one and in two columns, as for IEEE."""

NARROWEST, WIDEST = 80.0, 500.0  # bounds of the width [mm]: in less, labels would overlap
HIGHEST = 230.0  # height of a page [mm]
PIXELS = 1400  # least width of a PNG file

FORMATS: dict[str, dict[str, None]] = {
    'png': {}, 'svg': {'Date': None}, 'pdf': {'CreationDate': None}
}
"""File formats, each with the metadata to leave out, so that equal plots are equal files."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the formats and the width of figures."""
    parser.add_argument('--figures', type=formats, default='png', metavar='A,B',
        help=f'formats of the figures: {", ".join(FORMATS)}; or none')
    named = ' or '.join(f'{name} ({width:g} mm)' for name, width in WIDTHS.items())
    parser.add_argument('--figure-width', type=millimetres, default='page', metavar='WIDTH',
        help=f'{named} as for IEEE, or a number of millimetres')


def formats(text: str) -> tuple[str, ...]:
    """Return the formats in a text such as png,svg or none, for argparse."""
    return () if text == 'none' else named(FORMATS)(text)


def millimetres(text: str) -> float:
    """Return the width in a text, by its name or in millimetres, for argparse."""
    try:
        width = WIDTHS[text] if text in WIDTHS else float(text)
        if NARROWEST <= width <= WIDEST:
            return width
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(
        f'{text!r} is no width of figures; expected {", ".join(WIDTHS)} or {NARROWEST:g} to '
        f'{WIDEST:g} mm')


def style(width: float = WIDTHS['page']) -> dict[Any, Any]:
    """Return the settings of matplotlib for figures of a width [mm] at their final size."""
    font = 8.0 if width < 120.0 else 9.0
    return {**STYLE, 'font.size': font, 'figure.figsize': (width / INCH, width / INCH)}


def mark(axes: Axes, moments: Mapping[str, Sequence[float]]) -> None:
    """Draw the times [s] of each kind of `MOMENTS` as vertical lines, the first with a label."""
    for name, times in moments.items():
        for i, time in enumerate(times):
            axes.axvline(time, label='_' * (i > 0) + name, **MOMENTS[name])


def inches() -> float:
    """Return the width [inch] of figures in the style that is in use."""
    import matplotlib

    return float(matplotlib.rcParams['figure.figsize'][0])


def across(panels: int, least: float) -> int:
    """Return how many panels of at least some width [inch] are placed side by side."""
    return max(1, min(panels, int(inches() / least)))


def letters(width: float) -> int:
    """Return how many letters of the style's font fit a width [inch]."""
    import matplotlib

    return int(width * 72.0 / (0.52 * matplotlib.rcParams['font.size']))


def sheet(
    height: float, handles: Sequence[Any] = (), notes: Sequence[str] = ()
) -> tuple[Figure, SubFigure]:
    """Return a figure with a legend and notes at its top, and the part below, of a height [inch].

    The width is that of `style`, which has to be in use.  The whole is at most `HIGHEST` high.
    """
    import matplotlib
    from matplotlib.figure import Figure

    font = matplotlib.rcParams['font.size']
    labels = [handle.get_label().split('\n') for handle in handles]
    # An entry's line and gaps are as wide as eight letters.
    longest = 8 + max((len(line) for lines in labels for line in lines), default=0)
    rows = -(-len(handles) // across(len(handles), longest * inches() / letters(inches())))
    columns = [labels[i : i + rows] for i in range(0, len(labels), max(1, rows))]
    lines = max((sum(map(len, column)) for column in columns), default=0)
    words = '\n'.join(line for note in notes for line in wrap(note, letters(inches()) - 4))
    count = len(words.splitlines())
    strip = (bool(lines) * 0.4 * font + 1.5 * font * lines + 1.35 * font * count) / 72.0
    height = min(height, HIGHEST / INCH - strip)
    figure = Figure(figsize=(inches(), height + strip), layout='constrained')
    if not strip:
        body: Any = figure.subfigures()
        return figure, body
    parts: Any = figure.subfigures(2, 1, height_ratios=(strip, height))
    head, body = parts
    if handles:
        head.legend(handles=handles, loc='upper center', ncols=len(columns))
    head.text(0.02, 0.0, words, va='bottom')
    return figure, body


def label_decades(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis in plain numbers: 1, 2, 5 and 10 where it has few decades."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.set_major_formatter(StrMethodFormatter('{x:g}'))
    axis.set_minor_formatter(NullFormatter())


def save(figure: Figure, path: Path, formats: Sequence[str]) -> list[Path]:
    """Write a figure in each format to the path with the format as suffix; return the files."""
    import matplotlib

    path = path.with_suffix('') if path.suffix[1:] in FORMATS else path
    files = [path.with_name(f'{path.name}.{form}') for form in formats]
    dpi = max(200.0, PIXELS / figure.get_figwidth())
    # By default the ids in an SVG file are random, and a PDF file has fonts of Type 3, which many
    # publishers refuse.
    with matplotlib.rc_context({'svg.hashsalt': path.name, 'pdf.fonttype': 42}):
        for file, form in zip(files, formats, strict=True):
            figure.savefig(file, dpi=dpi, metadata=FORMATS[form])
    return files


def line(i: int) -> dict[str, Any]:
    """Return the style of line i; dashes tell lines apart in grey, too."""
    colors = (*COLORS, *MORE)
    turn = i // len(COLORS)
    return {'color': colors[i % len(colors)], 'linestyle': DASHES[(i + turn) % len(DASHES)]}


def rotor_lines(n: int) -> dict[str, dict[str, Any]]:
    """Return the styles of n rotors by label; where they coincide, those below are wider."""
    return {f'rotor {i + 1}': {**line(i), 'linewidth': 3.0 - 2.1 * i / n} for i in range(n)}


def draw_lines(
    axes: Axes, time: Array, values: Array, looks: Mapping[str, Mapping[str, Any]]
) -> None:
    """Draw a row of a plot: the columns of values (K, n) over time (K,), by label and style."""
    for (label, look), column in zip(looks.items(), values.T, strict=True):
        axes.plot(time, column, label=label, **look)
