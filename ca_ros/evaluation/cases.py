"""The case of a study: a vehicle with its parameters, and the methods compared on it."""

from __future__ import annotations

import os
import signal
import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from typing import Any

import numpy as np

from ca_ros.allocation import ALLOCATORS, Allocator, make_allocator
from ca_ros.allocation.options import options_from_parameters
from ca_ros.arrays import Array
from ca_ros.errors import CaRosError
from ca_ros.evaluation.comparison import FOR_COMPARISON
from ca_ros.flight.closed_loop import Change
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.nodes.parameters import PARAMETERS, load
from ca_ros.problem.audit import accept, audit
from ca_ros.schema import ParameterError, complete
from ca_ros.vehicle.files import read_value
from ca_ros.vehicle.vehicle import Vehicle

BUILT_IN = tuple(ALLOCATORS)
"""The methods of the package; the first four in the order of Table 1 of the paper."""


class CaseError(CaRosError):
    """The vehicle, a parameter or a method of a command line is wrong."""


@dataclass(frozen=True, eq=False)
class Case:
    """A vehicle under study.

    Attributes
    ----------
    name : str
        A shipped vehicle or the path of a parameter file.
    parameters : dict
        All parameters by name, checked.
    vehicle : Vehicle
        With the axes that its rotors can command.
    changes : tuple of str
        Parameters other than in the vehicle's file, ``NAME:=VALUE``.
    """

    name: str
    parameters: dict[str, Any]
    vehicle: Vehicle
    changes: tuple[str, ...] = ()

    @classmethod
    def load(cls, name: str, changes: Sequence[str] = ()) -> Case:
        """Read a vehicle's parameter file and apply changes; raise a ParameterError if wrong."""
        parameters = complete(dict(load(name)) | dict(map(_change, changes)), PARAMETERS)
        try:
            vehicle = accept(Vehicle.from_parameters(parameters)).vehicle
        except ParameterError as error:
            raise ParameterError(f'{name}: {error}') from None
        return cls(name, parameters, vehicle, tuple(changes))

    @classmethod
    def of(cls, options: Namespace) -> tuple[Case, dict[str, Allocator]]:
        """Return case and allocators of a command line; make the folder of the results.

        From then on SIGINT raises a KeyboardInterrupt, also in a background process, which shells
        start with SIGINT ignored. Raises a CaseError if the command line is wrong.
        """
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            case = cls.load(options.vehicle, options.param)
            allocators = case.allocators(options.methods)
        except ValueError as error:
            raise CaseError(str(error)) from None
        options.out.mkdir(parents=True, exist_ok=True)
        return case, allocators

    def audited(self, health: Array) -> Vehicle:
        """Return the vehicle with other rotor health (n,), and the axes it can then command."""
        return audit(Vehicle.from_parameters(self.parameters).with_health(health)).vehicle

    def controller(self, vehicle: Vehicle | None = None) -> Controller:
        """Return the controller for a vehicle; by default for `self.vehicle`."""
        return Controller.from_parameters(vehicle or self.vehicle, self.parameters)

    def body(self, health: Array | None = None) -> RigidBody:
        """Return the rigid body, optionally with other rotor health (n,)."""
        drag = self.parameters['simulator.rotational_drag']
        return RigidBody(self.vehicle if health is None else self.audited(health), drag)

    def failing(self, method: str, failures: RotorFailures) -> list[Change]:
        """Return the changes of a method's closed loop that rotor failures cause."""
        changes = []
        physical = believed = self.vehicle.health
        for time in failures.times():
            before = physical, believed
            physical = failures.physical(self.vehicle.health, time)
            believed = failures.believed(self.vehicle.health, time)
            told = not np.array_equal(believed, before[1])
            vehicle = self.audited(believed) if told else None
            changes.append(
                Change(
                    time,
                    self.controller(vehicle) if told else None,
                    self.allocator(method, vehicle) if told else None,
                    None if np.array_equal(physical, before[0]) else self.body(physical),
                )
            )
        return changes

    def allocator(self, method: str, vehicle: Vehicle | None = None) -> Allocator:
        """Return the allocator of a method for a vehicle, by default `self.vehicle`.

        A method is a name, whose options are in the parameters, or ``module:Class`` for a class
        that takes a vehicle and has ``allocate``. Raises a ValueError if there is no such method.
        """
        vehicle = vehicle or self.vehicle
        if method in ALLOCATORS:
            chosen = {**self.parameters, 'allocation.method': method}
            options = options_from_parameters(chosen, vehicle.axes)
            return make_allocator(method, vehicle, **options)
        kind = FOR_COMPARISON[method] if method in FOR_COMPARISON else _own_class(method)
        made = kind(vehicle)
        if not callable(getattr(made, 'allocate', None)):
            raise ValueError(f'{method}: has no method allocate')
        return made

    def allocators(self, methods: str) -> dict[str, Allocator]:
        """Return the allocators of a list such as ``exact,my_module:MyMethod`` by name."""
        words = [word.strip() for word in methods.split(',')]
        names = [name for word in words for name in (BUILT_IN if word == 'all' else (word,))]
        return {name: self.allocator(name) for name in dict.fromkeys(names)}


def _change(text: str) -> tuple[str, Any]:
    name, given, value = text.partition(':=')
    if not given or name not in PARAMETERS:
        fault = 'no such parameter' if given else 'expected NAME:=VALUE'
        raise ParameterError(f'{name}: {fault}')
    return name, read_value(name, value)


def _own_class(method: str) -> type[Allocator]:
    module, colon, name = method.partition(':')
    known = ', '.join([*BUILT_IN, *FOR_COMPARISON])
    if not (colon and all(part.isidentifier() for part in (*module.split('.'), name))):
        raise ValueError(f'no method {method!r}; there are {known}, and module:Class for your own')
    if os.getcwd() not in sys.path:
        # Python finds modules beside an installed script, but not in the working directory.
        sys.path.append(os.getcwd())
    try:
        found: type[Allocator] = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f'{method}: {error}') from None
    if not isinstance(found, type):
        raise ValueError(f'{method}: not a class')
    if missing := ', '.join(sorted(getattr(found, '__abstractmethods__', ()))):
        raise ValueError(f'{method}: the class does not define {missing}')
    try:
        signature(found).bind(None)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{method}: cannot be made from a vehicle: {error}') from None
    return found
