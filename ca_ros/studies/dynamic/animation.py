"""An animation of flights as a GIF file, methods side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from PIL import Image
from scipy.spatial.transform import Rotation

from ca_ros.arrays import Array
from ca_ros.control.waypoint import Waypoint
from ca_ros.figures import COLORS, DASHED, style
from ca_ros.simulation.record import Flight
from ca_ros.studies.dynamic.metrics import Flights
from ca_ros.studies.plot_style import title
from ca_ros.vehicle.vehicle import Vehicle

FRAMES_PER_SECOND = 12.5  # GIF files store the duration of a frame in hundredths of a second
LEAD = 1.0  # time before the first failure at which the animation starts [s]
ACROSS = 4  # number of methods side by side; more stand in further rows
ERROR_SHOWN = 0.01  # least upper end of the scale of the torque error [N m]
PAUSE = 1.5  # time for which the last frame is shown [s]

TITLES = {
    'pseudo_inverse': 'clipped pseudo-inverse',
    'fixed_pseudo_inverse': 'clipped pseudo-inverse, computed once',
}
BODY, THRUST, LOST, FRONT = '#404040', COLORS[0], COLORS[1], COLORS[2]
SHADES = {'#000000': 12, BODY: 6, THRUST: 6, LOST: 6, FRONT: 6}
"""Colours of the palette, and the number of steps from each to white."""

CIRCLE = np.linspace(0.0, 2.0 * np.pi, 33)


def animate(path: Path, study: Flights) -> None:
    """Write an animation of flights, in real time, as a GIF file.

    Each column shows the vehicle as it is at the start, with the thrust of each rotor as an
    arrow, and below it margin and torque error from `sample_errors`. The view follows the vehicle;
    all vehicles have one scale. Up to `ACROSS` columns stand in a row. A + marks the waypoint that
    counts at the time. A vehicle that falls below its start after a failure stays there.
    """
    flights, vehicle, end = study.flights, study.vehicle, study.end
    moments = [time for time in study.moments if time < end]
    start = max(0.0, min(moments) - LEAD) if moments else 0.0
    grounds = {name: _ground(flight, moments) for name, flight in flights.items()}
    frames = []
    with matplotlib.rc_context(style()):
        columns = min(len(flights), ACROSS)
        rows = [list(flights)[i : i + columns] for i in range(0, len(flights), columns)]
        figure = Figure(figsize=(4.0 * columns, 6.0 * len(rows)), dpi=100)
        canvas: Any = FigureCanvasAgg(figure)
        place = {'left': 0.07, 'right': 0.99, 'bottom': 0.4, 'top': 0.91, 'wspace': 0.06}
        look: dict[str, Any] = {'projection': '3d', 'computed_zorder': False}
        parts: Any = figure.subfigures(len(rows), 1, squeeze=False)[:, 0]
        scenes: list[Any] = []
        cursors: dict[str, list[tuple[Any, Array]]] = {}
        for part, row in zip(parts, rows, strict=True):
            grid = part.add_gridspec(1, columns, **place)
            scenes += [part.add_subplot(grid[0, i], **look) for i in range(len(row))]
            own = {name: grounds[name] for name in row}
            cursors |= _plots(part, columns, study, own, moments, (start, end))
        for time in np.arange(start, end, 1.0 / FRAMES_PER_SECOND):
            goal = study.trajectory.at(round(time * 1e9))
            for scene, (name, flight) in zip(scenes, flights.items(), strict=True):
                k = min(int(np.searchsorted(flight.time, time + 1e-9)) - 1, grounds[name])
                flown = study.failures.after(vehicle, round(time * 1e9))
                _draw_vehicle(scene, flight, k, flown, goal)
                scene.set_title(TITLES.get(name, title(name)), fontsize='x-large', pad=14.0)
                tilt = f'tilt {np.degrees(flight.tilt[k]):2.0f}°'
                height = f'height {flight.position[k, 2]:.2f} m'
                caption = 'on the ground' if k == grounds[name] else f'{height}   {tilt}'
                look = {'transform': scene.transAxes, 'ha': 'center', 'fontsize': 'large'}
                scene.text2D(0.5, 1.0, caption, **look)
                for cursor, values in cursors[name]:
                    cursor.set_data([flight.time[k]], [values[k]])
            canvas.draw()
            frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB'))
    _write(path, frames)


def _ground(flight: Flight, moments: Sequence[float]) -> int:
    """Return the sample at which a vehicle falls below its start after a failure, or K."""
    low = flight.position[:, 2] < flight.position[0, 2] - 0.05
    found = np.flatnonzero(low & (flight.time > min(moments, default=np.inf)))
    return int(found[0]) if len(found) else len(flight.time)


def _plots(
    figure: SubFigure, columns: int, study: Flights, grounds: Mapping[str, int],
    moments: Sequence[float], limits: tuple[float, float],
) -> dict[str, list[tuple[Any, Array]]]:
    """Draw the curves up to the grounds; return markers of the present time, and the values."""
    place = {'left': 0.1, 'right': 0.98, 'bottom': 0.09, 'top': 0.38, 'hspace': 0.3}
    grid = figure.add_gridspec(2, columns, wspace=0.1, **place)
    axes = grid.subplots(sharex=True, sharey='row', squeeze=False)
    cursors: dict[str, list[tuple[Any, Array]]] = {}
    for (name, ground), column in zip(grounds.items(), axes.T, strict=False):
        cursors[name] = []
        time = study.flights[name].time[: ground + 1]
        for plot, key in zip(column, ('margin', 'torque_error'), strict=True):
            values = study.samples[name][key].to_numpy()
            plot.plot(time, values[: ground + 1], color='black')
            plot.axhline(0.0, **DASHED)
            for moment in moments:
                plot.axvline(moment, color=LOST, linestyle=':', linewidth=1.2)
            [cursor] = plot.plot([], [], 'o', color=THRUST, markersize=8, clip_on=False, zorder=5)
            cursors[name].append((cursor, values))
        column[-1].set_xlabel('time [s]')
    axes[0, 0].set_ylabel('margin\n[N, N m]')
    axes[1, 0].set_ylabel('torque error\n[N m]')
    axes[0, 0].set_xlim(limits)
    errors = axes[1, 0]
    errors.set_ylim(top=max(errors.get_ylim()[1], ERROR_SHOWN))
    for plot in axes[:, len(grounds) :].flatten():
        plot.remove()
    figure.align_ylabels(axes[:, 0])
    return cursors


def _draw_vehicle(axes: Any, flight: Flight, k: int, vehicle: Vehicle, waypoint: Waypoint) -> None:
    """Draw a vehicle at sample k: arms, rotor disks, thrusts, waypoint and path."""
    axes.clear()
    arm = float(np.linalg.norm(vehicle.arms, axis=1).max())
    radius, reach = 0.42 * arm * min(1.0, 6.0 / vehicle.n), 1.5 * arm
    place, turn = flight.position[k], Rotation.from_quat(flight.attitude[k]).as_matrix().T
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.22)
    axes.view_init(elev=18.0, azim=-62.0)
    for name, axis, middle in zip('xyz', (axes.xaxis, axes.yaxis, axes.zaxis), place, strict=True):
        low, high = middle - reach, middle + reach
        ticks = np.arange(np.ceil(low * 2.0), high * 2.0) / 2.0
        axes.set(**{f'{name}lim': (low, high), f'{name}ticks': ticks, f'{name}ticklabels': []})
        axis.set_tick_params(length=0)
        axis.set_pane_color('white')

    path = flight.position[: k + 1]
    path = np.where(np.all(np.abs(path - place) < reach, axis=1)[:, None], path, np.nan)
    axes.plot(*path.T, color='0.6', linewidth=1.2)
    if np.all(np.abs(waypoint.position - place) < reach):
        axes.plot(*waypoint.position[:, None], '+', color='black', markersize=12, mew=2.0)

    hubs = place + vehicle.arms @ turn
    greatest = float(vehicle.with_health(np.ones(vehicle.n)).thrusts(vehicle.speed_max).max())
    shares = vehicle.thrusts(flight.speeds[k]) / greatest
    rotor_axes = vehicle.rotor_axes @ turn
    for hub, axis, share, health in zip(hubs, rotor_axes, shares, vehicle.health, strict=True):
        color = LOST if health < 1.0 else BODY
        axes.plot(*np.transpose([place, hub]), color=BODY, linewidth=3.0)
        axes.plot(*_disk(hub, axis, radius).T, color=color, linewidth=1.8)
        if health < 1.0:
            axes.plot(*hub[:, None], 'x', color=LOST, markersize=12, mew=3.0)
        if share > 0.0:
            push = 1.5 * arm * share * axis
            axes.quiver(*hub, *push, color=THRUST, linewidth=2.8, arrow_length_ratio=0.25)
    front = place + 0.4 * arm * turn[0]
    axes.plot(*np.transpose([place, front]), color=FRONT, linewidth=6.0)


def _disk(center: Array, axis: Array, radius: float) -> Array:
    """Return a circle (33, 3) around a centre, perpendicular to an axis."""
    one = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    one /= np.linalg.norm(one)
    two = np.cross(axis, one)
    return center + radius * (np.outer(np.cos(CIRCLE), one) + np.outer(np.sin(CIRCLE), two))


def _write(path: Path, frames: Sequence[Image.Image]) -> None:
    """Write frames with one palette: the same colours at a third of the size."""
    palette = Image.new('P', (1, 1))
    colors = [
        [round(255.0 * (1.0 - share * (1.0 - part))) for part in to_rgb(color)]
        for color, steps in SHADES.items() for share in np.arange(steps + 1) / steps
    ]
    palette.putpalette([part for color in colors for part in color])
    first, *others = (
        frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    )
    durations = [round(1000.0 / FRAMES_PER_SECOND)] * len(others) + [round(1000.0 * PAUSE)]
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0)
