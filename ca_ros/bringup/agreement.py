"""Whether the nodes of a flight agree with the options of `bringup` and with each other."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from ca_ros.commands import NODES
from ca_ros.errors import CaRosError
from ca_ros.vehicle.parameters import VEHICLE


class DisagreementError(CaRosError):
    """A node has another parameter than the options or the other nodes."""


def check(parameters: Mapping[str, Mapping[str, Any]], asked: Mapping[str, Any]) -> None:
    """Refuse nodes that contradict the options or each other's mode; warn of two vehicles.

    Parameters
    ----------
    parameters : mapping
        Values by node and name.
    asked : mapping
        The values that the options set, by name.

    Raises
    ------
    DisagreementError
        If a node has another value.
    """
    asked = {'mode': parameters['allocator']['mode'], **asked}
    for node in NODES:
        for name, value in asked.items():
            if (own := parameters[node].get(name, value)) != value:
                raise DisagreementError(
                    f'{name} of the {node} is {own}, not {value}: see the parameter files '
                    'and the ROS arguments'
                )
    if found := differences(parameters):
        print(f'bringup: warning: the nodes have different vehicles: {found}', file=sys.stderr)


def differences(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Return which nodes differ in which parameters of the vehicle.

    The nodes are compared with the allocator, or with the controller in what the allocator does
    not declare.  A difference is not an error, because model mismatch is a common experiment.

    Parameters
    ----------
    parameters : mapping
        Values by node and name.

    Returns
    -------
    str
        Empty if there are no differences.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for node in NODES:
        for name in (name for name in VEHICLE if name in parameters[node]):
            model = 'allocator' if name in parameters['allocator'] else 'controller'
            if parameters[node][name] != parameters[model][name]:
                found.setdefault((node, model), []).append(name)
    return '; '.join(
        f'the {node} differs from the {model} in {", ".join(names)}'
        for (node, model), names in found.items()
    )
