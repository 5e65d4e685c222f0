"""Plots of the dynamic study, as Figures 2 to 4 of the paper."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ca_ros import figures
from ca_ros.arrays import Array
from ca_ros.simulation.record import Flight
from ca_ros.studies.dynamic.metrics import STEADY, Flights, steady
from ca_ros.studies.plot_style import (
    PANELS_MAX,
    entries,
    entries_of,
    panel_titles,
    styles,
)  # fmt: skip
from ca_ros.vehicle.settings import AXES, unit

ALIKE = 0.01
"""Greatest difference of curves that look like one, as a share of the height of a panel."""

COMPONENTS: list[dict[str, Any]] = [
    {'color': '0.7', 'linewidth': 3.4},
    {'color': 'black', 'linewidth': 1.6, 'linestyle': (0, (2, 2))},
    {'color': 'black', 'linewidth': 1.0},
]  # fmt: skip
"""The styles of x, y and z, and of forces and torques along and about them.

Where they coincide, the wide line is seen between the dashes.
"""

AFTER = 5.0  # how long the plot of failures goes on after the last moment [s]


ROWS = ('position', 'tilt', 'speeds', 'margin', 'demand', 'served', 'residual')
"""What the rows of a plot of flights show."""

FAILURE_ROWS = ROWS[:4]

UNITS = {
    'position': 'position\n[m]', 'tilt': 'tilt\n[°]', 'speeds': 'rotor speed\n[rad/s]',
    'margin': 'margin\n[N, N m]',
}  # fmt: skip


def draw(
    out: Path, study: Flights, formats: Sequence[str], width: float = figures.WIDTHS['page'],
    rows: Sequence[str] = (),
) -> None:
    """Draw all plots of a dynamic study into a folder.

    Failures have a plot of their own, and `rows`, of `ROWS`, too.
    """
    with matplotlib.rc_context(figures.style(width)):
        plots = {
            'position': _draw_position(study), 'attitude': _draw_attitude(study),
            'rotor_speeds': _draw_rows(study, ['speeds'], 1.6),
        }
        if study.failures.failures:
            last = max(study.moments) + AFTER
            span = max(0.0, min(study.moments) - 1.0), min(study.end, last)
            margins = [frame['margin'].notna().any() for frame in study.samples.values()]
            shown = [row for row in FAILURE_ROWS if row != 'margin' or any(margins)]
            plots['failure'] = _draw_rows(study, shown, 1.1, span)
        if rows:
            plots['rows'] = _draw_rows(study, rows, 1.1)
        for name, plot in plots.items():
            figures.save(plot, out / name, formats)


def _kinds(study: Flights) -> list[Line2D]:
    """Return the lines of a legend of the kinds of moments that there are."""
    marks = [study.marks(name) for name in study.flights]
    return entries({
        kind: look for kind, look in figures.MOMENTS.items() if any(each[kind] for each in marks)
    })


def _mark_all(axes: Axes, study: Flights) -> None:
    for name in study.flights:
        figures.mark(axes, study.marks(name))


def _sheet(study: Flights, last_second: bool = False) -> tuple[dict[str, Flight], Figure, Any]:
    """Return a flight of each of the `coinciding_groups`, and a figure with their legend."""
    groups = coinciding_groups(study, last_second)
    figure, body = figures.sheet(5.4, [*entries_of(groups, coinciding=True), *_kinds(study)])
    return {names[0]: study.flights[names[0]] for names in groups}, figure, body


def _draw_position(study: Flights) -> Figure:
    """Draw the position over time, and the error in the last second."""
    flights, figure, body = _sheet(study, last_second=True)
    panels = body.subplots(3, 2, sharex='col', width_ratios=(figures.across(3, 1.5), 1))
    for i, (whole, last) in enumerate(panels):
        goal = float(study.trajectory.last.position[i])
        paths = {name: flight.position[:, i] for name, flight in flights.items()}
        errors = {name: 1e3 * (path - goal) for name, path in paths.items()}
        _lines(whole, flights, paths, goal)
        _mark_all(whole, study)
        _lines(last, flights, errors, 0.0, STEADY)
        whole.set_ylabel(f'${"xyz"[i]}$ [m]')
        last.set_ylabel(f'error in ${"xyz"[i]}$ [mm]')
        last.margins(y=0.2)
    panels[0][1].set_title('last second')
    ends = [study.end - STEADY, study.end]
    panels[0][1].set_xticks(ends, [f'{end:g}' for end in ends])
    for axes in panels[-1]:
        axes.set_xlabel('time [s]')
    return figure


def _draw_attitude(study: Flights) -> Figure:
    """Draw the attitude over time."""
    flights, figure, body = _sheet(study)
    panels = body.subplots(3, 1, sharex=True)
    goals = (None, None, float(np.degrees(study.trajectory.last.heading)))
    for i, (name, axes) in enumerate(zip(('roll', 'pitch', 'heading'), panels, strict=True)):
        angles = {
            method: np.degrees(flight.heading if name == 'heading' else flight.euler[:, i])
            for method, flight in flights.items()
        }
        _lines(axes, flights, angles, goals[i])
        _mark_all(axes, study)
        axes.set_ylabel(f'{name} [°]')
    panels[-1].set_xlabel('time [s]')
    return figure


def coinciding_groups(study: Flights, last_second: bool = False) -> list[list[str]]:
    """Return the methods in groups whose curves look like one, in the order of the first.

    With `last_second` also the errors of the position look like one there.
    """
    goal, found = study.trajectory.last.position, list[list[str]]()
    ends = {name: flight.position[steady(flight)] - goal for name, flight in study.flights.items()}
    heights = np.max([np.abs(errors).max(axis=0) for errors in ends.values()], axis=0)
    for name, flight in study.flights.items():
        same = [
            names for names in found
            if _alike(study.flights[names[0]], flight) and not (
                last_second and (np.abs(ends[names[0]] - ends[name]) > ALIKE * heights).any())
        ]
        if same:
            same[0].append(name)
        else:
            found.append([name])
    return found


def _alike(one: Flight, other: Flight) -> bool:
    pairs = (one.position, other.position), (one.speeds, other.speeds)
    return all(
        a.shape == b.shape and bool(np.abs(a - b).max() <= ALIKE * np.ptp(a)) for a, b in pairs
    )


def _draw_rows(
    study: Flights, rows: Sequence[str], least: float, span: tuple[float, float] | None = None
) -> Figure:
    """Draw rows of `ROWS`, with a column of at least some width [inch] per group of methods.

    The span is that of the time [s], by default the whole flight.  Demand, served wrench and
    residual take two rows each: forces and torques.
    """
    groups = coinciding_groups(study)
    shown = groups[:PANELS_MAX]
    panels = [
        (row, part) for row in rows for part in (('',) if row in UNITS else ('force', 'torque'))
    ]
    columns = figures.across(len(shown), least)
    blocks = -(-len(shown) // columns)
    titles, notes = panel_titles(groups, figures.inches() / columns - 0.3)
    handles = [*entries(figures.rotor_lines(study.vehicle.n))] if 'speeds' in rows else []
    handles += _components(rows, study.vehicle.axes)
    height = (0.6 + (1.75 if len(panels) == 1 else 1.15) * len(panels)) * blocks
    figure, body = figures.sheet(height, [*handles, *_kinds(study)], notes)
    grid = body.subplots(len(panels) * blocks, columns, sharex=True, sharey='row', squeeze=False)
    # Each block has a row for each panel, and a column per group.
    blocked = grid.reshape(blocks, len(panels), columns).transpose(0, 2, 1)
    stacks = blocked.reshape(-1, len(panels))
    for names, words, column in zip(shown, titles, stacks, strict=False):
        for (row, part), axes in zip(panels, column, strict=True):
            _draw_panel(axes, study, names[0], row, part)
            figures.mark(axes, study.marks(names[0]))
        column[0].set_title(words)
        column[-1].tick_params(labelbottom=True)
        column[-1].set_xlabel('time [s]')
    for axes in stacks[len(shown) :].flatten():
        axes.remove()
    for (row, part), places in zip(panels * blocks, grid, strict=True):
        unit = 'N' if part == 'force' else 'N m'
        places[0].set_ylabel(UNITS.get(row) or f'{row}\n{part} [{unit}]')
        _limit(places, study, row)
    body.align_ylabels(grid[:, 0])
    first = grid[0, 0]
    first.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    first.set_xlim(*(span or (0.0, study.end)))
    return figure


def _components(rows: Sequence[str], commanded: Sequence[str]) -> list[Line2D]:
    """Return the lines of a legend of what `COMPONENTS` show in these rows."""
    looks = {}
    for i, look in enumerate(COMPONENTS):
        names = [axis for axis in AXES[i::3] if axis in commanded and {*rows} - {*UNITS}]
        names = ['xyz'[i]] * ('position' in rows) + names
        if names:
            looks[', '.join(names)] = look
    return entries(looks)


def _draw_panel(axes: Axes, study: Flights, name: str, row: str, part: str) -> None:
    """Draw one row of a method."""
    flight, samples, vehicle = study.flights[name], study.samples[name], study.vehicle
    if row == 'position':
        looks = dict(zip('xyz', COMPONENTS, strict=True))
        figures.draw_lines(axes, flight.time, flight.position, looks)
        for level in np.unique(study.trajectory.last.position):
            axes.axhline(level, **figures.DASHED)
    elif row == 'tilt':
        axes.plot(flight.time, np.degrees(flight.tilt), color='black')
    elif row == 'speeds':
        figures.draw_lines(axes, flight.time, flight.speeds, figures.rotor_lines(vehicle.n))
        for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
            axes.axhline(bound, **figures.DASHED)
    elif row == 'margin':
        axes.plot(flight.time, samples['margin'], color='black')
        axes.axhline(0.0, **figures.DASHED)
    else:
        own = [axis for axis in vehicle.axes if (unit(axis) == 'N') == (part == 'force')]
        values = samples[[f'{row}_{axis}' for axis in own]].to_numpy()
        looks = {axis: COMPONENTS[AXES.index(axis) % 3] for axis in own}
        figures.draw_lines(axes, flight.time, values, looks)


def _limit(panels: Sequence[Axes], study: Flights, row: str) -> None:
    """Limit the values of a row: a falling vehicle leaves its panel."""
    if row == 'position':
        places = np.concatenate([study.trajectory.last.position, np.zeros(3)])
        panels[0].set_ylim(places.min() - 2.0, places.max() + 1.0)
    elif row == 'margin':
        margins = pd.concat([own['margin'] for own in study.samples.values()])
        highest = float(np.nanmax(margins, initial=0.0))
        lowest = max(float(np.nanmin(margins, initial=0.0)), -2.0 * highest)
        panels[0].set_ylim(lowest - 0.1 * highest, 1.1 * highest or 1.0)


def _lines(
    axes: Axes, flights: Mapping[str, Flight], values: Mapping[str, Array], goal: float | None,
    last: float = np.inf,
) -> None:
    """Draw values of each method over the last seconds of its flight, and the goal dashed."""
    for name, look in styles(list(flights), coinciding=True).items():
        time = flights[name].time
        part = time >= time[-1] - last
        axes.plot(time[part], values[name][part], **look)
    if goal is not None:
        axes.axhline(goal, **figures.DASHED)
    axes.margins(x=0.0)
