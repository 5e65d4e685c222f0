"""The options of the bringup script, the plan of a flight, and the commands of its nodes."""

import argparse
import json
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ca_ros.allocation import ALLOCATORS, method_class
from ca_ros.arguments import HelpFormatter, full_name, positive, renamed, shown
from ca_ros.bringup.flight_options import add_options, failures_of, trajectory_of
from ca_ros.control.trajectory import Trajectory
from ca_ros.figures import WIDTHS
from ca_ros.figures import add_options as add_figure_options
from ca_ros.nodes.executable import DEFAULT_VEHICLE, split, vehicle_arguments, vehicle_of
from ca_ros.nodes.fault_proxy import remaps
from ca_ros.nodes.link_faults import FaultSettings
from ca_ros.nodes.topics import MARKERS
from ca_ros.parameter_files import DECLARED, MonitorSettings, NodeSettings, ViewerSettings
from ca_ros.settings import ParameterError, table
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.files import NoSectionError, ParameterFile, read
from ca_ros_cli import HINTS, NODES

POSITION_TOLERANCE = 0.02  # greatest distance from the waypoint at the end of a flight [m]

FAILURES = 'simulator.failures'
LAG = 'detector.motor_time_constant'

RUN = sys.executable, '-m', 'ca_ros_cli'
"""Runs a command of the package, whose name and arguments follow."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is flown, with which nodes, and what is written.

    The duration is in s.  `tolerance` is the greatest distance from the waypoint at the end [m].
    `vehicle` is a shipped one or a file, or None if `ros`, the ROS arguments of all nodes, names a
    file.  `parameters` are those that options set.  A program of `replacements` takes the place of
    a node.  With `detect` the monitor flies along, with `view` the viewer.  `faults` are those of
    the fault proxy, ``NAME:=VALUE``, or None without it.  `out` and `bag` are folders; None: a new
    one, no bag.  Figures have formats and a width [mm].
    """

    trajectory: Trajectory
    failures: RotorFailures = field(default_factory=RotorFailures)
    duration: float = 10.0
    tolerance: float = POSITION_TOLERANCE
    vehicle: str | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    namespace: str = '/'
    replacements: Mapping[str, Sequence[str]] = field(default_factory=dict)
    faults: Sequence[str] | None = None
    respawn: bool = False
    detect: bool = False
    view: bool = False
    ros: Sequence[str] = ()
    out: Path | None = None
    bag: Path | None = None
    figures: Sequence[str] = ('png',)
    figure_width: float = WIDTHS['page']

    def commands(self) -> dict[str, list[str]]:
        """Return the command line of each node by name; raise a ParameterError if it is wrong."""
        if self.view and not MARKERS:
            package = 'visualization_msgs'
            raise ParameterError(f'--view: needs {package}: {HINTS[package]}')
        chosen = _parameters(f'{name}:={value}' for name, value in self.parameters.items())
        file = None if self.vehicle is None else ParameterFile(self.vehicle)
        others = any(word == '--params-file' or 'rotors.' in word for word in self.ros)
        if file is not None and not others:
            # The flight checks it again, with the parameters that the nodes have.
            flown = vehicle_of(file, full_name(self.namespace, 'simulator'))
            try:
                self.failures.check(flown)
            except ParameterError as error:
                raise ParameterError(f'--fail {error}') from None
        space = ['-r', f'__ns:={self.namespace}']
        lines = {}
        for name in (*NODES, *['monitor'] * self.detect, *['viewer'] * self.view):
            full = full_name(self.namespace, name)
            own = ['--ros-args', '--enclave', full, *space]
            if self.faults is not None:
                own += remaps(name)
            node: Sequence[str] = [*RUN, name]
            if name in self.replacements:
                node = self.replacements[name]
                own += ['-r', f'__node:={name}']
            kind = {'monitor': MonitorSettings, 'viewer': ViewerSettings, **DECLARED}[name]
            if name == 'monitor' and file is not None and self._follows_at_once(file):
                own += _parameters([f'{LAG}:=0.0'])
            vehicle = [] if file is None else vehicle_arguments(file, full, kind)
            lines[name] = [*node, *own, '--', *vehicle, *self.ros, '--ros-args', *chosen]
            if self.detect and 'await_health' in table(kind):
                lines[name] += ['-p', 'await_health:=true']
            if self.failures.failures and name == 'simulator':
                lines[name] += _parameters([f'{FAILURES}:={json.dumps(self.failures.words)}'])
        if self.faults is not None:
            own = ['--ros-args', *space, *_parameters(self.faults)]
            lines['fault_proxy'] = [*RUN, 'fault_proxy', *own]
        return lines

    def _follows_at_once(self, file: str) -> bool:
        """Return whether the simulated motors are known to have no lag, and no lag is given."""
        if 'simulator' in self.replacements or any(
                word == '--params-file' or 'motor_time_constant' in word for word in self.ros):
            return False
        with suppress(NoSectionError):
            simulator, monitor = (
                read(file, full_name(self.namespace, name)) for name in ('simulator', 'monitor'))
            return not (simulator.get('simulator.motor_time_constant') or LAG in monitor)
        return False


def _parameters(rules: Iterable[str]) -> list[str]:
    """Return the ROS arguments of parameters, ``NAME:=VALUE``."""
    return [word for rule in rules for word in ('-p', rule)]


REPLACEMENTS = {'plant': 'simulator', 'controller': 'controller', 'allocator': 'allocator'}
"""The options that start a program of one's own, and the node whose place it takes."""

SAME = (
    *('detect', 'view', 'duration', 'tolerance', 'faults', 'respawn', 'out', 'bag', 'figures'),
    'figure_width',
)
"""The options that the plan has under the same name."""


def parse(argv: Sequence[str]) -> Plan:
    """Return the plan of the flight that a command line asks for.

    Raises a ParameterError if the waypoints or the failures are wrong.
    """
    parser = _parser()
    try:
        own, ros = split(argv)
    except ValueError as error:
        parser.error(str(error))
    options = parser.parse_args(own)
    if options.fail and options.respawn:
        parser.error('--fail: not with --respawn, which restarts the flight with sound rotors')
    if options.trajectory and options.respawn:
        parser.error('--trajectory: not with --respawn, which restarts the flight')
    file = options.vehicle
    if file is None and '--params-file' not in ros:
        file = DEFAULT_VEHICLE
    asked = options.namespace
    namespace = _absolute(renamed(ros, '__ns', asked or '/'))
    if asked and _absolute(asked) != namespace:
        parser.error(f'--namespace {asked}: the ROS arguments have __ns:={namespace}')
    given = vars(options)
    chosen = {'mode': options.mode, 'allocation.method': options.method}
    return Plan(
        trajectory=trajectory_of(options), failures=failures_of(options), vehicle=file,
        parameters={name: value for name, value in chosen.items() if value}, namespace=namespace,
        replacements={node: given[name] for name, node in REPLACEMENTS.items() if given[name]},
        ros=ros, **{name: given[name] for name in SAME},
    )


def _parser() -> argparse.ArgumentParser:
    about = 'Start controller, allocator and simulator, fly to a waypoint, and report.'
    epilog = 'ROS arguments after --ros-args go to the three nodes.'
    parser = argparse.ArgumentParser('bringup', description=about, epilog=epilog)
    parser.formatter_class = HelpFormatter
    add = parser.add_argument
    methods = f'{", ".join(ALLOCATORS)}, or module:Class for your own'
    add('--method', type=shown(_method), metavar='METHOD',
        help=f"allocation method: {methods} (default: the parameter file's)")
    add('--mode', choices=table(NodeSettings)['mode'].choices,
        help="follow the clock, or step as fast as possible (default: the parameter file's)")
    add('--duration', type=positive(float), default=10.0, help='time of flight [s]')
    add('--tolerance', type=positive(float), metavar='METRES', default=POSITION_TOLERANCE,
        help='greatest distance from the waypoint at the end; 0.25 degrees of heading a cm')
    add_options(parser)
    add('--view', action='store_true',
        help='also start the viewer: markers for RViz and Foxglove on viewer/markers')
    add('--out', type=Path, metavar='DIR',
        help='folder of the results (default: a new one here, flight_DATE_TIME)')
    add_figure_options(parser)
    add('--bag', type=Path, metavar='DIR',
        help='record every message into this new folder, as an MCAP bag of rosbag2')
    add('--respawn', action='store_true',
        help='restart nodes that end; a new simulator restarts the flight')
    add('--faults', type=shown(_faults), metavar='PARAMETERS',
        help="put a fault_proxy on every link, for instance 'drop:=0.1 delay:=0.02'")
    same = 'it gets the same ROS arguments (docs/plant.md)'
    for option, node in REPLACEMENTS.items():
        add(f'--{option}', type=shown(_program), metavar='COMMAND',
            help=f'a program of your own in place of the {node}; {same}')
    add = parser.add_mutually_exclusive_group().add_argument
    unless = f'(default: {DEFAULT_VEHICLE}, unless the ROS arguments have a --params-file)'
    add('--vehicle', help=f'a shipped vehicle or a parameter file {unless}')
    add('--params-file', metavar='FILE', dest='vehicle', help='a parameter file')
    parser.add_argument('--namespace',
        help='namespace of the nodes, for instance /uav1 (default: that of the ROS arguments)')
    return parser


def _absolute(namespace: str) -> str:
    return namespace if namespace.startswith('/') else f'/{namespace}'


def _method(text: str) -> str:
    method_class(text)
    return text


def _program(text: str) -> list[str]:
    words = shlex.split(text)
    if not words or shutil.which(words[0]) is None:
        raise ValueError(f'{text!r}: no such program')
    return words


def _faults(text: str) -> list[str]:
    words = shlex.split(text)
    for word in words:
        name, assigned, _ = word.partition(':=')
        if not assigned or name not in table(FaultSettings):
            raise ValueError(f'{word} is not a parameter of fault_proxy')
        if name == 'topics':
            raise ValueError('topics: bringup always uses all')
    return words
