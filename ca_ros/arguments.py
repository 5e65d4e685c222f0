"""Command lines with arguments of ca_ros and of ROS."""

import argparse
import math
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ca_ros.errors import message
from ca_ros.settings import Numbers, ParameterError
from ca_ros_cli import COMMANDS


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Adds the default of each option to its help, unless it is None or empty."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default is None or action.default in ([], (), {}):
            return action.help
        return super()._get_help_string(action)


def command(
    name: str,
    add_options: Callable[[argparse.ArgumentParser], None],
    run: Callable[[argparse.Namespace], int | None],
) -> int:
    """Parse the arguments of ``ca_ros NAME`` and run it; return the exit code, 0 without one.

    Errors of files and of values are shown in one line.
    """
    # A reader of the output, such as head, may end first.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    about = COMMANDS[name][1]
    parser = argparse.ArgumentParser(
        prog=f'ca_ros {name}', description=f'{about[0].upper()}{about[1:]}.')
    add_options(parser)
    try:
        return run(parser.parse_args()) or 0
    except (OSError, ValueError) as error:
        sys.stdout.flush()
        print(f'ca_ros {name}: {message(error)}', file=sys.stderr)
        return 1


def shown(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return an argparse type that reads a text, and shows the message of a ValueError."""

    def reader(text: str) -> Any:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return reader


def finite(text: str) -> float:
    """Return a finite number; an argparse type."""
    number = float(text)
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f'{text} is not a finite number')
    return number


def positive(kind: type[int] | type[float]) -> Callable[[str], Any]:
    """Return an argparse type: a positive, finite number; an int also as 1e8."""

    def read(text: str) -> Any:
        with suppress(ValueError):
            number = float(text)
            if 0 < number < float('inf') and kind(number) == number:
                return kind(number)
        what = 'positive whole number' if kind is int else 'positive number'
        raise argparse.ArgumentTypeError(f'{text!r} is not a {what}')

    return read


def natural(text: str) -> int:
    """Return a whole number from 0 on; an argparse type."""
    if text.isdecimal():
        return int(text)
    raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 on')


def amount(text: str) -> float:
    """Return a finite number from 0 on; an argparse type."""
    number = finite(text)
    if number < 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number from 0 on')
    return number


def named(known: Iterable[str]) -> Callable[[str], tuple[str, ...]]:
    """Return an argparse type: some of the known names, separated by commas, each once."""

    def read(text: str) -> tuple[str, ...]:
        names = dict.fromkeys(word.strip() for word in text.split(','))
        if strange := names.keys() - {*known}:
            raise argparse.ArgumentTypeError(
                f'{", ".join(sorted(strange))!r}: expected {", ".join(known)}')
        return tuple(names)

    return read


def add_order(parser: argparse.ArgumentParser, about: str) -> None:
    """Add the option for the order of the motors of an autopilot; see `rotor_rows`."""
    parser.add_argument('--order', type=_numbers, default=[], metavar='A,B,..', help=about)


def _numbers(text: str) -> list[int]:
    """Return the numbers in a text, -1 for what is none."""
    return [int(word) if word.strip().isdecimal() else -1 for word in text.split(',')]


def rotor_rows(order: Numbers, n: int, name: str = '--order') -> list[int]:
    """Return for each motor the rotor that it is, from 0.

    Raises a ParameterError with the name of the option if there is not each of the rotors 1 to n
    once.

    `order`: the rotors, from 1; nothing, or 0 alone, is the order of the vehicle.
    """
    given = np.ravel(np.asarray(order, dtype=float)) - 1.0
    rows = given.tolist() if given.size and given.tolist() != [-1.0] else [*range(n)]
    if sorted(rows) != list(range(n)):
        raise ParameterError(f'{name}: expected each of the rotors 1 to {n} once')
    return [int(row) for row in rows]


def add_rotor_numbers(parser: argparse.ArgumentParser, coefficient: str) -> None:
    """Add the options for the numbers of rotors that a geometry does not have."""
    parser.add_argument('--speed-min', type=finite, required=True, help='[rad/s]')
    parser.add_argument('--speed-max', type=finite, required=True, help='[rad/s]')
    parser.add_argument('--thrust-coefficient', type=finite, required=True, help=coefficient)


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what commands and motion of a recorded flight mean."""
    parser.add_argument(
        '--throttle', choices=['linear', 'quadratic', 'curve'], help='commands are throttles from '
        '0 to 1; the thrust is linear in them, or quadratic, or as in rotors.thrust_curve')
    parser.add_argument(
        '--frame', choices=['flu', 'frd'], default='flu', help='of gyro and accelerometer: '
        'forward-left-up or forward-right-down')


def split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a command line into its own arguments and those of ROS (--ros-args to the next --)."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in argv:
        inside = inside or argument == '--ros-args'
        (ros if inside else own).append(argument)
        inside = inside and argument != '--'
    return own, ros


def renamed(ros: Sequence[str], name: str, default: str) -> str:
    """Return the value of ``__ns`` or ``__node`` in ROS arguments: that of the first such rule."""
    rule = f'{name}:='
    return next((word[len(rule) :] for word in ros if word.startswith(rule)), default)


def full_name(namespace: str, node: str) -> str:
    """Return the name of a node with its namespace, such as ``/uav1/allocator``."""
    return f'/{namespace.strip("/")}/{node}'.replace('//', '/')
