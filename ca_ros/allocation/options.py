"""The allocator's options from the parameter file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ca_ros.allocation import AllocationProblem, Allocator, make_allocator
from ca_ros.allocation.parameters import prefix
from ca_ros.problem.prioritization import groups_of
from ca_ros.schema import ParameterError
from ca_ros.vehicle.vehicle import Vehicle


def options_from_parameters(parameters: Mapping[str, Any], axes: Sequence[str]) -> dict[str, Any]:
    """Return the keyword options of `make_allocator` for the method that the parameters name.

    Parameters
    ----------
    parameters : mapping
        Checked parameters by name.
    axes : sequence of str
        The axes of the vehicle; other axes in the priorities are ignored.

    Raises
    ------
    ParameterError
        If the priorities do not name each axis once.
    """
    method = str(parameters['allocation.method'])
    begin = prefix(method)
    options = {
        name.removeprefix(begin): value
        for name, value in parameters.items()
        if name.startswith(begin)
    }
    if method == 'exact':
        options['order'] = order_from_parameters(parameters, axes)
    return options


def order_from_parameters(
    parameters: Mapping[str, Any], axes: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """Return the priorities of the axes: groups, the most important first.

    Parameters
    ----------
    parameters : mapping
        Checked parameters by name.
    axes : sequence of str
        The axes of the vehicle; other axes are ignored.

    Raises
    ------
    ParameterError
        If the priorities do not name each axis once.
    """
    try:
        return groups_of(parameters['allocation.exact.order'], axes)
    except ValueError as error:
        raise ParameterError(f'allocation.exact.{error}') from None


def allocator_from_parameters(
    parameters: Mapping[str, Any], vehicle: Vehicle | AllocationProblem
) -> Allocator:
    """Return the allocator with the method and options in the parameters.

    Raises
    ------
    ParameterError
        If an option is wrong; the message has the full name of the parameter.
    """
    method = str(parameters['allocation.method'])
    options = options_from_parameters(parameters, vehicle.axes)
    try:
        return make_allocator(method, vehicle, **options)
    except ParameterError:
        raise
    except ValueError as error:
        named = any(str(error).startswith(f'{option}:') for option in options)
        raise ParameterError(f'{prefix(method)}{error}' if named else str(error)) from None
