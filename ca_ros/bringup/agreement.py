"""Whether the nodes of a flight agree with the options of `bringup` and with each other."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from ca_ros.commands import NODES
from ca_ros.errors import CaRosError
from ca_ros.nodes.settings import DECLARED
from ca_ros.settings import table
from ca_ros.vehicle.settings import MovingVehicleSettings

VEHICLE = table(MovingVehicleSettings)

REFERENCE_ORDER = ('allocator', 'controller', 'simulator')
"""The others are compared with the first of these nodes that declares a parameter."""


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
    if 'mode' not in (common := combined(parameters)):
        raise DisagreementError('no node declares the parameter mode: one of ours must be there')
    asked = {'mode': common['mode'], **asked}
    for text in not_compared(parameters, asked):
        print(f'bringup: warning: {text}', file=sys.stderr)
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

    The nodes are compared with the first node of `REFERENCE_ORDER` that declares a parameter.  A
    difference is not an error, because model mismatch is a common experiment.

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
            model = next(model for model in REFERENCE_ORDER if name in parameters[model])
            if parameters[node][name] != parameters[model][name]:
                found.setdefault((node, model), []).append(name)
    return '; '.join(
        f'the {node} differs from the {model} in {", ".join(names)}'
        for (node, model), names in found.items()
    )


def combined(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the values of all nodes by name: those of the first node in `REFERENCE_ORDER`."""
    values: dict[str, Any] = {}
    for node in reversed(REFERENCE_ORDER):
        values |= parameters[node]
    return values


def not_compared(
    parameters: Mapping[str, Mapping[str, Any]], asked: Mapping[str, Any]
) -> list[str]:
    """Return which nodes, programs of one's own, lack parameters that `check` compares.

    Parameters
    ----------
    parameters : mapping
        Values by node and name.
    asked : mapping
        The values that the options set, by name.
    """
    found = []
    for node in NODES:
        declared = table(DECLARED[node])
        names = [name for name in (*asked, *VEHICLE) if name in declared]
        lacking = [name for name in names if name not in parameters[node]]
        if not parameters[node]:
            found.append(
                f'the {node} has no parameters: its mode and vehicle cannot be compared'
            )
        elif lacking:
            found.append(
                f'the {node} does not declare {", ".join(lacking)}: these cannot be compared'
            )
    return found
