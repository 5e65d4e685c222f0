"""The plan of a flight, and the commands that start the nodes for it."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ca_ros.arguments import full_name
from ca_ros.bringup.fault_proxy import remaps
from ca_ros.commands import COMMANDS, NODES
from ca_ros.figures import WIDTHS
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.flight.trajectory import Trajectory
from ca_ros.nodes.executable import vehicle_arguments
from ca_ros.nodes.settings import DECLARED, MonitorSettings
from ca_ros.vehicle.files import ParameterFile


@dataclass(frozen=True, eq=False)
class Plan:
    """What is flown, with which nodes, and what is written.

    Attributes
    ----------
    duration : float
        Time of flight [s].
    vehicle : str or None
        A shipped vehicle or a parameter file; None if `ros` names a file.
    parameters : mapping of str to str
        The parameters that options set, by name.
    replacements : mapping of str to sequence of str
        The programs that take the place of nodes, by the name of the node.
    detect : bool
        Whether the monitor flies along.
    faults : sequence of str or None
        The parameters of the fault proxy, ``NAME:=VALUE``; None without it.
    ros : sequence of str
        The ROS arguments of all nodes.
    out, bag : Path or None
        Folders of the results and of the bag; None: a new one, no bag.
    figures, figure_width : sequence of str, float
        File formats, width [mm].
    """

    trajectory: Trajectory
    failures: RotorFailures = field(default_factory=RotorFailures)
    duration: float = 10.0
    vehicle: str | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    namespace: str = '/'
    replacements: Mapping[str, Sequence[str]] = field(default_factory=dict)
    faults: Sequence[str] | None = None
    respawn: bool = False
    detect: bool = False
    ros: Sequence[str] = ()
    out: Path | None = None
    bag: Path | None = None
    figures: Sequence[str] = ('png',)
    figure_width: float = WIDTHS['page']

    def commands(self) -> dict[str, list[str]]:
        """Return the command line of each node by name.

        Raises
        ------
        ParameterError
            If the vehicle is wrong.
        """
        chosen = [
            word for name, value in self.parameters.items() for word in ('-p', f'{name}:={value}')
        ]
        file = None if self.vehicle is None else ParameterFile(self.vehicle)
        lines = {}
        for name in NODES:
            full = full_name(self.namespace, name)
            own = ['--ros-args', '--enclave', full, '-r', f'__ns:={self.namespace}']
            if self.faults is not None:
                own += remaps(name)
            node: Sequence[str] = [sys.executable, '-m', COMMANDS[name]]
            if name in self.replacements:
                node = self.replacements[name]
                own += ['-r', f'__node:={name}']
            vehicle = [] if file is None else vehicle_arguments(file, full, DECLARED[name])
            lines[name] = [*node, *own, '--', *vehicle, *self.ros, '--ros-args', *chosen]
        if self.detect:
            for name in ('allocator', 'controller'):
                lines[name] += ['-p', 'await_health:=true']
            full = full_name(self.namespace, 'monitor')
            own = ['--ros-args', '--enclave', full, '-r', f'__ns:={self.namespace}']
            vehicle = [] if file is None else vehicle_arguments(file, full, MonitorSettings)
            node = [sys.executable, '-m', COMMANDS['monitor'], *own, '--', *vehicle, *self.ros]
            lines['monitor'] = [*node, '--ros-args', *chosen]
        if self.faults is not None:
            own = ['--ros-args', '-r', f'__ns:={self.namespace}']
            own += [word for parameter in self.faults for word in ('-p', parameter)]
            lines['fault_proxy'] = [sys.executable, '-m', COMMANDS['fault_proxy'], *own]
        return lines
