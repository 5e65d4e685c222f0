"""The parameter files of vehicles.

They are ROS parameter files.  ROS reads them for the nodes, and `read` reads them for Python.
A section has the name of a node, which may have wildcards: ``/**: ros__parameters:`` is for all
nodes, and ``/uav1/allocator: ros__parameters:``, as `ros2 param dump` writes it, is for one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from ca_ros.errors import shortened
from ca_ros.input_files import read_text
from ca_ros.setting_names import renamed
from ca_ros.settings import ParameterError
from ca_ros.vehicle.formats.px4_lines import px4_lines

YAML_MAX = 1_000_000  # greatest size of a file, which takes some seconds to read [bytes]


def read_yaml(text: str) -> Any:
    """Return the content of a YAML text; see `ca_ros.vehicle.plain_yaml.read_yaml`."""
    return deepcopy(_content(text))


@lru_cache
def _content(text: str) -> Any:
    # PyYAML takes a tenth of the time in which this package is imported, and few need it.
    from ca_ros.vehicle import plain_yaml

    return plain_yaml.read_yaml(text)


def read_value(name: str, text: str) -> Any:
    """Return the value in an argument ``NAME:=VALUE``; raise a `ParameterError` that names it."""
    try:
        return read_yaml(text)
    except ParameterError as error:
        raise ParameterError(f'{name}: not a value: {error}') from None


class NoSectionError(ParameterError):
    """A parameter file has no section for a node."""


def config_directory() -> Path:
    """Return the folder of the shipped parameter files.

    This is ``share/ca_ros/config`` in the installation prefix, or ``config`` in the source tree.
    """
    package = Path(__file__).resolve().parent
    for parent in package.parents:
        if (parent / 'package.xml').is_file() and (parent / 'config').is_dir():
            return parent / 'config'
        if (parent / 'share' / 'ca_ros' / 'config').is_dir():
            return parent / 'share' / 'ca_ros' / 'config'
    raise ParameterError(
        f'no shipped parameter files of ca_ros were found from {package}: reinstall the package'
    )


def shipped(folder: str) -> dict[str, Path]:
    """Return the shipped files of a folder by name."""
    return {file.stem: file for file in sorted((config_directory() / folder).glob('*.yaml'))}


shipped_vehicles = partial(shipped, '')
shipped_tilting = partial(shipped, 'tilting')  # vehicles with rotors that tilt
shipped_problems = partial(shipped, 'problems')  # without a vehicle


def find(name: str | Path) -> Path:
    """Return the file of a vehicle or problem: a shipped one's name, or a path to a YAML file."""
    path = Path(name).expanduser()
    if path.exists() and not path.is_dir():
        return path
    vehicles, problems = shipped_vehicles() | shipped_tilting(), shipped_problems()
    if found := (vehicles | problems).get(str(name)):
        return found
    raise ParameterError(
        f'{name}: neither a file nor a shipped vehicle ({", ".join(vehicles)}) nor a shipped '
        f'problem ({", ".join(problems)})'
    )


class ParameterFile(str):
    """The name of a vehicle's parameter file, with its content: `read` need not open it again.

    Raises a ParameterError if there is no such file, or it is not YAML; the message names the
    file.
    """

    path: Path
    content: Any

    def __new__(cls, name: str | Path) -> ParameterFile:
        """Read the file of a vehicle or problem, see `find`."""
        if isinstance(name, ParameterFile):
            return name
        self = super().__new__(cls, name)
        self.path = path = find(name)
        text = read_text(path, YAML_MAX)
        if any(name.startswith('CA_ROTOR') for name, *_ in px4_lines(text)):
            raise ParameterError(
                f'{path}: parameters of PX4: ca_ros px4-parameters from-px4 makes a file of '
                'ca_ros from them'
            )
        try:
            self.content = read_yaml(text)
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None
        return self


def read(vehicle: str | Path, node: str | None = None) -> dict[str, Any]:
    """Return the parameters in the file of a vehicle by name, as they are given there.

    Raises a ParameterError if there is no such file, or it is not a parameter file; the message
    names the file, or a NoSectionError if `node` is given and no section of the file is for it.

    `vehicle`: a shipped vehicle's name, or a path to a YAML file.  `node`: the full name of a
    node, such as ``/uav1/allocator``: read the parameters that ROS would give this node.  Default:
    the allocator, or the only node that the file names.
    """
    file = ParameterFile(vehicle)
    try:
        return parameters_in(file.content, node)
    except ParameterError as error:
        raise type(error)(f'{file.path}: {error}') from None


def is_content(given: Mapping[str, Any]) -> bool:
    """Tell whether a mapping is the content of a parameter file, with sections of nodes."""
    return any(isinstance(each, Mapping) for each in given.values()) and bool(_sections(given))


def parameters_in(content: Any, node: str | None = None) -> dict[str, Any]:
    """Return the parameters in the content of a file by name; see `read`."""
    return renamed(_ros_parameters(content, node))


def _ros_parameters(content: Any, node: str | None) -> dict[str, Any]:
    """Return the parameters that ROS would give a node by name; later sections override."""
    if isinstance(content, Mapping) and 'problem' in content:
        raise ParameterError(
            'a problem without a vehicle, which has no rotors to fly with; allocator, '
            'static_study, attainable and AllocationProblem.load take it'
        )
    sections = _sections(content) if isinstance(content, Mapping) else []
    if not sections or not all(isinstance(section, Mapping) for _, section in sections):
        raise ParameterError(
            "expected a ROS parameter file: '/**:' or the name of a node, and 'ros__parameters:'"
        )

    def given(name: str) -> dict[str, Any]:
        merged: dict[str, Any] = {}
        for pattern, section in sections:
            if matches(pattern, name):
                merged.update(flatten(section))
        return merged

    if node is None:
        names = dict.fromkeys(_example(pattern) for pattern, _ in sections)
        names = dict.fromkeys(name for name in names if name.endswith('/allocator')) or names
        first, *others = (given(name) for name in names)
        if any(other != first for other in others):
            raise ParameterError(
                f'different parameters for {", ".join(names)}: expected those of one vehicle'
            )
        return first
    if not any(matches(pattern, node) for pattern, _ in sections):
        raise NoSectionError(
            f'no section for {node}; there are {", ".join(pattern for pattern, _ in sections)}'
        )
    return given(node)


def _sections(tree: Mapping[Any, Any], name: str = '') -> list[tuple[str, Any]]:
    """Return the sections of a parameter file, each with the pattern of its nodes."""
    found = []
    for key, below in tree.items():
        if key == 'ros__parameters' and name:
            found.append((name, below))
        elif isinstance(below, Mapping):
            found += _sections(below, f'{name}/{str(key).strip("/")}')
    return found


def matches(pattern: str, node: str) -> bool:
    """Return whether a section is for a node: * stands for one part of its name, ** for any."""
    expression = re.escape(pattern).replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(expression, node) is not None


def _example(pattern: str) -> str:
    """Return the name of a node that a section is for, an allocator if possible."""
    name = re.sub(r'/\*\*?$', '/allocator', pattern)
    return name.replace('/**', '').replace('/*', '/vehicle')


def flatten(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return the values of nested mappings by name, such as ``rotors.positions``."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f'{prefix}{key}.'))
        elif isinstance(value, list) and (fault := _fault_of_list(value)):
            # ROS cannot read it, so nothing else may.
            raise ParameterError(f'{prefix}{key}: expected one list of {fault}')
        else:
            flat[f'{prefix}{key}'] = value
    return flat


def _fault_of_list(values: Sequence[Any]) -> str:
    """Return what ROS expects instead of a list, and what it got; empty if it reads the list."""
    if any(isinstance(each, list | dict) for each in values):
        return (
            "numbers or words, such as [0.0, 0.5, 1.0] or ['roll pitch', thrust, yaw], got a list "
            'in a list')
    if len({type(each) for each in values}) > 1:
        return (
            'words, of numbers with a decimal point or of numbers without, such as '
            f'[0.0, 0.5, 1.0], got {shortened(values)}'
        )
    return ''
