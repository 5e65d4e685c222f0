"""A node as an executable: its arguments, its start and its end."""

import argparse
import faulthandler
import gc
import inspect
import json
import re
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from itertools import pairwise
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args, try_shutdown

from ca_ros import arguments, settings
from ca_ros.input_files import check_file, read_text
from ca_ros.nodes.console import ending_signals, never_wait, replace_closed
from ca_ros.nodes.executor import Executor
from ca_ros.nodes.rclpy_internals import RCLError, RCLInvalidROSArgsError
from ca_ros.parameter_files import FileSettings, load_for
from ca_ros.setting_names import check_given, renamed
from ca_ros.settings import ParameterError, Settings, table
from ca_ros.vehicle.files import (
    YAML_MAX,
    NoSectionError,
    find,
    matches,
    read_value,
    read_yaml,
)
from ca_ros.vehicle.vehicle import Vehicle

DEFAULT_VEHICLE = 'hexarotor'

ENDING_MAX = 20.0  # longest time that a node may take to end [s]

Parse = Callable[[str, str, Sequence[str], type[Settings]], list[str]]


def in_one_line(error: Exception) -> str:
    """Return the message of a ROS error without file names and lines."""
    return ' '.join(re.sub(', at [^ ]*:[0-9]+', '', str(error)).split())


def split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a command line into the node's own arguments and those for ROS.

    Raises a ValueError if ROS rejects its part.
    """
    own, ros = arguments.split(argv)
    for option, file in pairwise(ros):
        if option == '--params-file':
            # rcl would wait for a pipe, or read a large file, and no signal would end it.
            check_file(file, YAML_MAX)
    try:
        remove_ros_args(args=['', *argv])
    except (RCLError, RCLInvalidROSArgsError) as error:
        raise ValueError(in_one_line(error)) from None
    return own, ros


def vehicle_of(vehicle: str, node: str) -> Vehicle:
    """Return the vehicle of a node, by full name; the file may have no section for the node."""
    try:
        return Vehicle.load(vehicle, node)
    except NoSectionError:
        return Vehicle.load(vehicle)


def vehicle_arguments(vehicle: str, node: str, declared: type[Settings]) -> list[str]:
    """Return the ROS arguments that give a node, by full name, the parameters of a vehicle.

    A file without a section for the node, such as the dump of another node, gives it the
    parameters that `Vehicle.load` reads.  Raises a ParameterError if the vehicle is wrong.
    """
    try:
        load_for(declared, vehicle, node)
        vehicle_of(vehicle, node)
    except NoSectionError:
        found = load_for(declared, vehicle)
        vehicle_of(vehicle, node)
        return parameter_arguments(settings.flat(found))
    return ['--ros-args', '--params-file', str(find(vehicle).resolve()), '--']


def parameter_arguments(values: Mapping[str, object]) -> list[str]:
    """Return the ROS arguments that give a node the values of parameters."""
    words = (f'{name}:={json.dumps(value)}' for name, value in values.items())
    return ['--ros-args', *(part for word in words for part in ('-p', word)), '--']


def parse(
    prog: str, description: str, argv: Sequence[str], declared: type[Settings],
    file_arguments: Callable[[str, str, type[Settings]], list[str]] = vehicle_arguments,
) -> list[str]:
    """Parse a command line; return the ROS arguments, with those for the parameters in a file."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog='ROS arguments follow --ros-args, for instance: '
        '--ros-args --params-file FILE -r __ns:=/uav1',
    )
    default = f'(default: {DEFAULT_VEHICLE}, unless --params-file gives one)'
    parser.add_argument('--vehicle', metavar='NAME|FILE',
        help=f'a shipped vehicle or a parameter file {default}')
    own, ros = split(argv)
    namespace, name = arguments.renamed(ros, '__ns', '/'), arguments.renamed(ros, '__node', prog)
    node = arguments.full_name(namespace, name)
    # ROS silently ignores a -p whose type differs from that of the value in a parameter file.
    names, known = set(), {**table(FileSettings), **table(declared)}
    for rule in (rule for option, rule in pairwise(ros) if option in ('-p', '--param')):
        name, _, value = rule.partition(':=')
        owner, _, name = name.rpartition(':')
        names.add(name)
        if not owner or matches(f'/{owner.strip("/")}', node):
            given = renamed({name: read_value(name, value)})
            check_given({each: given[each] for each in given if each in known}, known)
    vehicle = parser.parse_args(own).vehicle
    fields = table(declared).items()
    required = {name for name, field in fields if field.default is settings.REQUIRED}
    if vehicle is None:
        if '--params-file' in ros or required <= names:
            return ros
        vehicle = DEFAULT_VEHICLE
        text = f"{prog}: no --vehicle and no --params-file: this is the paper's {vehicle}"
        with suppress(OSError):
            print(text, file=sys.stderr)
    # The user's files come later, so they can override single values.
    return [*file_arguments(vehicle, node, declared), *ros]


def _parameter_files(ros: Sequence[str]) -> str:
    """Return the parameter files in the ROS arguments and their sections, as text."""
    words = []
    for option, file in pairwise(ros):
        if option == '--params-file':
            sections = 'none readable'
            with suppress(ParameterError, TypeError):
                sections = ', '.join(read_yaml(read_text(file, YAML_MAX)))
            words.append(f'{file} (sections: {sections})')
    return ', '.join(words) or 'no file'


def run(
    name: str, node_class: Any, description: str, parse: Parse = parse
) -> int:
    """Run a node until SIGINT, SIGTERM or SIGHUP; return its exit code.

    The signals set a flag and do not shut the context down, so the node can send its last
    messages.  The name is that of executable and node, the description is for ``--help``.  `parse`
    returns the arguments for ROS.  The class of the node has its settings in `declared`.
    """
    replace_closed()
    stop: list[int] = []

    def end(received: int, _: object) -> None:
        stop.append(received)
        # If the middleware blocks (docs/reliability.md), the process still ends, with a traceback.
        if sys.__stderr__ is not None:
            faulthandler.dump_traceback_later(ENDING_MAX, exit=True, file=sys.__stderr__)

    for number in ending_signals():
        signal.signal(number, end)
    if sys.__stderr__ is not None:
        # SIGUSR1 dumps the tracebacks of all threads.
        faulthandler.register(signal.SIGUSR1, file=sys.__stderr__)
    never_wait()
    with ExitStack() as ending:
        # Python resets the handlers at its end; a signal that comes then must not change the code.
        for number in ending_signals():
            ending.callback(signal.signal, number, signal.SIG_IGN)
        ending.callback(try_shutdown)
        ros: list[str] = []
        try:
            ros = parse(name, description, sys.argv[1:], node_class.declared)
            rclpy.init(args=ros, signal_handler_options=SignalHandlerOptions.NO)
            node = node_class(name)
        except (ValueError, ParameterException, RCLError) as error:
            text = in_one_line(error) if isinstance(error, RCLError) else str(error)
            if isinstance(error, settings.MissingParameterError):
                text += f' in {_parameter_files(ros)}'
            print(f'{name}: {text}', file=sys.stderr)
            return 1
        executor = Executor()
        executor.add_node(node)
        # Otherwise the interpreter may destroy the context before the executor.
        ending.callback(executor.shutdown)
        # This sends the last messages of the node, also after an exception.
        ending.callback(node.destroy_node)
        # rclpy logs through this; the first call looks at all modules, for 20 ms: not in flight.
        inspect.stack()
        # Exclude the existing objects from garbage collection.
        gc.collect()
        gc.freeze()
        while not stop:
            executor.spin_once(timeout_sec=0.1)
    return 0
