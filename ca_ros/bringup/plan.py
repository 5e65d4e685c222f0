"""The plan of a flight, and the commands that start the nodes for it."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ca_ros.arguments import full_name
from ca_ros.control.trajectory import Trajectory
from ca_ros.figures import WIDTHS
from ca_ros.nodes.executable import vehicle_arguments, vehicle_of
from ca_ros.nodes.fault_proxy import remaps
from ca_ros.nodes.topics import MARKERS
from ca_ros.parameter_files import DECLARED, MonitorSettings, ViewerSettings
from ca_ros.settings import ParameterError, table
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.files import ParameterFile
from ca_ros_cli import HINTS, NODES

POSITION_TOLERANCE = 0.02  # greatest distance from the waypoint at the end of a flight [m]

FAILURES = 'simulator.failures'

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
            try:
                self.failures.check(vehicle_of(file, full_name(self.namespace, 'simulator')))
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


def _parameters(rules: Iterable[str]) -> list[str]:
    """Return the ROS arguments of parameters, ``NAME:=VALUE``."""
    return [word for rule in rules for word in ('-p', rule)]
