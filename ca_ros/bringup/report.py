"""The report of a flight: a summary, what was served of the demands, and a plot."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.bringup.flight import Flown
from ca_ros.bringup.options import POSITION_TOLERANCE
from ca_ros.bringup.recorder import DEMANDED, RESIDUAL, UNALLOCATED
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.figures import DASHED, WIDTHS, draw_lines, line, mark, rotor_lines, sheet, style
from ca_ros.problem.audit import audit
from ca_ros.problem.limits import shares
from ca_ros.simulation.record import Flight
from ca_ros.vehicle.motors import HEALTH_MIN
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.state import difference
from ca_ros.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    # bringup flies without matplotlib.
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ANNOUNCED = 1.0  # time in which an announced failure takes effect in real time [s]
CUT = 1e-3  # residual, as a share of half of the range of an axis, up to which it is not cut
RECENT = 1.0  # time of the flight that shows whether the vehicle approaches its waypoint [s]

NOWHERE = (np.nan,) * len(AXES)
HEADING_TOLERANCE = math.radians(0.5) / 0.02  # of the heading, over that of the position [rad/m]


def summarize(
    flown: Flown, waypoint: Waypoint, served: Shares | None = None,
    tolerance: float = POSITION_TOLERANCE,
) -> tuple[str, bool]:
    """Return the summary of a flight, and whether the waypoint was reached.

    Where yaw is lost, the position alone decides.  `served`: see `shares_of`.  `tolerance` is that
    of the position [m], the heading has `HEADING_TOLERANCE` of it.
    """
    flight, mode = flown.flight, flown.parameters['mode']
    vehicle = flown.vehicle
    posed = flown.parameters.get('controller.attitude') == 'pose'
    error, heading_error = flight.position_error(waypoint), flight.heading_error(waypoint)
    end = round(flight.time[-1] * 1e9)
    last = flown.failures.after(vehicle, end)
    lost = audit(last).lost
    reached = error <= tolerance
    if 'yaw' in lost:
        away = f'{1e3 * error:.1f} mm away; the heading is given up'
    else:
        heading_error = flight.attitude_error(waypoint) if posed else heading_error
        reached = reached and heading_error <= HEADING_TOLERANCE * tolerance
        away = f'{1e3 * error:.1f} mm and {math.degrees(heading_error):.3f} degrees away'
    speeds, inside = flight.speeds, 'within' if _within_bounds(flown) else 'OUT OF'
    how = f'{mode}, {len(flight.time)} samples, in {flown.wall:.1f} s'
    span = f'{speeds.min():.1f} to {speeds.max():.1f} rad/s in flight'
    lines = [
        f'flight of {flight.time[-1]:.2f} s ({how})',
        f'  waypoint      {"reached" if reached else "MISSED"}: {away}',
        f'  rotor speeds  {", ".join(f"{speed:.1f}" for speed in speeds[-1])} rad/s at the end,',
        f'                {span}, {inside} bounds',
    ]
    if len(vehicle.servos):
        ends = ', '.join(f'{angle + 0.0:.3f}' for angle in flight.angles[-1].round(3))
        lines.append(f'  tilt angles   {ends} rad at the end')
    lines += [f'  cut           {text}' for text in (served.cuts if served else ())]
    lines += _failures(flown)
    weak = ', '.join(
        f'rotor {i + 1} lost' if health < HEALTH_MIN else f'rotor {i + 1} at {100.0 * health:g} %'
        for i, health in enumerate(last.health) if health < 1.0
    )
    stuck = [f'servo of rotor {i + 1} stuck' for i in last.servos.stuck_rotors]
    weak = ', '.join(filter(None, [weak, *stuck]))
    if weak:
        axes = f'; lost axes: {", ".join(lost)}' if lost else ''
        lines.append(f'  at the end    {weak}{axes}')
    lines += _incidents(flown)
    if not reached:
        lines += _hint(flown, waypoint, 'yaw' in lost, tolerance)
    return '\n'.join(lines), reached


@dataclass(frozen=True, eq=False)
class Shares:
    """The shares of the demands that were served, `values` (K, m), and a text for each axis cut.

    A share is nan while its axis is given up, and where a message is missing.
    """

    axes: tuple[str, ...]
    values: Array
    cuts: tuple[str, ...]


def shares_of(flown: Flown) -> Shares | None:
    """Return what was served of the demands; None if the nodes do not publish what they cut.

    A demand is the wrench that was commanded, and what the controller had cut from it; the
    residual of the allocator is not served.
    """
    flight, found = flown.flight, np.full((len(flown.flight.time), len(AXES)), np.nan)
    if not (flown.wrenches[UNALLOCATED] and flown.wrenches[RESIDUAL]):
        return None
    times = np.round(flight.time * 1e9).astype(int)
    commanded, unallocated, residual = (
        np.array([flown.wrenches[name].get(time, NOWHERE) for time in times.tolist()])
        for name in DEMANDED
    )
    demand, produced = commanded + unallocated, commanded - residual
    events = [*flown.failures.announced_times, *(round(t * 1e9) for t in flown.detected.values())]
    for start in sorted({0, *events}):
        problem = audit(_believed(flown, start)).independent
        later, rows = times >= start, [AXES.index(axis) for axis in problem.axes]
        part = np.full((later.sum(), len(AXES)), np.nan)
        part[:, rows] = shares(problem, demand[later][:, rows], produced[later][:, rows], CUT)
        part[np.isnan(demand[later]) | np.isnan(produced[later])] = np.nan
        found[later] = part
    cut = np.nan_to_num(found, nan=1.0) < 1.0
    step = float(np.median(np.diff(flight.time))) if len(flight.time) > 1 else 0.0
    cuts = []
    for k in np.flatnonzero(cut.any(axis=0)).tolist():
        i = int(np.nanargmin(found[:, k]))
        why = f', limited by {flown.limits[AXES[k]]}' if flown.limits.get(AXES[k]) else ''
        cuts.append(f'{AXES[k]} for {step * cut[:, k].sum():.2f} s, at {flight.time[i]:.2f} s to '
                    f'{100.0 * found[i, k]:.0f} %{why}')
    rows = [AXES.index(axis) for axis in flown.vehicle.axes]
    return Shares(flown.vehicle.axes, found[:, rows], tuple(cuts))


def _believed(flown: Flown, time: int) -> Vehicle:
    """Return the vehicle as the nodes know it at a time of flight [ns]."""
    known = flown.failures.known(flown.vehicle, time)
    actual = flown.failures.after(flown.vehicle, time).health
    health = known.health.copy()
    for rotor, found in flown.detected.items():
        if round(found * 1e9) <= time and rotor not in flown.withheld:
            health[rotor - 1] = actual[rotor - 1] if actual[rotor - 1] < 1.0 else 0.0
    return known.with_health(health)


def _failures(flown: Flown) -> list[str]:
    """Return lines on when rotors failed, and who said so."""
    lines, failures = [], flown.failures
    named = {
        rotor: f'{time:.2f} s{", not acted on" * (rotor in flown.withheld)}'
        for rotor, time in flown.detected.items()}
    for each in failures.failures:
        if each.time > flown.flight.time[-1]:
            continue
        what = 'lost' if each.health < HEALTH_MIN else f'at {100.0 * each.health:g} %'
        if each.angle is not None:
            what = f'stuck at {each.angle:g} rad'
        known = []
        if each.rotor in named:
            known.append(f'detected at {named[each.rotor]}')
        if failures.announce is not None:
            known.append(f'announced at {each.time + failures.announce:.2f} s')
        elif known:
            known.append('never announced')
        said = ', '.join(known) or 'never announced or detected'
        lines.append(f'  failure       rotor {each.rotor} {what} at {each.time:.2f} s, {said}')
    for rotor in sorted(named.keys() - {each.rotor for each in failures.failures}):
        lines.append(f'  FALSE ALARM   rotor {rotor} at {named[rotor]}')
    return lines


def _incidents(flown: Flown) -> list[str]:
    """Return lines on what disturbed the flight: restarts, timeouts, faults."""
    faults = {kind: count for kind, count in flown.faults.items() if kind != 'received' and count}
    lines = [
        f'  {title:<13} {", ".join(f"{name} {count}" for name, count in counts.items())}'
        for title, counts in (('respawned', flown.respawned), ('timeouts', flown.timeouts))
        if counts
    ]
    if flown.faults:
        said = ', '.join(f'{kind} {count}' for kind, count in faults.items()) or 'none'
        lines.append(f'  faults        {said}, of {flown.faults["received"]} messages')
    return lines


def _hint(flown: Flown, waypoint: Waypoint, spins: bool, tolerance: float) -> list[str]:
    """Return a line on why the waypoint was missed, if that is known."""
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    late = flown.timeouts or load > processors
    off = abs(flown.flight.position[-1, 2] - waypoint.position[2])
    if off > tolerance and not {'thrust', 'force_z'} & set(flown.vehicle.axes):
        hint = 'the vehicle has no vertical force: set z of --waypoint to that of the vehicle'
    elif speed := _approach(flown.flight, waypoint, spins, tolerance):
        hint = f'it was still approaching, {speed}: try a longer --duration'
        if not flown.parameters.get('controller.integral_gain'):
            hint += ', or controller.integral_gain if an offset remains'
    elif flown.parameters['mode'] == 'realtime' and late and not flown.faults:
        why = f'load average {load:.1f} on {processors} processors'
        hint = f'the machine may be too slow for real time ({why}): try --mode lockstep'
    else:
        return []
    return [f'  hint          {hint}']


def _approach(flight: Flight, waypoint: Waypoint, spins: bool, tolerance: float) -> str:
    """Return how fast the vehicle approached all the time of the last `RECENT` seconds, or ''."""
    late = flight.time >= flight.time[-1] - RECENT
    distance = np.linalg.norm(flight.position[late] - waypoint.position, axis=1)
    angle = np.abs(difference(flight.heading[late], waypoint.heading))
    unit, error = 'mm', 1e3 * distance
    if distance[-1] <= tolerance and not spins:
        unit, error = 'degrees', np.degrees(angle)
    time = float(flight.time[-1] - flight.time[late][0])
    # Sensors have noise.
    slack = 0.05 * (error[0] - error[-1])
    if not time or slack <= 1e-6 * error[0] or np.any(np.diff(error) > slack):
        return ''
    return f'by {(error[0] - error[-1]) / time:.3g} {unit}/s'


def _within_bounds(flown: Flown) -> bool:
    """Return whether each rotor kept its bounds as known at the time: 0 for a lost rotor."""
    flight, vehicle = flown.flight, flown.vehicle
    times = np.round(flight.time * 1e9)
    before = vehicle
    commands = np.column_stack([flight.speeds, flight.angles])
    inside = np.ones(commands.shape, dtype=bool)
    for start in [0, *flown.failures.announced_times]:
        believed = flown.failures.known(vehicle, start)
        later = times >= start
        inside[later] = _inside(commands[later], believed)
        if flown.parameters['mode'] == 'realtime':
            # Speeds that were commanded before the announcement may arrive after it.
            early = later & (times < start + ANNOUNCED * 1e9)
            inside[early] |= _inside(commands[early], before)
        before = believed
    for rotor in flown.detected:
        # What is detected is applied after it is recorded.
        inside[flight.time >= flown.detected[rotor], rotor - 1] |= True
    if flown.timeouts and flown.stops:
        inside[~flight.speeds.any(axis=1)] = True
    return bool(inside.all())


def _inside(commands: Array, vehicle: Vehicle) -> BoolArray:
    limits = zip(vehicle.speed_limits, vehicle.servos.limits, strict=True)
    low, high = map(np.concatenate, limits)
    return (commands >= low) & (commands <= high)


def draw_flight(
    flight: Flight, vehicle: Vehicle, trajectory: Trajectory, width: float = WIDTHS['page'],
    moments: Mapping[str, Sequence[float]] | None = None, served: Shares | None = None,
) -> Figure:
    """Plot position, attitude, rotor speeds and any tilt angles; waypoints and bounds are dashed.

    If the served shares of the demands are known, they are the last row.  The figure has a width
    [mm]; lines mark the moments, see `ca_ros.figures.mark`.
    """
    import matplotlib

    with matplotlib.rc_context(style(width)):
        servos = vehicle.servos
        tilts = [servos.rotors] if len(servos) else []
        count = 3 + len(tilts) + (served is not None)
        figure, body = sheet(1.0 + 2.0 * count)
        rows = body.subplots(count, 1, sharex=True)
        position, attitude, speeds = rows[:3]
        mark(position, moments or {})
        _draw(position, flight.time, flight.position, ('x', 'y', 'z'), 'position [m]')
        goals, headings = trajectory.goals(flight.time)
        position.plot(flight.time, goals, **DASHED)
        _draw(
            attitude, flight.time,
            np.degrees(np.column_stack([flight.euler[:, :2], flight.heading])),
            ('roll', 'pitch', 'heading'), 'angle [deg]',
        )
        attitude.plot(flight.time, np.degrees(headings), **DASHED)
        looks = rotor_lines(vehicle.n)
        _draw(speeds, flight.time, flight.speeds, looks, 'rotor speed [rad/s]')
        for rotors in tilts:
            _draw_angles(rows[3], flight, rotors, list(looks.values()))
            for limit in np.unique(servos.limits):
                rows[3].axhline(np.degrees(limit), **DASHED)
        if served is not None:
            _draw(rows[-1], flight.time, 100.0 * served.values, served.axes, 'served [%]')
            rows[-1].set_ylim(-5.0, 105.0)
        for axes in rows[1:]:
            mark(axes, moments or {})
        for bound in np.unique([vehicle.speed_min, vehicle.speed_max]):
            speeds.axhline(bound, **DASHED)
        rows[-1].set_xlabel('time [s]')
        speeds.set_xlim(flight.time[0], flight.time[-1])
    return figure


def _draw(
    axes: Axes, time: Array, values: Array, names: Sequence[str] | Mapping[str, Any], label: str
) -> None:
    if not isinstance(names, Mapping):
        names = {name: line(i) for i, name in enumerate(names)}
    draw_lines(axes, time, values, names)
    axes.set_ylabel(label)
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))


def _draw_angles(
    axes: Axes, flight: Flight, rotors: list[int], looks: list[dict[str, Any]]
) -> None:
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
