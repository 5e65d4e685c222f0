"""The allocation methods, one a file, behind one interface."""

from __future__ import annotations

from typing import Any

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.conventional import Conventional
from ca_ros.allocation.direct import Direct
from ca_ros.allocation.exact import Exact
from ca_ros.allocation.pseudo_inverse import PseudoInverse
from ca_ros.allocation.result import Allocation, Status
from ca_ros.allocation_problem import AllocationProblem
from ca_ros.vehicle import Vehicle

ALLOCATORS: dict[str, type[Allocator]] = {
    'pseudo_inverse': PseudoInverse,
    'direct': Direct,
    'conventional': Conventional,
    'exact': Exact,
}
"""The methods by name."""


def make_allocator(method: str, vehicle: Vehicle, **options: Any) -> Allocator:
    """Return an allocator for a vehicle.

    Parameters
    ----------
    method : str
        A name in `ALLOCATORS`.
    vehicle : Vehicle
    **options
        Keyword arguments of the method's class.

    Raises
    ------
    ValueError
        If there is no such method.
    TypeError
        If the method has no such option.
    """
    if method not in ALLOCATORS:
        raise ValueError(f'no allocation method {method!r}; there are {", ".join(ALLOCATORS)}')
    return ALLOCATORS[method](vehicle, **options)


__all__ = [
    'ALLOCATORS',
    'Allocation',
    'AllocationProblem',
    'Allocator',
    'Conventional',
    'Direct',
    'Exact',
    'PseudoInverse',
    'Status',
    'make_allocator',
]
