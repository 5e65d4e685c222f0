"""Plots of flights."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.record import Flight
from ca_ros.flight.trajectory import Trajectory
from ca_ros.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    # bringup flies without matplotlib.
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
"""The palette of Okabe and Ito, which colour-blind readers can tell apart."""

STYLE: dict[Any, Any] = {
    'font.size': 9,
    'axes.grid': True,
    'grid.alpha': 0.3,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'legend.frameon': False,
    'lines.linewidth': 1.4,
}
DASHED: dict[str, Any] = {'color': 'black', 'linestyle': '--', 'linewidth': 0.8}
"""The style of waypoints and bounds."""

DASHES: Any = ('-', (0, (5, 1)), (0, (1, 1)))

FORMATS: dict[str, dict[str, None]] = {
    'png': {},
    'svg': {'Date': None},
    'pdf': {'CreationDate': None},
}
"""File formats, each with the metadata to leave out, so that equal plots are equal files."""


def add_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for the formats of plots."""
    parser.add_argument(
        '--figures',
        type=formats,
        default='png',
        metavar='A,B',
        help=f'formats of the figures: {", ".join(FORMATS)}',
    )


def formats(text: str) -> list[str]:
    """Return the formats in a text such as png,svg, for argparse."""
    words = [word.strip() for word in text.split(',')]
    for word in words:
        if word not in FORMATS:
            raise argparse.ArgumentTypeError(
                f'{word!r} is no format of figures; there are {", ".join(FORMATS)}'
            )
    return list(dict.fromkeys(words))


def save(figure: Figure, path: Path, formats: Sequence[str]) -> list[Path]:
    """Write a figure in each format to the path with the format as suffix; return the files."""
    import matplotlib

    files = [path.with_name(f'{path.name}.{form}') for form in formats]
    # By default the ids in an SVG file are random, and a PDF file has fonts of Type 3, which many
    # publishers refuse.
    with matplotlib.rc_context({'svg.hashsalt': path.name, 'pdf.fonttype': 42}):
        for file, form in zip(files, formats, strict=True):
            figure.savefig(file, dpi=200, metadata=FORMATS[form])
    return files


def line(i: int) -> dict[str, Any]:
    """Return the style of line i: the colours repeat with other dashes."""
    return {'color': COLORS[i % len(COLORS)], 'linestyle': DASHES[i // len(COLORS) % len(DASHES)]}


def draw_flight(flight: Flight, vehicle: Vehicle, trajectory: Trajectory) -> Figure:
    """Plot position, attitude and rotor speeds over time; waypoints and bounds are dashed."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 7.5), layout='constrained')
        position, attitude, speeds = figure.subplots(3, 1, sharex=True)
        _lines(position, flight.time, flight.position, ('x', 'y', 'z'), 'position [m]')
        goals, headings = trajectory.goals(flight.time)
        position.plot(flight.time, goals, **DASHED)
        _lines(
            attitude,
            flight.time,
            np.degrees(np.column_stack([flight.euler[:, :2], flight.heading])),
            ('roll', 'pitch', 'heading'),
            'angle [deg]',
        )
        attitude.plot(flight.time, np.degrees(headings), **DASHED)
        names = [f'rotor {i + 1}' for i in range(vehicle.n)]
        _lines(speeds, flight.time, flight.speeds, names, 'rotor speed [rad/s]')
        for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
            speeds.axhline(bound, **DASHED)
        speeds.set_xlabel('time [s]')
        speeds.set_xlim(flight.time[0], flight.time[-1])
    return figure


def _lines(
    axes: Axes,
    time: Array,
    values: Array,
    names: list[str] | tuple[str, ...],
    label: str,
) -> None:
    for i, name in enumerate(names):
        axes.plot(time, values[:, i], label=name, **line(i))
    axes.set_ylabel(label)
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
