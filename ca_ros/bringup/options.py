"""The options of the bringup script, and the commands that start the nodes with them."""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from ca_ros.allocation import ALLOCATORS, method_class
from ca_ros.arguments import HelpFormatter, finite, full_name, renamed
from ca_ros.bringup.fault_proxy import remaps
from ca_ros.bringup.link_faults import FAULTS
from ca_ros.commands import COMMANDS, NODES
from ca_ros.flight.figures import add_options as add_figure_options
from ca_ros.flight.rotor_failures import add_options as add_failure_options
from ca_ros.flight.rotor_failures import failures_of
from ca_ros.flight.trajectory import add_options as add_trajectory_options
from ca_ros.nodes.executable import DEFAULT_VEHICLE, split, vehicle_arguments
from ca_ros.nodes.parameters import DECLARED, NODE

FOREIGN = {'plant': 'simulator', 'controller': 'controller', 'allocator': 'allocator'}
"""The options that start a program of one's own, and the node whose place it takes."""


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options; the arguments for ROS are in `ros`."""
    parser = argparse.ArgumentParser(
        prog='bringup',
        description='Start controller, allocator and simulator, fly to a waypoint, and report.',
        epilog='ROS arguments after --ros-args go to the three nodes.',
        formatter_class=HelpFormatter,
    )
    parser.add_argument(
        '--method',
        type=_method,
        metavar='METHOD',
        help=f'allocation method: {", ".join(ALLOCATORS)}, or module:Class for your own '
        "(default: the parameter file's)",
    )
    parser.add_argument(
        '--mode',
        choices=NODE['mode'].choices,
        help="follow the clock, or step as fast as possible (default: the parameter file's)",
    )
    parser.add_argument('--duration', type=_positive, default=10.0, help='time of flight [s]')
    add_trajectory_options(parser)
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='folder of the results (default: a new one here, flight_DATE_TIME)',
    )
    add_figure_options(parser)
    parser.add_argument(
        '--bag',
        type=Path,
        metavar='DIR',
        help='record every message into this new folder, as an MCAP bag of rosbag2',
    )
    parser.add_argument(
        '--respawn',
        action='store_true',
        help='restart nodes that end; a new simulator restarts the flight',
    )
    parser.add_argument(
        '--faults',
        type=_faults,
        metavar='PARAMETERS',
        help="put a fault_proxy on every link, for instance 'drop:=0.1 delay:=0.02'",
    )
    for option, node in FOREIGN.items():
        parser.add_argument(
            f'--{option}',
            type=_program,
            metavar='COMMAND',
            help=f'a program of your own in place of the {node}; it gets the same ROS arguments '
            '(docs/plant.md)',
        )
    add_failure_options(parser)
    vehicle = parser.add_mutually_exclusive_group()
    vehicle.add_argument(
        '--vehicle',
        help=f'a shipped vehicle or a parameter file (default: {DEFAULT_VEHICLE}, unless the ROS '
        'arguments have a --params-file)',
    )
    vehicle.add_argument('--params-file', metavar='FILE', help='a parameter file')
    parser.add_argument(
        '--namespace',
        help='namespace of the nodes, for instance /uav1 (default: that of the ROS arguments)',
    )
    try:
        own, ros = split(argv)
    except ValueError as error:
        parser.error(str(error))
    options = parser.parse_args(own)
    options.failures = failures_of(options)
    if options.fail and options.respawn:
        parser.error('--fail: not with --respawn, which restarts the flight with sound rotors')
    if options.trajectory and options.respawn:
        parser.error('--trajectory: not with --respawn, which restarts the flight')
    options.ros = ros
    if options.params_file is not None:
        options.vehicle = options.params_file
    if options.vehicle is None and '--params-file' not in ros:
        options.vehicle = DEFAULT_VEHICLE
    asked = options.namespace
    options.namespace = _absolute(renamed(ros, '__ns', asked or '/'))
    if asked and _absolute(asked) != options.namespace:
        parser.error(f'--namespace {asked}: the ROS arguments have __ns:={options.namespace}')
    return options


def _absolute(namespace: str) -> str:
    return namespace if namespace.startswith('/') else f'/{namespace}'


def _method(text: str) -> str:
    try:
        method_class(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def _positive(text: str) -> float:
    number = finite(text)
    if number <= 0.0:
        raise argparse.ArgumentTypeError(f'{text} is not positive')
    return number


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text}: {error}') from None


def _program(text: str) -> list[str]:
    words = _words(text)
    if not words or shutil.which(words[0]) is None:
        raise argparse.ArgumentTypeError(f'{text!r}: no such program')
    return words


def _faults(text: str) -> list[str]:
    words = _words(text)
    for word in words:
        name, assigned, _ = word.partition(':=')
        if not assigned or name not in FAULTS:
            raise argparse.ArgumentTypeError(f'{word} is not a parameter of fault_proxy')
        if name == 'topics':
            raise argparse.ArgumentTypeError('topics: bringup always uses all four')
    return words


def commands(options: argparse.Namespace) -> dict[str, list[str]]:
    """Return the command line of each node by name.

    Raises
    ------
    ParameterError
        If the vehicle is wrong.
    """
    lines = {}
    for name in NODES:
        full = full_name(options.namespace, name)
        own = ['--ros-args', '--enclave', full, '-r', f'__ns:={options.namespace}']
        if options.faults is not None:
            own += remaps(name)
        vehicle = []
        if options.vehicle:
            vehicle = vehicle_arguments(options.vehicle, full, DECLARED[name])
        chosen = [
            word
            for key, value in options_as_parameters(options).items()
            for word in ('-p', f'{key}:={value}')
        ]
        node = [sys.executable, '-m', COMMANDS[name]]
        if name in (programs := foreign(options)):
            node = programs[name]
            own += ['-r', f'__node:={name}']
        lines[name] = [*node, *own, '--', *vehicle, *options.ros, '--ros-args', *chosen]
    if options.faults is not None:
        own = ['--ros-args', '-r', f'__ns:={options.namespace}']
        own += [word for parameter in options.faults for word in ('-p', parameter)]
        lines['fault_proxy'] = [sys.executable, '-m', COMMANDS['fault_proxy'], *own]
    return lines


def foreign(options: argparse.Namespace) -> dict[str, list[str]]:
    """Return the programs that take the place of nodes, by the name of the node."""
    given = vars(options)
    return {node: given[option] for option, node in FOREIGN.items() if given[option]}


def options_as_parameters(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameters that options of bringup set."""
    chosen = {'mode': options.mode, 'allocation.method': options.method}
    return {name: value for name, value in chosen.items() if value}
