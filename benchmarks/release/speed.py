"""What users call, timed by asv: `make compare BASE=commit`.

asv leaves out what an old version cannot run (`optional`); a test runs all with the present one.
The time of an import is not here: it differs by a third between equal commits.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import ca_ros
from ca_ros import Vehicle, make_allocator

from .drawn import KINDS, speeds, wrenches

VEHICLES = 'hexarotor', 'x8', 'hexarotor_tilted'
CALLS = 200  # in a sample, as many wrenches


class Timed:
    """How often asv samples: the versions take turns, so that what slows some turns slows both.

    The median of few samples in each of many turns differs less between two runs than that of many
    samples in few turns.
    """

    rounds = 5
    repeat = 5
    sample_time = 0.005
    warmup_time = 0.02


@contextmanager
def optional() -> Iterator[None]:
    """Tell asv to skip a benchmark whose preparation fails, as it does in an old version."""
    try:
        yield
    except (AttributeError, ImportError, TypeError, ValueError) as error:
        raise NotImplementedError(str(error)) from error


def exact(vehicle: Any, **settings: Any) -> Any:
    """Return the exact allocator of a vehicle, whose class has no public name before 0.2."""
    made = getattr(ca_ros, 'Exact', None)
    return made(vehicle, **settings) if made else make_allocator('exact', vehicle, **settings)


def within_rates(allocator: Any) -> Any:
    """Return a function (u, last speeds, period) that allocates within rates of 2000 rad/s^2."""
    return ca_ros.SlewLimited(allocator, 2000.0).allocate


def after_failures(vehicle: Any) -> Any:
    """Return a function that builds the allocator of each single failure, its audit included."""
    healths = [[float(i != lost) for i in range(vehicle.n)] for lost in range(vehicle.n)]
    allocator = exact(vehicle)
    if hasattr(allocator, 'with_health'):
        return lambda: [allocator.with_health(health) for health in healths]
    from ca_ros.problem.audit import accept

    failed = [vehicle.with_health(health) for health in healths]
    kept = 'independent' if hasattr(accept(vehicle), 'independent') else 'problem'
    return lambda: [exact(getattr(accept(each, 'drop'), kept)) for each in failed]


class Allocate(Timed):
    """Calls with one wrench each, by kind of wrench."""

    params = VEHICLES, KINDS
    param_names = 'vehicle', 'wrenches'

    def setup(self, vehicle: str, kind: str) -> None:
        with optional():
            self.allocator = exact(Vehicle.load(vehicle))
            self.wrenches = list(wrenches(self.allocator.problem, kind, CALLS))
            self.time_speeds(vehicle, kind)

    def time_thrusts_and_status(self, vehicle: str, kind: str) -> None:
        allocate = self.allocator.allocate
        for u in self.wrenches:
            answer = allocate(u)
            answer.thrusts, answer.status  # noqa: B018

    def time_speeds(self, vehicle: str, kind: str) -> None:
        allocate = self.allocator.allocate
        for u in self.wrenches:
            allocate(u).speeds  # noqa: B018


class AllocateWithinRates(Timed):
    """Calls with one wrench and the last speeds each."""

    params = (VEHICLES,)
    param_names = ('vehicle',)

    def setup(self, vehicle: str) -> None:
        with optional():
            allocator = exact(Vehicle.load(vehicle))
            self.allocate = within_rates(allocator)
            demands = wrenches(allocator.problem, 'uniform', CALLS)
            self.calls = list(zip(demands, speeds(allocator.problem.vehicle, CALLS), strict=True))
            self.time_thrusts_and_status(vehicle)

    def time_thrusts_and_status(self, vehicle: str) -> None:
        for u, last in self.calls:
            answer = self.allocate(u, last, 0.01)
            answer.thrusts, answer.status  # noqa: B018


class AllocateTilting(Timed):
    """Calls for rotors that tilt."""

    def setup(self) -> None:
        with optional():
            self.allocator = exact(Vehicle.load('hexarotor_tilting'))
            problem = self.allocator.problem
            self.wrenches = list(wrenches(problem, 'flight', CALLS))
            self.time_thrusts_and_status()

    def time_thrusts_and_status(self) -> None:
        for u in self.wrenches:
            answer = self.allocator.allocate(u)
            answer.thrusts, answer.status  # noqa: B018


class Batch(Timed):
    """5000 wrenches in one call."""

    def setup(self) -> None:
        with optional():
            self.allocator = exact(Vehicle.load('hexarotor'))
            self.wrenches = wrenches(self.allocator.problem, 'uniform', 5000)
            self.time_batch()

    def time_batch(self) -> None:
        self.allocator.allocate_batch(self.wrenches)


class Prepare(Timed):
    """What comes before a call: audit, set-up, and both after each failure of a rotor."""

    params = ((*VEHICLES, 'quadrotor', 'hexarotor_tilting', 'tricopter'),)
    param_names = ('vehicle',)

    def setup(self, vehicle: str) -> None:
        with optional():
            self.vehicle = Vehicle.load(vehicle)
            self.rebuild = after_failures(self.vehicle)
            self.rebuild()

    def time_set_up(self, vehicle: str) -> None:
        exact(self.vehicle)

    def time_change_of_health(self, vehicle: str) -> None:
        self.rebuild()

    def time_audit(self, vehicle: str) -> None:
        ca_ros.audit(self.vehicle)
