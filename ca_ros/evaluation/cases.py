"""What a study is about: a vehicle with its parameters, and the methods compared on it."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.allocation import ALLOCATORS, Allocator, make_allocator
from ca_ros.allocation.options import options_from_parameters
from ca_ros.arrays import Array
from ca_ros.evaluation.comparison import FOR_COMPARISON
from ca_ros.flight.closed_loop import Change
from ca_ros.flight.controller import Controller
from ca_ros.flight.plots import add_option
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.nodes.parameters import PARAMETERS, load
from ca_ros.problem.audit import accept, audit
from ca_ros.schema import ParameterError, complete
from ca_ros.vehicle.files import read_value
from ca_ros.vehicle.vehicle import Vehicle

BUILT_IN = tuple(ALLOCATORS)
"""Those of the package, the four of the paper in the order of its Table 1."""


def parser(prog: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the options that all studies share."""
    made = argparse.ArgumentParser(
        prog=prog,
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    made.add_argument('--vehicle', default='hexarotor', help='a shipped vehicle or a YAML file')
    made.add_argument(
        '--methods',
        default='all',
        metavar='A,B',
        help=f'what to compare: {", ".join([*BUILT_IN, *FOR_COMPARISON])}, module:Class for a '
        f'method of your own, all for the first {len(BUILT_IN)}',
    )
    made.add_argument(
        '-p',
        '--param',
        action='append',
        default=[],
        metavar='NAME:=VALUE',
        help="a parameter other than in the vehicle's file, as with ROS; may be repeated",
    )
    made.add_argument(
        '--out', type=Path, default=Path('.'), metavar='DIR', help='folder of the results'
    )
    add_option(made)
    return made


def positive(kind: type[int] | type[float], text: str) -> Any:
    """Return the number in a command line's word; raise what argparse turns into a message."""
    try:
        number = kind(text)
    except ValueError:
        number = kind(0)
    if not 0 < number < float('inf'):
        raise argparse.ArgumentTypeError(f'{text!r} is not a positive number')
    return number


def natural(text: str) -> int:
    """Return the whole number in a command line's word, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 on')
    return int(text)


def command(prog: str, options: argparse.Namespace) -> list[str]:
    """Return the command that gives the same results: all options but the places of files."""
    words = [prog]
    for name, value in vars(options).items():
        if name not in ('out', 'figures') and value is not None and value is not False:
            for each in value if isinstance(value, list) else [value]:
                words += [f'--{name.replace("_", "-")}', *([] if value is True else [str(each)])]
    return words


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in a list instead of stopping; a second one stops at once."""
    received: list[int] = []

    def note(number: int, _: object) -> None:
        received.append(number)
        signal.signal(number, signal.SIG_DFL)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass(frozen=True, eq=False)
class Case:
    """A vehicle under study.

    Attributes
    ----------
    name : str
        The vehicle as it was asked for.
    parameters : dict
        All its parameters by name, checked.
    vehicle : Vehicle
        With the axes that its rotors can command.
    changes : tuple of str
        What is other than in the vehicle's file, ``NAME:=VALUE``.
    """

    name: str
    parameters: dict[str, Any]
    vehicle: Vehicle
    changes: tuple[str, ...] = ()

    @classmethod
    def load(cls, name: str, changes: Sequence[str] = ()) -> Case:
        """Read a vehicle's parameter file.

        Parameters
        ----------
        name : str
            A shipped vehicle or the path of a parameter file.
        changes : sequence of str
            ``NAME:=VALUE``, the value as in a parameter file.

        Raises
        ------
        ParameterError
            In one line that names the fault.
        """
        parameters: dict[str, Any] = dict(load(name))
        for change in changes:
            parameters.update([_change(change)])
        parameters = complete(parameters, PARAMETERS)
        try:
            vehicle = accept(Vehicle.from_parameters(parameters)).vehicle
        except ParameterError as error:
            raise ParameterError(f'{name}: {error}') from None
        return cls(name, parameters, vehicle, tuple(changes))

    def audited(self, health: Array) -> Vehicle:
        """Return the vehicle with the rotors' health (n,), and the axes that they can command."""
        return audit(Vehicle.from_parameters(self.parameters).with_health(health)).vehicle

    def controller(self, vehicle: Vehicle | None = None) -> Controller:
        """Return the controller, for the vehicle as `audited` returns it or as it is."""
        return Controller.from_parameters(vehicle or self.vehicle, self.parameters)

    def body(self, health: Array | None = None) -> RigidBody:
        """Return the rigid body, with the rotors' health (n,) or as it is."""
        drag = self.parameters['simulator.rotational_drag']
        return RigidBody(self.vehicle if health is None else self.audited(health), drag)

    def failing(self, method: str, failures: RotorFailures) -> list[Change]:
        """Return what failures change in the closed loop of a method."""
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
        """Return a method, with its options from the parameters.

        Parameters
        ----------
        method : str
            A name, or ``module:Class`` for a class that takes a vehicle and has ``allocate``.
        vehicle : Vehicle, optional
            As `audited` returns it; by default the vehicle as it is.

        Raises
        ------
        ValueError
            If there is no such method.
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
        """Return the methods of a list such as ``exact,my_module:MyMethod`` by name."""
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
    if not (colon and name and all(part.isidentifier() for part in module.split('.'))):
        raise ValueError(f'no method {method!r}; there are {known}, and module:Class for your own')
    if os.getcwd() not in sys.path:
        # An installed script sees its own folder, but users have their method where they stand.
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
