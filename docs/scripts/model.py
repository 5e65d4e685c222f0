"""Draw the pictures of docs/model.md: frames.png, and vehicles.png with every shipped vehicle."""

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch
from pages import DOCS, shipped

from ca_ros import Vehicle
from ca_ros.arrays import Array
from ca_ros.figures import COLORS, inches, save, style
from ca_ros.vehicle.files import shipped_tilting

CW, CCW, LEAN, TILT, BODY = COLORS[0], COLORS[1], 'black', COLORS[2], '0.6'
COLUMNS = 4
SAME = 'hexarotor_realistic'  # has the rotors of `hexarotor`
APART = 0.05  # rotors nearer to each other from above [share of the size] are drawn side by side


def seen_from_above(xy: Array) -> Array:
    """Return forward-left (..., 2) as right-up of a picture whose top is forward."""
    return np.stack([-xy[..., 1], xy[..., 0]], axis=-1)


def arrow(
    axes: Axes, start: Any, end: Any, color: str, width: float = 1.2, **more: Any
) -> None:
    """Draw an arrow between two points of a picture."""
    look = {'arrowstyle': '-|>', 'mutation_scale': 7.0, 'shrinkA': 0.0, 'shrinkB': 0.0, **more}
    axes.add_patch(FancyArrowPatch(start, end, color=color, linewidth=width, **look))


def turning(
    axes: Axes, center: Array, radius: float, clockwise: bool, color: str, width: float = 1.2,
    begin: float = 60.0, sweep: float = 290.0,
) -> None:
    """Draw an arrow along a circle; angles in degrees, from the right, counter-clockwise."""
    way = -1.0 if clockwise else 1.0
    angles = np.radians(begin + way * np.linspace(0.0, sweep, 60))
    points = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    axes.plot(*points[:-2].T, color=color, linewidth=width, solid_capstyle='butt')
    arrow(axes, points[-6], points[-1], color, width)


def nearest(found: Array) -> float:
    """Return the least distance between places (n, 2) that are not above each other."""
    far = np.linalg.norm(found[:, None] - found[None], axis=2)
    return float(far[far > APART * np.abs(found).max()].min())


def places(vehicle: Vehicle) -> tuple[Array, float]:
    """Return the places (n, 2) of the rotors in the picture, and the radius of their discs.

    Where rotors are above each other, the lower ones are moved outwards, one diameter each.
    """
    found = seen_from_above(vehicle.arms[:, :2])
    size = float(np.abs(found).max())
    radius = min(0.24 * size, 0.45 * nearest(found))
    for i in np.argsort(-vehicle.arms[:, 2], kind='stable'):
        above = [
            j for j in range(vehicle.n) if vehicle.arms[j, 2] > vehicle.arms[i, 2] + 1e-6
            and np.linalg.norm(vehicle.arms[j, :2] - vehicle.arms[i, :2]) < APART * size]
        if above:
            out = found[i] / np.linalg.norm(found[i])
            found[i] = found[i] + 2.3 * radius * len(above) * out
    return found, radius


def draw_vehicle(axes: Axes, name: str) -> None:
    """Draw the rotors of a vehicle from above: numbers, spins, leans and tilts."""
    vehicle = Vehicle.load(name)
    at, radius = places(vehicle)
    axes.plot(0.0, 0.0, '+', color='black', markersize=5, markeredgewidth=0.9, zorder=4)
    for i in range(vehicle.n):
        axes.plot(*np.column_stack([np.zeros(2), at[i]]), color=BODY, linewidth=1.0, zorder=0)
    for i in range(vehicle.n):
        spins = float(vehicle.torque_coefficient[i]) > 0.0
        color = (CW if vehicle.spins[i] > 0 else CCW) if spins else BODY
        axes.add_patch(Circle(at[i], radius, facecolor='white', linewidth=0.0, zorder=1))
        if spins:
            turning(axes, at[i], radius, bool(vehicle.spins[i] > 0), color)
        else:
            axes.add_patch(Circle(at[i], radius, fill=False, edgecolor=color, zorder=1))
        axes.text(at[i][0], at[i][1], str(i + 1), ha='center', va='center_baseline', fontsize=7.5,
                  zorder=5)
        servos, axis = vehicle.servos, vehicle.rotor_axes[i]
        turned = servos.driven[i] * np.cross(servos.axes[i], axis)
        lean, tilt = seen_from_above(axis[:2]), seen_from_above(turned[:2])
        begin = 1.15 * radius
        for vector, color in (lean, LEAN), (tilt, TILT):
            if np.linalg.norm(vector) > 1e-9:
                out = vector / np.linalg.norm(vector)
                start = at[i] + begin * out
                arrow(axes, start, start + 1.0 * radius * out, color, zorder=4)
                # Two arrows to one side are drawn one after the other.
                begin += 1.15 * radius * bool(lean @ tilt > 0.0)
    reach = float(np.abs(at).max()) + 2.2 * radius
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect='equal')
    axes.set_title(name, loc='center')
    axes.axis('off')


def vehicles() -> Figure:
    """Draw the rotors of all shipped vehicles."""
    names = [name for name in shipped() if name != SAME] + list(shipped_tilting())
    rows = -(-len(names) // COLUMNS)
    figure = Figure(figsize=(inches(), rows * inches() / COLUMNS * 1.12 + 0.45),
                    layout='constrained')
    entries = [
        Line2D([], [], color=CW, label='clockwise (cw): positive yaw torque'),
        Line2D([], [], color=CCW, label='counter-clockwise (ccw): negative yaw torque'),
        *(Line2D([], [], color=color, marker='>', markersize=4, label=words) for color, words in (
            (LEAN, 'direction of a thrust that is not vertical'),
            (TILT, 'where a positive tilt angle turns the thrust'))),
    ]
    parts = figure.subplots(rows, COLUMNS).ravel()
    for axes in parts:
        axes.axis('off')
    for axes, name in zip(parts, names, strict=False):
        draw_vehicle(axes, name)
    figure.legend(handles=entries, loc='outside upper center', ncols=2, frameon=False)
    return figure


def axis_into(axes: Axes, at: Array, name: str, out: bool) -> None:
    """Draw an axis that points out of the picture, or into it."""
    look: Any = {'facecolor': 'white', 'edgecolor': 'black', 'linewidth': 1.0, 'zorder': 4}
    axes.add_patch(Circle((at[0], at[1]), 0.09, **look))
    marker, size = ('o', 2.6) if out else ('x', 4.4)
    axes.plot(*at, marker, color='black', markersize=size, zorder=5)
    axes.text(at[0] - 0.14, at[1] - 0.14, name, ha='right', va='top')


def body_axes(axes: Axes, right: str, up: str, third: str, out: bool, flip: bool = False) -> None:
    """Draw the axes of a frame: one to a side, one up, and one out of the picture or into it."""
    side = -1.0 if flip else 1.0
    arrow(axes, (0, 0), (side * 1.0, 0), 'black', zorder=3)
    arrow(axes, (0, 0), (0, 1.0), 'black', zorder=3)
    axes.text(side * 1.05, 0.0, right, ha='right' if flip else 'left', va='center')
    axes.text(0.0, 1.08, up, ha='center', va='bottom')
    axis_into(axes, np.zeros(2), third, out)


def craft(axes: Axes, angle: float, color: str) -> None:
    """Draw a multirotor from the side, turned clockwise by an angle [degrees]."""
    turn = np.radians(-angle)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    parts = [((-0.75, 0.0), (0.75, 0.0)), *(
        part for x in (-0.75, 0.75)
        for part in (((x, 0.0), (x, 0.14)), ((x - 0.3, 0.14), (x + 0.3, 0.14))))]
    for part in parts:
        axes.plot(*(matrix @ np.array(part).T), color=color, linewidth=1.6, zorder=1)


def frames() -> Figure:
    """Draw the axes of body and world, and the sign of each rotation."""
    figure = Figure(figsize=(inches(), inches() / 4.0 * 1.08), layout='constrained')
    rear, side, top, world = figure.subplots(1, 4)
    for axes, title, low in (
        (rear, 'from behind: roll +', 'the right side goes down'),
        (side, 'from the right: pitch +', 'the nose goes down'),
        (top, 'from above: yaw +', 'the nose goes to the left'),
        (world, 'world: heading +', 'from east towards north'),
    ):
        axes.set(xlim=(-1.35, 1.35), ylim=(-1.3, 1.4), aspect='equal')
        axes.set_title(title, loc='center', fontsize=9)
        axes.text(0.0, -1.15, low, ha='center', va='center', fontsize=8)
        axes.axis('off')
    for axes in (rear, side):
        craft(axes, 0.0, '0.82')
        craft(axes, 20.0, COLORS[0])
        turning(axes, np.zeros(2), 0.62, True, COLORS[2], begin=70.0, sweep=55.0)
    body_axes(rear, 'y left', 'z up', 'x', out=False, flip=True)
    body_axes(side, 'x', 'z up', 'y', out=False)
    for at, clockwise in (((-0.6, 0.6), True), ((-0.6, -0.6), False), ((0.6, -0.6), True),
                          ((0.6, 0.6), False)):
        place = np.array(at)
        top.plot(*np.column_stack([np.zeros(2), place]), color='0.82', linewidth=1.6, zorder=0)
        turning(top, place, 0.24, clockwise, CW if clockwise else CCW)
        top.text(*place, 'cw' if clockwise else 'ccw', ha='center', va='center', fontsize=7)
    turning(top, np.zeros(2), 0.42, False, COLORS[2], begin=20.0, sweep=50.0)
    body_axes(top, 'y', 'x forward', 'z', out=True, flip=True)
    body_axes(world, 'east', 'north', 'up', out=True)
    arrow(world, (0, 0), 0.85 * np.array([np.cos(0.7), np.sin(0.7)]), COLORS[0], 1.6, zorder=3)
    world.text(0.7, 0.58, 'forward', color=COLORS[0], ha='left', va='bottom')
    turning(world, np.zeros(2), 0.5, False, COLORS[2], begin=3.0, sweep=34.0)
    return figure


if __name__ == '__main__':
    with matplotlib.rc_context(style()):
        save(frames(), DOCS / 'frames.png', ['png'])
        save(vehicles(), DOCS / 'vehicles.png', ['png'])
