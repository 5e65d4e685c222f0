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
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        return complete(_flatten(_ros_parameters(content)))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(
            f'{path}: not a readable YAML file: {" ".join(str(error).split())}'
        ) from None
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
