"""The allocation methods, one per file, with one interface."""

import os
import sys
from importlib import import_module
from inspect import signature
from typing import Any

from ca_ros.allocation.allocator import Allocator, AtRest
from ca_ros.allocation.betaflight_mixer import BetaflightMixer
from ca_ros.allocation.conventional import Conventional
from ca_ros.allocation.direct import Direct
from ca_ros.allocation.exact import Exact
from ca_ros.allocation.osqp import Osqp
from ca_ros.allocation.pseudo_inverse import PseudoInverse
from ca_ros.allocation.redistributed_pseudo_inverse import RedistributedPseudoInverse
from ca_ros.allocation.reduced import after_failures, allocator_for
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.allocation.sequential_desaturation import SequentialDesaturation
from ca_ros.allocation.slew import SlewLimited
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.allocation.weighted_least_squares import WeightedLeastSquares
from ca_ros.allocation.weighted_pseudo_inverse import WeightedPseudoInverse
from ca_ros.errors import suggestion
from ca_ros.problem.audit import Audit, accept
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.settings import Settings, names_class, settings_of
from ca_ros.vehicle.vehicle import Vehicle

ALLOCATORS: dict[str, type[Allocator]] = {
    'exact': Exact,
    'pseudo_inverse': PseudoInverse,
    'conventional': Conventional,
    'direct': Direct,
    'weighted_pseudo_inverse': WeightedPseudoInverse,
    'redistributed_pseudo_inverse': RedistributedPseudoInverse,
    'weighted_least_squares': WeightedLeastSquares,
    'sequential_desaturation': SequentialDesaturation,
    'betaflight_mixer': BetaflightMixer,
    'osqp': Osqp,
}
"""The allocation methods by name; the first four in the order of the paper's Table 1."""


def method_class(method: str) -> type[Allocator]:
    """Return the class of a method: a name in `ALLOCATORS`, or ``module:Class`` for one's own.

    The module is imported from Python's path or the working directory.  Raises a ValueError if
    there is no such method, the import fails, or the class is not a complete subclass of
    `Allocator` that can be made from a problem and settings.
    """
    if not isinstance(method, str):
        raise TypeError(f'method: expected a name, such as exact, first; got {method!r}')
    if method in ALLOCATORS:
        return ALLOCATORS[method]
    if not names_class(method):
        raise ValueError(
            f'no allocation method {method!r}{suggestion(method, ALLOCATORS)} (there are '
            f'{", ".join(ALLOCATORS)}, and module:Class for your own)'
        )
    module, _, name = method.partition(':')
    if os.getcwd() not in sys.path:
        # Python finds modules beside an installed script, but not in the working directory.
        sys.path.append(os.getcwd())
    try:
        found = getattr(import_module(module), name)
    except (Exception, SystemExit) as error:
        # The module may raise anything while it is imported.
        raise ValueError(f'{method}: {error or type(error).__name__}') from error
    if not isinstance(found, type):
        raise ValueError(f'{method}: not a class')
    if not issubclass(found, Allocator):
        raise ValueError(f'{method}: expected a subclass of ca_ros.Allocator')
    if missing := ', '.join(sorted(found.__abstractmethods__)):
        raise ValueError(f'{method}: the class does not define {missing}')
    try:
        signature(found).bind(None, None)
    except TypeError:
        raise ValueError(
            f'{method}: expected no __init__, or one that takes (problem, settings, /, **given); '
            '_set_up is for what all answers share'
        ) from None
    return found


def make_allocator(
    method: str, problem: Vehicle | AllocationProblem, lost_axes: str | None = None, **options: Any
) -> Allocator:
    """Return an allocator for a vehicle.

    A vehicle is audited first.  It is refused if its rotors cannot control every axis or cannot
    hover.  An `AllocationProblem` is audited only with `lost_axes`.  If all rotors are lost, the
    allocator is `AtRest`, whatever the method.

    Parameters
    ----------
    method : str
        A name in `ALLOCATORS`, or ``module:Class`` for a subclass of `Allocator` of one's own.
    problem : Vehicle or AllocationProblem
    lost_axes : 'refuse' or 'drop', optional
        'refuse': raise an error if the vehicle has lost axes or cannot hover.  'drop': leave out
        the lost axes; wrenches then have the components ``allocator.problem.axes``.  The default
        is the value in the vehicle's parameter file.  For failures in flight,
        ``make_allocator(method, sound_vehicle).fail(1)`` keeps all axes; see
        `Allocator.with_health`.
    **options
        The settings of the method, see its class.

    Raises
    ------
    ValueError
        If there is no such method, or a setting is wrong.
    ParameterError
        If the vehicle, or the problem, is refused.
    TypeError
        If the method has no such setting.

    Examples
    --------
    >>> make_allocator('exact', Vehicle.load('x8'), policy='scale')
    Exact: 8 rotors, axes thrust, roll, pitch, yaw, engine C, policy='scale'
    """
    kind = method_class(method)
    settings = settings_of(kind, kind.settings_type, None, options)
    if isinstance(problem, Vehicle) or lost_axes is not None:
        return allocator_with(kind, accept(problem, lost_axes), settings)
    return allocator_with(kind, problem, settings)


def allocator_with(
    kind: type[Allocator], subject: Audit | AllocationProblem, settings: Settings
) -> Allocator:
    """Return the allocator of a class and its settings for an audited vehicle, or a problem.

    For a vehicle it takes the axes that the rotors can control independently.
    """
    if isinstance(subject, Audit):
        return allocator_for(kind, subject, settings)
    return kind(problem_of(subject), settings)


__all__ = [
    'ALLOCATORS', 'Allocation', 'AllocationBatch', 'AllocationProblem', 'Allocator', 'AtRest',
    'BetaflightMixer', 'Conventional', 'Direct', 'Exact', 'Osqp', 'PseudoInverse',
    'RedistributedPseudoInverse', 'SequentialDesaturation', 'SlewLimited', 'Status', 'TiltLimited',
    'WeightedLeastSquares', 'WeightedPseudoInverse', 'after_failures', 'allocator_with',
    'make_allocator', 'method_class',
]  # fmt: skip
