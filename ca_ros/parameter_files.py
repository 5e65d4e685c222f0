"""The parameter files of vehicles, shipped ones and others.

They are ROS parameter files (``/**: ros__parameters:``), which ROS reads for the nodes and `load`
reads for everyone else.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ca_ros.parameters import ParameterError, Value, complete

DEPTH_MAX = 20
"""How deep lists and mappings may be nested in a YAML text."""


class PlainLoader(yaml.SafeLoader):
    """Reads words, numbers, booleans, lists and mappings; every fault is a `yaml.YAMLError`.

    As in ROS, aliases are refused, and dates are words.
    """

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node, unless it is an alias or nested too deep."""
        if self.check_event(yaml.AliasEvent):
            fault = 'aliases (*name) are not supported'
        elif self.depth == DEPTH_MAX:
            fault = f'nested more than {DEPTH_MAX} levels deep'
        else:
            self.depth += 1
            node = super().compose_node(parent, index)
            self.depth -= 1
            return node
        raise yaml.MarkedYAMLError(problem=fault, problem_mark=self.peek_event().start_mark)  # type: ignore[no-untyped-call]

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct a node; errors of Python's own conversions get a place in the text."""
        try:
            return super().construct_object(node, deep)
        except (LookupError, ValueError):
            word = node.value if len(node.value) <= 20 else f'{node.value[:20]}...'
            raise yaml.MarkedYAMLError(
                problem=f'{word!r} is not of the type {node.tag.rpartition(":")[2]}',
                problem_mark=node.start_mark,
            ) from None


PLAIN = ('str', 'int', 'float', 'bool', 'null', 'seq', 'map')
PlainLoader.yaml_constructors = {
    tag: constructor
    for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
    if tag is None or tag.rpartition(':')[2] in PLAIN
}
PlainLoader.yaml_implicit_resolvers = {
    first: [pair for pair in pairs if pair[0] != 'tag:yaml.org,2002:timestamp']
    for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_yaml(text: str) -> Any:
    """Return the content of a YAML text that comes from a user.

    Raises
    ------
    ParameterError
        In one line, if it is not YAML, or not plain: see `PlainLoader`.
    """
    try:
        return yaml.load(text, PlainLoader)
    except yaml.YAMLError as error:
        said = str(error).replace(' in "<unicode string>"', '')
        raise ParameterError(f'not readable YAML: {" ".join(said.split())}') from None


def read_value(name: str, text: str) -> Any:
    """Return the value in an argument ``NAME:=VALUE``; raise a `ParameterError` that names it."""
    try:
        return read_yaml(text)
    except ParameterError as error:
        raise ParameterError(f'{name}: not a value: {error}') from None


def config_directory() -> Path:
    """Return the folder of the shipped parameter files.

    It is ``share/ca_ros/config`` of the prefix the package is installed in, or ``config`` of the
    source tree.
    """
    package = Path(__file__).resolve().parent
    for parent in package.parents:
        if (parent / 'package.xml').is_file() and (parent / 'config').is_dir():
            return parent / 'config'
        if (parent / 'share' / 'ca_ros' / 'config').is_dir():
            return parent / 'share' / 'ca_ros' / 'config'
    raise ParameterError(
        f'the shipped parameter files of ca_ros are not beside {package}: reinstall the package'
    )


def find(vehicle: str | Path) -> Path:
    """Return the parameter file of a vehicle: a shipped one's name, or a path to a YAML file."""
    path = Path(vehicle).expanduser()
    if path.is_file():
        return path
    shipped = {file.stem: file for file in sorted(config_directory().glob('*.yaml'))}
    if str(vehicle) in shipped:
        return shipped[str(vehicle)]
    raise ParameterError(f'{vehicle}: neither a file nor a shipped vehicle ({", ".join(shipped)})')


def load(vehicle: str | Path) -> dict[str, Value]:
    """Read the parameter file of a vehicle.

    Parameters
    ----------
    vehicle : str or path
        A shipped vehicle's name, or a path to a YAML file.

    Returns
    -------
    dict
        A value for each name in `PARAMETERS`.

    Raises
    ------
    ParameterError
        If there is no such file, or it is wrong; the message names the file, the key and the
        fault.
    """
    path = find(vehicle)
    try:
        content = read_yaml(path.read_text(encoding='utf-8'))
        return complete(_flatten(_ros_parameters(content)))
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: not readable YAML: {error}') from None
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None


def overrides(path: str | Path, node: str) -> dict[str, Any]:
    """Return what a ROS parameter file has for a node, by name, unchecked; it may be little."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(
            f'{path}: not a readable YAML file: {" ".join(str(error).split())}'
        ) from None
    found: dict[str, Any] = {}
    for key in ('/**', node, f'/{node}'):
        section = content.get(key) if isinstance(content, Mapping) else None
        if isinstance(section, Mapping) and isinstance(section.get('ros__parameters'), Mapping):
            found.update(_flatten(section['ros__parameters']))
    return found


def _ros_parameters(content: Any) -> Mapping[str, Any]:
    if isinstance(content, Mapping) and isinstance(content.get('/**'), Mapping):
        parameters = content['/**'].get('ros__parameters')
        if isinstance(parameters, Mapping):
            return parameters
    raise ParameterError(
        "expected a ROS parameter file that begins with '/**:' and 'ros__parameters:'"
    )


def _flatten(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
