"""Plots of the dynamic study, as Figures 2 to 4 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ca_ros.arrays import Array
from ca_ros.evaluation.dynamic.flights import Flights
from ca_ros.evaluation.dynamic.metrics import STEADY
from ca_ros.evaluation.plot_style import entries, entries_of, styles, title
from ca_ros.figures import (
    COLORS,
    DASHED,
    MOMENTS,
    WIDTHS,
    across,
    line,
    mark,
    save,
    sheet,
    style,
)
from ca_ros.flight.record import Flight
from ca_ros.vehicle.vehicle import Vehicle

ALIKE = 0.01
"""Greatest difference of curves that look like one, as a share of the height of a panel."""

AFTER = 5.0  # how long the plot of failures goes on after the last moment [s]


def draw(
    out: Path, study: Flights, formats: Sequence[str], width: float = WIDTHS['page']
) -> None:
    """Draw all plots of a dynamic study into a folder; failures have a plot of their own."""
    with matplotlib.rc_context(style(width)):
        plots = {
            'position': _draw_position(study),
            'attitude': _draw_attitude(study),
            'rotor_speeds': _draw_speeds(study),
        }
        if study.failures.failures:
            plots['failure'] = _draw_failure(study)
        for name, plot in plots.items():
            save(plot, out / name, formats)


def _kinds(study: Flights) -> list[Line2D]:
    """Return the lines of a legend of the kinds of moments that there are."""
    marks = [study.marks(name) for name in study.flights]
    return entries({
        kind: look for kind, look in MOMENTS.items() if any(each[kind] for each in marks)
    })


def _mark_all(axes: Axes, study: Flights) -> None:
    for name in study.flights:
        mark(axes, study.marks(name))


def _draw_position(study: Flights) -> Figure:
    """Draw the position over time, and the error in the last second."""
    flights = study.flights
    figure, body = sheet(5.4, [*entries_of(list(flights), coinciding=True), *_kinds(study)])
    panels = body.subplots(3, 2, sharex='col', width_ratios=(across(3, 1.5), 1))
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
    flights, waypoint = study.flights, study.trajectory.last
    figure, body = sheet(5.4, [*entries_of(list(flights), coinciding=True), *_kinds(study)])
    panels = body.subplots(3, 1, sharex=True)
    goals = (None, None, float(np.degrees(waypoint.heading)))
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


def _shared(study: Flights, width: int) -> dict[str, str]:
    """Return the titles of panels by method; methods whose curves look like one share a panel."""
    found: dict[str, list[str]] = {}
    for name, flight in study.flights.items():
        first = next((one for one in found if _alike(study.flights[one], flight)), name)
        found.setdefault(first, []).append(title(name))
    return {first: '\n'.join(wrap(', '.join(names), width)) for first, names in found.items()}


def _alike(one: Flight, other: Flight) -> bool:
    pairs = (one.position, other.position), (one.speeds, other.speeds)
    return all(
        a.shape == b.shape and bool(np.abs(a - b).max() <= ALIKE * np.ptp(a)) for a, b in pairs
    )


def _draw_speeds(study: Flights) -> Figure:
    """Draw the rotor speeds, one panel per method."""
    vehicle, titles = study.vehicle, _shared(study, 44)
    flights = {name: study.flights[name] for name in titles}
    rows = -(-len(flights) // 2)
    figure, body = sheet(0.4 + 2.2 * rows, [*entries(_looks(vehicle)), *_kinds(study)])
    panels = body.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).flatten()
    for (name, flight), axes in zip(flights.items(), panels, strict=False):
        _speeds(axes, flight, vehicle)
        mark(axes, study.marks(name))
        axes.set_title(titles[name])
        axes.margins(x=0.0)
    for axes in panels[: len(flights) : 2]:
        axes.set_ylabel('rotor speed [rad/s]')
    for axes in panels[len(flights) :]:
        axes.remove()
    for axes in panels[max(len(flights) - 2, 0) : len(flights)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel('time [s]')
    return figure


def _draw_failure(study: Flights) -> Figure:
    """Draw flights with rotor failures beside each other, one column per method."""
    vehicle, moments, titles = study.vehicle, study.moments, _shared(study, 30)
    flights = {name: study.flights[name] for name in titles}
    goal = study.trajectory.last.position
    columns = across(len(flights), 1.1)
    blocks = -(-len(flights) // columns)
    figure, body = sheet(7.6 * blocks, [*entries(_looks(vehicle)), *_kinds(study)])
    grid = body.subplots(4 * blocks, columns, sharex=True, sharey='row', squeeze=False)
    # Each block has four rows, and a column per method.
    stacks = grid.reshape(blocks, 4, columns).transpose(0, 2, 1).reshape(-1, 4)
    for (name, flight), column in zip(flights.items(), stacks, strict=False):
        position, tilt, speeds, margin = column
        for i, axis in enumerate('xyz'):
            # Where coordinates coincide, those below are wider.
            look = {'color': ('0.65', '0.3', COLORS[1])[i], 'linewidth': 3.2 - 1.0 * i}
            position.plot(flight.time, flight.position[:, i], label=f'${axis}$', **look)
        for level in np.unique(goal):
            position.axhline(level, **DASHED)
        tilt.plot(flight.time, np.degrees(flight.tilt), color='black')
        _speeds(speeds, flight, vehicle)
        margin.plot(flight.time, study.samples[name]['margin'], color='black')
        margin.axhline(0.0, **DASHED)
        for axes in column:
            mark(axes, study.marks(name))
        position.set_title(titles[name])
        margin.tick_params(labelbottom=True)
        margin.set_xlabel('time [s]')
    for axes in stacks[len(flights) :].flatten():
        axes.remove()
    names = ('position [m]', 'tilt [°]', 'rotor speed [rad/s]', 'margin [N, N m]')
    for axes, label in zip(grid[:, 0], names * blocks, strict=True):
        axes.set_ylabel(label)
    first = grid[0, 0]
    first.legend(handles=first.lines[:3], loc='lower right')
    first.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    first.set_xlim(max(0.0, min(moments) - 1.0), min(study.end, max(moments) + AFTER))
    # A falling vehicle leaves the panel, so that the scale suits the others.
    places = np.concatenate([goal, np.zeros(3)])
    margins = pd.concat([own['margin'] for own in study.samples.values()])
    highest = float(np.nanmax(margins, initial=0.0))
    lowest = max(float(np.nanmin(margins, initial=0.0)), -2.0 * highest)
    for position, _, _, margin in stacks[::columns]:
        position.set_ylim(places.min() - 2.0, places.max() + 1.0)
        margin.set_ylim(lowest - 0.1 * highest, 1.1 * highest or 1.0)
    return figure


def _looks(vehicle: Vehicle) -> dict[str, dict[str, Any]]:
    """Return the line properties of rotors; where they coincide, those below are wider."""
    n = vehicle.n
    return {f'rotor {i + 1}': {**line(i), 'linewidth': 3.0 - 2.1 * i / n} for i in range(n)}


def _speeds(axes: Axes, flight: Flight, vehicle: Vehicle) -> None:
    for speeds, look in zip(flight.speeds.T, _looks(vehicle).values(), strict=True):
        axes.plot(flight.time, speeds, **look)
    for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
        axes.axhline(bound, **DASHED)


def _lines(
    axes: Axes,
    flights: Mapping[str, Flight],
    values: Mapping[str, Array],
    goal: float | None,
    last: float = np.inf,
) -> None:
    """Draw values of each method over the last seconds of its flight, and the goal dashed."""
    for name, look in styles(list(flights), coinciding=True).items():
        time = flights[name].time
        part = time >= time[-1] - last
        axes.plot(time[part], values[name][part], **look)
    if goal is not None:
        axes.axhline(goal, **DASHED)
    axes.margins(x=0.0)
