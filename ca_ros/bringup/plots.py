"""Plots of flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.trajectory import Trajectory
from ca_ros.figures import DASHED, WIDTHS, draw_lines, line, mark, rotor_lines, sheet, style
from ca_ros.simulation.record import Flight
from ca_ros.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    # bringup flies without matplotlib.
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ca_ros.bringup.served import Served


def draw_flight(
    flight: Flight, vehicle: Vehicle, trajectory: Trajectory, width: float = WIDTHS['page'],
    moments: Mapping[str, Sequence[float]] = MappingProxyType({}), served: Served | None = None,
) -> Figure:
    """Plot position, attitude, rotor speeds and any tilt angles; waypoints and bounds are dashed.

    If the served shares of the demands are known, they are the last row.  The figure has a width
    [mm]; lines mark the moments, see `ca_ros.figures.mark`.
    """
    import matplotlib

    with matplotlib.rc_context(style(width)):
        servos = vehicle.servos
        count = 3 + (len(servos) > 0) + (served is not None)
        figure, body = sheet(1.0 + 2.0 * count)
        rows = body.subplots(count, 1, sharex=True)
        position, attitude, speeds = rows[:3]
        mark(position, moments)
        _lines(position, flight.time, flight.position, ('x', 'y', 'z'), 'position [m]')
        goals, headings = trajectory.goals(flight.time)
        position.plot(flight.time, goals, **DASHED)
        _lines(
            attitude, flight.time,
            np.degrees(np.column_stack([flight.euler[:, :2], flight.heading])),
            ('roll', 'pitch', 'heading'), 'angle [deg]',
        )
        attitude.plot(flight.time, np.degrees(headings), **DASHED)
        looks = rotor_lines(vehicle.n)
        _lines(speeds, flight.time, flight.speeds, looks, 'rotor speed [rad/s]')
        if len(servos):
            _angles(rows[3], flight, servos.rotors, list(looks.values()))
            for limit in np.unique(servos.limits):
                rows[3].axhline(np.degrees(limit), **DASHED)
        if served is not None:
            _lines(rows[-1], flight.time, 100.0 * served.shares, served.axes, 'served [%]')
            rows[-1].set_ylim(-5.0, 105.0)
        for axes in rows[1:]:
            mark(axes, moments)
        for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
            speeds.axhline(bound, **DASHED)
        rows[-1].set_xlabel('time [s]')
        speeds.set_xlim(flight.time[0], flight.time[-1])
    return figure


def _lines(
    axes: Axes, time: Array, values: Array, names: Sequence[str] | Mapping[str, Any], label: str
) -> None:
    if not isinstance(names, Mapping):
        names = {name: line(i) for i, name in enumerate(names)}
    draw_lines(axes, time, values, names)
    axes.set_ylabel(label)
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))


def _angles(axes: Axes, flight: Flight, rotors: list[int], looks: list[dict[str, Any]]) -> None:
    """Draw the angle of each servo in its rotor's colour; the second one of a gimbal is dashed."""
    first = [rotor not in rotors[:i] for i, rotor in enumerate(rotors)]
    for i, rotor in enumerate(rotors):
        axes.plot(
            flight.time, np.degrees(flight.angles[:, i]), color=looks[rotor]['color'],
            linestyle='-' if first[i] else '--',
        )
    axes.set_ylabel('tilt angle [deg]')
    if not all(first):
        names = ('outer ring', 'inner ring')
        axes.legend(axes.lines[:2], names, loc='center left', bbox_to_anchor=(1.0, 0.5))
