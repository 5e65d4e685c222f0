"""The options of a command line that say what is flown: waypoints and rotor failures."""

import argparse
import math
from pathlib import Path
from typing import Any

from ca_ros.arguments import finite, shown
from ca_ros.control.trajectory import COLUMNS, Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.settings import ParameterError
from ca_ros.simulation.rotor_failures import ANNOUNCE, LATEST, RotorFailure, RotorFailures
from ca_ros.vehicle.vehicle import Vehicle

POSITION, HEADING = (1.0, 1.0, 1.0), 45.0  # the paper's waypoint [m, degrees]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the waypoint or the trajectory, and for rotor failures."""
    add = parser.add_argument
    add('--waypoint', type=finite, nargs=3, metavar=('X', 'Y', 'Z'),
        help=f'position to fly to [m] (default: {" ".join(f"{x:g}" for x in POSITION)})')
    add('--heading', type=finite, help=f'heading to turn to [degrees] (default: {HEADING:g})')
    file = f'a CSV file with {", ".join(COLUMNS)}, in s, m and rad'
    add('--trajectory', type=Path, metavar='FILE',
        help=f'fly to one waypoint after the other: {file}; each becomes active at its time')
    health = 'to this health (0: lost); may be repeated'
    about = f'break a rotor (1 is the first) at a time of the flight [s], {health}'
    about += '; an angle, such as 0.4rad, instead of the health: its servo sticks there'
    fail: Any = {'type': shown(RotorFailure.parse), 'action': 'append', 'default': []}
    add('--fail', **fail, metavar='ROTOR@TIME[=HEALTH|=ANGLErad]', help=about)
    add('--announce', type=_delay, default=ANNOUNCE, metavar='SECONDS',
        help='time from a failure to its announcement to allocator and controller, or never')
    add('--detect', action='store_true',
        help='detect rotor failures from the motion; with --announce never nobody else names them')


def trajectory_of(options: argparse.Namespace) -> Trajectory:
    """Return the trajectory that the options name.

    Raises a ParameterError if there are a waypoint and a trajectory, the file is wrong, or the
    flight ends before its last waypoint.
    """
    position, heading = options.waypoint, options.heading
    if options.trajectory is not None:
        if position is not None or heading is not None:
            raise ParameterError('--trajectory: not with --waypoint or --heading')
        found = Trajectory.read(options.trajectory)
        if found.times[-1] >= options.duration * 1e9:
            raise ParameterError(
                f'{options.trajectory}: the last waypoint counts from {found.times[-1] / 1e9:g} s '
                f'on, but --duration is {options.duration:g} s'
            )
        return found
    x, y, z = POSITION if position is None else position
    angle = HEADING if heading is None else heading
    return Trajectory.to(Waypoint.of(x, y, z, math.radians(angle)))


def failures_of(options: argparse.Namespace, vehicle: Vehicle | None = None) -> RotorFailures:
    """Return the failures that the options name.

    Raises a ParameterError if two are the same, one is after the end of the flight, or the vehicle
    cannot have it.
    """
    for each in options.fail:
        if each.time >= options.duration:
            raise ParameterError(f'--fail {each}: --duration is {options.duration:g} s')
    try:
        failures = RotorFailures(tuple(options.fail), options.announce)
        if vehicle is not None:
            failures.check(vehicle)
    except ParameterError as error:
        raise ParameterError(f'--fail {error}') from None
    return failures


def trajectory_words(options: argparse.Namespace) -> list[str]:
    """Return the options of a waypoint or a trajectory that were given, for a command line."""
    words = []
    if options.waypoint is not None:
        words += ['--waypoint', *map(repr, options.waypoint)]
    if options.heading is not None:
        words += ['--heading', repr(options.heading)]
    if options.trajectory is not None:
        words += ['--trajectory', str(options.trajectory.resolve())]
    return words


def failure_words(failures: RotorFailures) -> list[str]:
    """Return the options that name these failures, for a command line."""
    announce = 'never' if failures.announce is None else repr(failures.announce)
    return [word for each in failures.failures for word in ('--fail', str(each))] + (
        ['--announce', announce] if failures.failures else []
    )


def _delay(text: str) -> float | None:
    if text == 'never':
        return None
    try:
        if 0.0 <= (seconds := float(text)) <= LATEST:
            return seconds
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(
        f'{text!r} is neither a time from 0 to {LATEST:g} s nor never')
