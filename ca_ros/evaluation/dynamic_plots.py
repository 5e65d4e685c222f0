"""Plots of the dynamic study, as Figures 2 to 4 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ca_ros.arrays import Array
from ca_ros.evaluation.flight_metrics import steady
from ca_ros.evaluation.plot_style import coinciding, legend, sheet, title
from ca_ros.flight.plots import COLORS, DASHED, STYLE, line, save
from ca_ros.flight.record import Flight
from ca_ros.flight.waypoint import Waypoint
from ca_ros.vehicle.vehicle import Vehicle


def draw(
    out: Path,
    flights: Mapping[str, Flight],
    vehicle: Vehicle,
    waypoint: Waypoint,
    formats: Sequence[str],
    moments: Sequence[float] = (),
    margins: Mapping[str, Array] | None = None,
) -> None:
    """Draw all plots of a dynamic study into a folder.

    Parameters
    ----------
    out : Path
    flights : mapping of str to Flight
    vehicle : Vehicle
        As it is at the start.
    waypoint : Waypoint
    formats : sequence of str
    moments : sequence of float
        When a rotor fails or a failure is announced [s]; dotted.
    margins : mapping of str to (K,) array
        Margin of the commanded wrenches in the set that the rotors physically have [N, N m];
        draws the plot of the failure.
    """
    with matplotlib.rc_context(STYLE):
        plots = {
            'position': _draw_position(flights, waypoint),
            'attitude': _draw_attitude(flights, waypoint),
            'rotor_speeds': _draw_speeds(flights, vehicle),
        }
        if margins:
            plots['failure'] = _draw_failure(flights, margins, vehicle, waypoint, moments)
        for name, plot in plots.items():
            save(plot, out / name, formats)


def _draw_position(flights: Mapping[str, Flight], waypoint: Waypoint) -> Figure:
    """Draw the position over time, and what is missing to the waypoint at the end."""
    figure, head, body = sheet(7.0, 5.4, len(flights))
    panels = body.subplots(3, 2, sharex='col', width_ratios=(3, 1))
    ends = {
        name: (flight.time[steady(flight)], flight.position[steady(flight)])
        for name, flight in flights.items()
    }
    for i, (whole, end) in enumerate(panels):
        goal = float(waypoint.position[i])
        _lines(whole, {name: (f.time, f.position[:, i]) for name, f in flights.items()}, goal)
        left = {name: (time, 1e3 * (path[:, i] - goal)) for name, (time, path) in ends.items()}
        _lines(end, left, 0.0)
        whole.set_ylabel(f'${"xyz"[i]}$ [m]')
        end.set_ylabel(f'error in ${"xyz"[i]}$ [mm]')
        end.margins(y=0.2)
    panels[0][1].set_title('last second', fontsize='medium')
    for axes in panels[-1]:
        axes.set_xlabel('time [s]')
    legend(head, panels[0][0].get_lines()[: len(flights)])
    return figure


def _draw_attitude(flights: Mapping[str, Flight], waypoint: Waypoint) -> Figure:
    """Draw the attitude over time."""
    figure, head, body = sheet(7.0, 5.4, len(flights))
    panels = body.subplots(3, 1, sharex=True)
    goals = (None, None, float(np.degrees(waypoint.heading)))
    for i, (name, axes) in enumerate(zip(('roll', 'pitch', 'heading'), panels, strict=True)):
        angles = {
            method: (f.time, np.degrees(f.heading if name == 'heading' else f.euler[:, i]))
            for method, f in flights.items()
        }
        _lines(axes, angles, goals[i])
        axes.set_ylabel(f'{name} [°]')
    panels[-1].set_xlabel('time [s]')
    legend(head, panels[0].get_lines())
    return figure


def _draw_speeds(flights: Mapping[str, Flight], vehicle: Vehicle) -> Figure:
    """Draw the rotor speeds, one panel a method."""
    rows, columns = -(-len(flights) // 2), 6 if vehicle.n % 6 == 0 else 4
    figure, head, body = sheet(7.0, 0.4 + 2.2 * rows, vehicle.n, columns)
    panels = body.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).flatten()
    for (name, flight), axes in zip(flights.items(), panels, strict=False):
        _speeds(axes, flight, vehicle)
        axes.set_title(title(name), fontsize='medium')
        axes.margins(x=0.0)
    for axes in panels[: len(flights) : 2]:
        axes.set_ylabel('rotor speed [rad/s]')
    for axes in panels[len(flights) :]:
        axes.remove()
    for axes in panels[max(len(flights) - 2, 0) : len(flights)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel('time [s]')
    legend(head, panels[0].get_lines()[: vehicle.n], columns)
    return figure


def _draw_failure(
    flights: Mapping[str, Flight],
    margins: Mapping[str, Array],
    vehicle: Vehicle,
    waypoint: Waypoint,
    moments: Sequence[float],
) -> Figure:
    """Draw flights with rotor failures beside each other, one column a method."""
    columns = 6 if vehicle.n % 6 == 0 else 4
    figure, head, body = sheet(3.2 * len(flights) + 0.6, 7.6, vehicle.n, columns)
    rows = body.subplots(4, len(flights), sharex=True, sharey='row', squeeze=False)
    names = ('position [m]', 'tilt [°]', 'rotor speed [rad/s]', 'margin [N, N m]')
    for name, column in zip(flights, rows.T, strict=True):
        flight, (position, tilt, speeds, margin) = flights[name], column
        for i, axis in enumerate('xyz'):
            # Where coordinates coincide, those below are wider.
            look = {'color': ('0.65', '0.3', COLORS[1])[i], 'linewidth': 3.2 - 1.0 * i}
            position.plot(flight.time, flight.position[:, i], label=f'${axis}$', **look)
        for level in np.unique(waypoint.position):
            position.axhline(level, **DASHED)
        tilt.plot(flight.time, np.degrees(flight.tilt), color='black')
        _speeds(speeds, flight, vehicle)
        margin.plot(flight.time, margins[name], color='black')
        margin.axhline(0.0, **DASHED)
        for axes in column:
            for moment in moments:
                axes.axvline(moment, color='black', linestyle=':', linewidth=0.8)
        position.set_title(title(name), fontsize='medium')
        margin.set_xlabel('time [s]')
    for axes, label in zip(rows[:, 0], names, strict=True):
        axes.set_ylabel(label)
    rows[0, 0].legend(loc='lower left')
    end = max(float(flight.time[-1]) for flight in flights.values())
    rows[0, 0].set_xlim(max(0.0, min(moments) - 2.0), end)
    # A vehicle that falls leaves the panel: the others would not be seen beside it.
    places = np.concatenate([waypoint.position, np.zeros(3)])
    rows[0, 0].set_ylim(places.min() - 2.0, places.max() + 1.0)
    found = np.concatenate(list(margins.values()))
    highest = float(np.nanmax(found, initial=0.0))
    lowest = max(float(np.nanmin(found, initial=0.0)), -2.0 * highest)
    rows[3, 0].set_ylim(lowest - 0.1 * highest, 1.1 * highest or 1.0)
    legend(head, rows[2, 0].get_lines()[: vehicle.n], columns)
    return figure


def _speeds(axes: Axes, flight: Flight, vehicle: Vehicle) -> None:
    """Draw the rotor speeds; symmetric rotors coincide, so those below are wider."""
    for i in range(vehicle.n):
        look = {**line(i), 'linewidth': 3.0 - 2.1 * i / vehicle.n}
        axes.plot(flight.time, flight.speeds[:, i], label=f'rotor {i + 1}', **look)
    for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
        axes.axhline(bound, **DASHED)


def _lines(axes: Axes, curves: Mapping[str, tuple[Array, Array]], goal: float | None) -> None:
    """Draw times and values of each method, and the waypoint dashed."""
    looks = coinciding(list(curves))
    for name, (time, values) in curves.items():
        axes.plot(time, values, label=title(name), **looks[name])
    if goal is not None:
        axes.axhline(goal, **DASHED)
    axes.margins(x=0.0)
