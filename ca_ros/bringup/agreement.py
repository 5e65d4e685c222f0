"""Whether the nodes of a flight agree with the options of `bringup` and with each other."""

import sys
from collections.abc import Iterator, Mapping
from typing import Any

from ca_ros.errors import CaRosError
from ca_ros.parameter_files import DECLARED
from ca_ros.settings import table
from ca_ros.vehicle.settings import MovingVehicleSettings
from ca_ros_cli import NODES

VEHICLE = table(MovingVehicleSettings)

REFERENCE_ORDER = ('allocator', 'controller', 'simulator')  # the first that has it is the standard
Parameters = Mapping[str, Mapping[str, Any]]  # values by node and name


def check(parameters: Parameters, asked: Mapping[str, Any]) -> None:
    """Refuse nodes that contradict the options `asked` or each other's mode, by an error.

    What cannot be compared, and two vehicles, are warnings: model mismatch is a common experiment.
    """
    if 'mode' not in (common := combined(parameters)):
        raise CaRosError('no node declares the parameter mode: one of ours must be there')
    asked = {'mode': common['mode'], **asked}
    for text in not_compared(parameters, asked):
        print(f'bringup: warning: {text}', file=sys.stderr)
    for node in NODES:
        for name, value in asked.items():
            if (own := parameters[node].get(name, value)) != value:
                raise CaRosError(
                    f'{name} of the {node} is {own}, not {value}: see the parameter files '
                    'and the ROS arguments'
                )
    if found := differences(parameters):
        print(f'bringup: warning: the nodes have different vehicles: {found}', file=sys.stderr)


def differences(parameters: Parameters) -> str:
    """Return which nodes differ in which parameters of the vehicle, if any do.

    They are compared with the first node of `REFERENCE_ORDER` that declares a parameter.
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


def combined(parameters: Parameters) -> dict[str, Any]:
    """Return the values of all nodes by name: those of the first node in `REFERENCE_ORDER`."""
    values: dict[str, Any] = {}
    for node in reversed(REFERENCE_ORDER):
        values |= parameters[node]
    return values


def not_compared(parameters: Parameters, asked: Mapping[str, Any]) -> Iterator[str]:
    """Yield which nodes, programs of one's own, lack parameters that `check` compares."""
    for node in NODES:
        declared, own = table(DECLARED[node]), parameters[node]
        names = [name for name in (*asked, *VEHICLE) if name in declared and name not in own]
        if not own:
            yield f'the {node} has no parameters: its mode and vehicle cannot be compared'
        elif names:
            yield f'the {node} does not declare {", ".join(names)}: these cannot be compared'
