"""The parameters of allocation: the method, and the options that each method declares."""

from __future__ import annotations

from ca_ros.allocation import ALLOCATORS, method_class
from ca_ros.schema import Parameter, ParameterError, names_class

ALLOCATION = {
    'allocation.method': Parameter(
        'allocation method',
        str,
        default='exact',
        choices=tuple(ALLOCATORS),
        or_class=True,
        mutable=True,
    ),
    **{
        f'allocation.{method}.{option}': parameter
        for method, kind in ALLOCATORS.items()
        for option, parameter in kind.parameters.items()
    },
}

PRIORITIES = {
    name: ALLOCATION[name] for name in ('allocation.exact.order', 'allocation.exact.reversal')
}
"""The parameters of ``exact`` that the controller also uses."""


def prefix(method: str) -> str:
    """Return how the parameters of a method begin: ``allocation.NAME.`` with its last name."""
    return f'allocation.{method.rpartition(":")[2]}.'


def own_parameters(method: object) -> dict[str, Parameter]:
    """Return the parameters that ``module:Class`` declares, by name; none for other methods.

    Raises
    ------
    ParameterError
        If there is no such class.
    """
    if not (isinstance(method, str) and names_class(method)):
        return {}
    try:
        kind = method_class(method)
    except ValueError as error:
        raise ParameterError(f'allocation.method: {error}') from None
    return {prefix(method) + option: value for option, value in kind.parameters.items()}
