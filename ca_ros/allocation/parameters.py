"""The parameters of allocation: the method, and the options that each method declares."""

from __future__ import annotations

from ca_ros.allocation import ALLOCATORS
from ca_ros.schema import Parameter

ALLOCATION = {
    'allocation.method': Parameter(
        'allocation method', str, default='exact', choices=tuple(ALLOCATORS), mutable=True
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
