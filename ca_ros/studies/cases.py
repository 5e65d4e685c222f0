"""The case of a study: a vehicle or problem with its parameters, and the methods on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from ca_ros.allocation import ALLOCATORS, AllocationProblem, Allocator
from ca_ros.allocation.reconfiguration import Reconfiguration
from ca_ros.allocation.settings import MethodSettings, allocator_of, own_methods
from ca_ros.control.controller import Controller
from ca_ros.detection.kernel_detector import Detector, make_detector
from ca_ros.errors import suggestion
from ca_ros.parameter_files import FileSettings
from ca_ros.problem.audit import Audit, accept, audit
from ca_ros.problem.files import read_problem
from ca_ros.problem.vehicle_problem import VehicleProblem, vehicle_of
from ca_ros.setting_names import check_given, renamed
from ca_ros.settings import Field, Numbers, ParameterError, flat, names_class, read, table
from ca_ros.simulation.closed_loop import Believed, Change, Detection, Found
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.studies.comparison import FOR_COMPARISON
from ca_ros.vehicle import files
from ca_ros.vehicle.vehicle import Vehicle

PAPER = ('exact', 'pseudo_inverse', 'conventional', 'direct')
"""The paper's methods, in the order of its Table 1."""

SETS = {'paper': PAPER, 'all': tuple(ALLOCATORS)}  # words that stand for several methods


@dataclass(frozen=True, eq=False)
class Case:
    """A vehicle, or a problem without a vehicle, under study.

    The name is that of a shipped one, or the path of a file; there are no settings without a
    vehicle.  The problem of a vehicle has the axes that its rotors can control.  `changes` are
    parameters other than in the file, ``NAME:=VALUE``.  Methods that do not apply to the problem
    and were not asked for by name are `left_out`, with the reason.
    """

    name: str
    settings: FileSettings | None
    methods: MethodSettings
    problem: AllocationProblem
    changes: tuple[str, ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)

    @property
    def flies(self) -> bool:
        """Whether this is a vehicle."""
        return self.settings is not None

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, with the axes that its rotors can control; a TypeError without one."""
        return vehicle_of(self.problem)

    @classmethod
    def load(
        cls, name: str, changes: Sequence[str] = (), methods: Sequence[str] = (),
        flying: bool = False,
    ) -> Case:
        """Read the file of a vehicle or problem and apply changes; a ParameterError if wrong.

        The parameters are those of a file, and those that one's own `methods` declare.  If
        `flying`, only a vehicle is right.
        """
        found = None if flying else read_problem(name, AllocationProblem)
        problem, given = (None, files.read(name)) if found is None else found
        own = own_methods(*methods, str(given.get('allocation.method')))
        kind: Any = FileSettings if problem is None else MethodSettings
        prefix = '' if problem is None else 'allocation.'
        try:
            given = _changed(given, changes, known := table(kind, prefix, own))
            check_given(given, known)
            settings = read(kind, given, prefix, own)
            if problem is not None:
                return cls(name, None, settings, problem, tuple(changes))
            parts = settings.vehicle, settings.rotors, settings.allocation
            vehicle = accept(Vehicle.from_settings(*parts)).vehicle
        except ParameterError as error:
            raise ParameterError(f'{name}: {error}') from None
        return cls(name, settings, settings.allocation, VehicleProblem(vehicle), tuple(changes))

    @property
    def parameters(self) -> dict[str, Any]:
        """All settings by full name; those of the methods alone if there is no vehicle."""
        if self.settings is None:
            return flat(self.methods, 'allocation.')
        return flat(self.settings)

    @property
    def flown(self) -> FileSettings:
        """The settings of a vehicle; a TypeError without one."""
        if self.settings is None:
            raise TypeError(f'{self.name} is not a vehicle')
        return self.settings

    def audited(self, health: ArrayLike, stuck: Numbers | None = None) -> Vehicle:
        """Return the vehicle with other rotor health (n,), and the axes it can then control.

        `stuck` replaces `rotors.stuck_servos`.
        """
        given = self.flown
        vehicle = Vehicle.from_settings(given.vehicle, given.rotors, given.allocation)
        servos = given.rotors.stuck_servos if stuck is None else stuck
        return audit(vehicle.with_health(health).with_stuck_servos(servos)).vehicle

    def controller(self, vehicle: Vehicle | None = None) -> Controller:
        """Return the controller for a vehicle; by default for `self.vehicle`."""
        return Controller.from_settings(vehicle or self.vehicle, self.flown)

    def body(self, health: ArrayLike | None = None, stuck: Numbers | None = None) -> RigidBody:
        """Return the rigid body, optionally with other rotor health (n,) and stuck servos."""
        vehicle = self.vehicle if health is None else self.audited(health, stuck)
        return body_of(vehicle, self.flown.simulator)

    def plant(self) -> Plant:
        """Return the plant, with all effects of the parameters ``simulator.*``."""
        return Plant(self.body(), self.flown.simulator, imu=self.flown.detector)

    def reconfiguration(
        self, method: str, controller: Controller, allocator: Allocator,
        changed: Callable[[Controller], Controller] = lambda made: made,
    ) -> Believed:
        """Return what makes controller and allocator of a method for the failures of a flight.

        `controller` and `allocator` are those that fly.  `changed` is called with each new
        controller, and returns what flies instead.
        """

        def make(
            settings: FileSettings, report: Audit, before: tuple[Controller, Allocator] | None
        ) -> tuple[Controller, Allocator]:
            made = Controller.from_settings(report.vehicle, settings, before and before[0])
            return changed(made), self.allocator(method, report)

        return Reconfiguration(self.flown, make, (controller, allocator))

    def announced(self, method: str, failures: RotorFailures) -> list[Change]:
        """Return the changes of a method's closed loop that announced failures cause."""
        reconfigure = partial(self.reconfiguration, method)
        return [
            Change(time, announced=failures.announced(self.vehicle.n, time),
                   reconfigure=reconfigure) for time in failures.announced_times
        ]

    def detector(self) -> Detector:
        """Return a detector of failures with the settings ``detector.*``."""
        return make_detector(self.vehicle, self.flown.detector)

    def detected(self, method: str, found: Found) -> list[Change]:
        """Return the changes of a method's closed loop that found failures cause."""
        reconfigure = partial(self.reconfiguration, method)
        return [
            Change(time, detected=acted, reconfigure=reconfigure) for time, _, acted in found]

    def detection(self, method: str) -> Detection:
        """Return the detection of failures for a method's closed loop."""
        return Detection(self.detector(), partial(self.reconfiguration, method))

    def allocator(
        self, method: str, vehicle: Vehicle | Audit | AllocationProblem | None = None
    ) -> Allocator:
        """Return the allocator of a method for a vehicle, its audit or a problem.

        By default it is the vehicle or problem of the case.

        A method is one of `make_allocator`, whose options are in the parameters, or one of
        `FOR_COMPARISON`.  Raises a ValueError if there is no such method.
        """
        subject = vehicle or (self.vehicle if self.flies else self.problem)
        if method in FOR_COMPARISON:
            part = subject.independent if isinstance(subject, Audit) else subject
            return FOR_COMPARISON[method](part)
        given = accept(subject) if isinstance(subject, Vehicle) else subject
        return allocator_of(replace(self.methods, method=method), given)


def methods_of(text: str) -> list[str]:
    """Return the methods in a list such as ``paper,my_module:MyMethod``, each once.

    Raises a ValueError if there is no such method; classes are not imported.
    """
    names: list[str] = []
    for word in (each.strip() for each in text.split(',')):
        if not (word in {*SETS, *ALLOCATORS, *FOR_COMPARISON} or names_class(word)):
            known = f'{", ".join([*ALLOCATORS, *FOR_COMPARISON])}, {" and ".join(SETS)}'
            more = f'{known} for several, and module:Class for your own'
            hint = suggestion(word, [*ALLOCATORS, *FOR_COMPARISON])
            raise ValueError(f'no method {word!r}{hint}; there are {more}')
        names += SETS.get(word, (word,))
    return list(dict.fromkeys(names))


def _changed(
    given: Mapping[str, Any], changes: Sequence[str], known: Mapping[str, Field]
) -> dict[str, Any]:
    """Return given values with changes ``NAME:=VALUE``."""
    values: dict[str, Any] = {}
    for change in changes:
        name, assigned, value = change.partition(':=')
        if not assigned:
            raise ParameterError(f'{name}: expected NAME:=VALUE')
        values |= renamed({name: files.read_value(name, value)})
    if unknown := [name for name in values if name not in known]:
        raise ParameterError(f'{unknown[0]}: no such parameter')
    return {**given, **values}
