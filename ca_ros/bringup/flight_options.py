"""The options of a command line that say what is flown: waypoints and rotor failures."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from ca_ros.arguments import finite
from ca_ros.flight.rotor_failures import ANNOUNCE, LATEST, RotorFailure, RotorFailures
from ca_ros.flight.trajectory import COLUMNS, Trajectory
from ca_ros.flight.waypoint import Waypoint
from ca_ros.settings import ParameterError

POSITION, HEADING = (1.0, 1.0, 1.0), 45.0
"""The paper's waypoint [m, degrees]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the waypoint or the trajectory, and for rotor failures."""
    parser.add_argument(
        '--waypoint',
        type=finite,
        nargs=3,
        metavar=('X', 'Y', 'Z'),
        help=f'position to fly to [m] (default: {" ".join(f"{x:g}" for x in POSITION)})',
    )
    parser.add_argument(
        '--heading',
        type=finite,
        help=f'heading to turn to [degrees] (default: {HEADING:g})',
    )
    parser.add_argument(
        '--trajectory',
        type=Path,
        metavar='FILE',
        help=f'fly to one waypoint after the other: a CSV file with {", ".join(COLUMNS)}, in s, m '
        'and rad; each becomes active at its time',
    )
    parser.add_argument(
        '--fail',
        type=_failure,
        action='append',
        default=[],
        metavar='ROTOR@TIME[=HEALTH]',
        help='break a rotor (1 is the first) at a time of the flight [s], to this health '
        '(0: lost); may be repeated',
    )
    parser.add_argument(
        '--announce',
        type=_delay,
        default=ANNOUNCE,
        metavar='SECONDS',
        help='time from a failure to its announcement to allocator and controller, or never',
    )
    parser.add_argument(
        '--detect',
        action='store_true',
        help='detect rotor failures from the motion; with --announce never nobody else names them',
    )


def trajectory_of(options: argparse.Namespace) -> Trajectory:
    """Return the trajectory that the options name.

    Raises
    ------
    ParameterError
        If there are a waypoint and a trajectory, the file is wrong, or the flight ends before its
        last waypoint.
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


def failures_of(options: argparse.Namespace) -> RotorFailures:
    """Return the failures that the options name.

    Raises
    ------
    ParameterError
        If a rotor fails twice at the same time.
    """
    return RotorFailures(tuple(options.fail), options.announce)


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
    words = []
    for each in failures.failures:
        words += ['--fail', f'{each.rotor}@{each.time!r}={each.health!r}']
    if not words:
        return []
    announce = 'never' if failures.announce is None else repr(failures.announce)
    return [*words, '--announce', announce]


def _failure(text: str) -> RotorFailure:
    try:
        return RotorFailure.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _delay(text: str) -> float | None:
    if text == 'never':
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds <= LATEST:
        raise argparse.ArgumentTypeError(
            f'{text!r} is neither a time from 0 to {LATEST:g} s nor never'
        )
    return seconds
