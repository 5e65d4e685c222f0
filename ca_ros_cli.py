"""The command ``ca_ros`` and its subcommands, the nodes among them.

This module lies beside the package and imports nothing but the standard library, since setup.py
reads `COMMANDS`, and since the import of the package takes up to a second: Ctrl-C in that second
ends a command without a traceback, as it does later.
"""

from __future__ import annotations  # setup.py reads this module in any Python that pip runs

import argparse
import signal
import sys
import warnings
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module

NODES = ('controller', 'allocator', 'simulator')
"""The nodes of the loop, in the order in which `bringup` ends them: the source of commands first.

`ca_ros.parameter_files.DECLARED` has their parameters.
"""

COMMANDS = {
    'bringup': ('ca_ros.bringup.bringup', 'fly: start all nodes, record a flight, report'),
    'allocator': ('ca_ros.nodes.allocator', 'node: wrench commands to rotor speeds'),
    'controller': ('ca_ros.nodes.controller', 'node: states to wrench commands'),
    'simulator': ('ca_ros.nodes.simulator', 'node: rotor speeds to states'),
    'monitor': ('ca_ros.nodes.monitor', 'node: names failed rotors'),
    'px4_bridge': ('ca_ros.px4.bridge', 'node: between PX4 and the nodes'),
    'viewer': ('ca_ros.nodes.viewer', 'node: markers of the vehicle for RViz and Foxglove'),
    'fault_proxy': ('ca_ros.nodes.fault_proxy', 'node: drops, delays and damages messages'),
    'audit': (
        'ca_ros.studies.sets.audit_command',
        'which axes the rotors can control, what is left after each loss, and what is probably '
        'wrong in the file; the exit code is 1 if the nodes would refuse the vehicle, and 3 if '
        'something is probably wrong'),
    'compare': (
        'ca_ros.studies.sets.compare_command',
        'what changes between two vehicles: ranges, hover margin, what each loss costs'),
    'attainable': ('ca_ros.studies.sets.attainable', 'print and draw the attainable wrenches'),
    'static_study': ('ca_ros.studies.static.study', 'compare methods on drawn wrenches'),
    'dynamic_study': ('ca_ros.studies.dynamic.study', 'compare methods in flight'),
    'explore': (
        'ca_ros.explore',
        'write the explorer, a page for a browser: drag the demand, fail rotors'),
    'firmware': ('ca_ros.firmware.command', 'export the allocator of a vehicle as C99'),
    'fit-thrust': (
        'ca_ros.studies.fit_thrust', 'fit a thrust curve to the CSV file of a test stand'),
    'identify': (
        'ca_ros.studies.identify',
        'identify lag, delay, inertia and thrust of a vehicle from flights'),
    'replay': (
        'ca_ros.studies.replay',
        'what the detector of rotor failures would have named in a recorded flight'),
    'from-urdf': (
        'ca_ros.vehicle.formats.urdf',
        'print a parameter file from a URDF: mass, inertia, and the places of its rotor links'),
    'gazebo-motors': (
        'ca_ros.vehicle.formats.gazebo', "print Gazebo's motor models of a vehicle, for its SDF"),
    'mixer': (
        'ca_ros.vehicle.formats.mixers',
        'print the mixer of a vehicle for Betaflight or ArduPilot'),
    'px4-parameters': (
        'ca_ros.px4.parameters', "convert the geometry of a vehicle from and to PX4's CA_ROTOR*"),
}
"""The module of each command, which has the function main, and what the command does."""

STUDIES = ('matplotlib', 'pandas', 'tqdm')  # the modules of the extra `studies`

ROS = (
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces',
    'rclpy', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'visualization_msgs',
)  # fmt: skip
"""The modules that ROS 2 or the extra `ros` installs."""

HINTS = {
    **dict.fromkeys(STUDIES, "pip install 'ca_ros[studies]'"),
    'distributed': "pip install 'ca_ros[cluster]'",
    'px4_msgs': 'build and source github.com/PX4/px4_msgs of the branch of your PX4 (docs/px4.md)',
    **dict.fromkeys(ROS, "source ROS 2 Jazzy, or pip install 'ca_ros[ros]' (x86-64 Linux)"),
}


def main(argv: Sequence[str] | None = None) -> int | None:
    """Run ``ca_ros [COMMAND [ARGUMENT ...]]``; return the exit code.

    A command gets its arguments as they are, and reports a missing package in one line.
    """
    given = [*sys.argv[1:]] if argv is None else [*argv]
    try:
        if given and given[0] in COMMANDS:
            return _run(*given)
        return _main(given)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def _run(command: str, *arguments: str) -> int | None:
    """Run a command, which reads its arguments from sys.argv; return its exit code."""
    sys.argv = [command, *arguments]
    # Without the place in the code.
    warnings.formatwarning = lambda message, *_: f'{command}: {message}\n'  # type: ignore
    try:
        code: int | None = import_module(COMMANDS[command][0]).main()
    except ModuleNotFoundError as missing:
        package = (missing.name or '').partition('.')[0]
        if package not in HINTS:
            raise
        print(f'{command}: needs {package}: {HINTS[package]}', file=sys.stderr)
        return 1
    return code


def _main(given: list[str]) -> int:
    """Answer what names no command: ``--help``, ``--version``, a misspelt name."""
    parser = argparse.ArgumentParser(
        prog='ca_ros', usage='%(prog)s [--help | --version | COMMAND [ARGUMENT ...]]',
        description='Control allocation of multirotors. Each command has --help.',
        formatter_class=argparse.RawDescriptionHelpFormatter, add_help=False)
    parser.add_argument('-h', '--help', action='store_true', help='commands, vehicles, methods')
    parser.add_argument('--version', action='store_true', help='version, rclpy and engine')
    options, rest = parser.parse_known_args(given)
    if rest:
        near = get_close_matches(rest[0], COMMANDS, 1)
        parser.error(f'no command {rest[0]!r}' + (f'; did you mean {near[0]!r}?' if near else ''))
    # A reader of the output, such as head, may end first.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    from ca_ros import overview

    if options.version:
        print(overview.versions())
    else:
        width = max(map(len, COMMANDS))
        lines = [f'  {name:{width}}  {about}' for name, (_, about) in COMMANDS.items()]
        parser.epilog = '\n'.join(['commands:', *lines, '', overview.text()])
        parser.print_help()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
