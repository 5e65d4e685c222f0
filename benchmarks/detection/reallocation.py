"""Flights in which the allocator is told what the detector finds: what that saves or costs."""

from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from benchmarks.detection.conditions import FLOWN, LOSSES, Condition
from benchmarks.detection.flights import DURATION, Job, Setup, rng_of
from benchmarks.detection.plant import GROUNDED, PERIOD, Plant
from ca_ros import Exact
from ca_ros.allocation.reconfiguration import Arms
from ca_ros.arrays import Array
from ca_ros.detection.acted_on import acted_on
from ca_ros.problem.audit import accept
from ca_ros.vehicle.vehicle import Vehicle

AXES = 'thrust', 'roll', 'pitch', 'yaw'
BEGIN = 8.0  # when the rotor fails, or is taken for failed [s]
AFTER = 10.0  # how long the flight goes on [s]
LAST = 3.0  # it is judged by its last seconds [s]
ANNOUNCED = 0.1  # when a loss is announced [s]
TILT = np.radians(75.0)  # a vehicle that flies is never tilted further in the last seconds
CLIMB, DROP = -2.0, 25.0  # it falls no faster in the mean [m/s], and no further [m]

WAYS = 'announced', 'detected', 'unknown', 'false', 'false for 1 s'
"""What the allocator is told: of a loss after 0.1 s, by the detector, nothing; of no loss at all
that a sound rotor is lost, for good or for a second, by nobody but us."""


ACTING, AFTERWARDS = 'acting', 'afterwards'
"""The kinds of flights in which the allocator does what the detector says: without a failure, and
with a rotor lost."""


@dataclass(frozen=True)
class Flown:
    """How a flight ended: whether it goes on, and its greatest tilt [rad] and drop [m].

    - `rotor`: that fails
    - `named`: the rotors that the detector named first
    - `without`: the rotors that lack health in the end
    """

    flies: bool
    tilt: float
    drop: float
    rotor: int
    named: tuple[int, ...]
    without: tuple[int, ...]

    @property
    def arm(self) -> bool:
        """Two rotors were named first."""
        return len(self.named) == 2

    @property
    def told(self) -> bool:
        """Of an arm, one rotor is said to have failed in the end."""
        return self.arm and len(self.without) == 1


class Allocation:
    """`exact` for the health that is told; each health is set up once."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle, self._made = vehicle, dict[Any, Callable[[Array], Array]]()
        self.tell(np.ones(vehicle.n))

    def tell(self, health: Array, arms: Arms = ()) -> None:
        """Allocate for a health (n,) and failed arms from now on."""
        key = np.asarray(health, float).tobytes(), arms
        if key not in self._made:
            try:
                self._made[key] = self._make(health, arms)
            except ValueError:
                return  # nothing can be made for what is left, so the last one stays, as in nodes
        self.speeds = self._made[key]

    def _make(self, health: Array, arms: Arms) -> Callable[[Array], Array]:
        exact = Exact(accept(self._vehicle.with_health(health, arms), 'drop').independent)
        rows = [AXES.index(axis) for axis in exact.problem.axes]
        return lambda wrench: np.asarray(exact.allocate(wrench[rows]).speeds)


def flown(
    setup: Setup, condition: Condition, way: str, seed: int, left: float = 0.0
) -> Flown:
    """Fly one way of `WAYS`; the rotor is the remainder of the seed, and keeps what is `left`."""
    rng, vehicle = rng_of(seed, setup.name, 'reallocation'), setup.vehicle
    rotor, duration = seed % vehicle.n, BEGIN + AFTER
    failure = {'low': 40.0, 'high': 50.0}
    if not way.startswith('false'):
        failure |= {**LOSSES['total'], 'left': left, 'rotor': rotor, 'time': BEGIN}
    truth, mission = condition.draw(setup.model, rng, duration, failure)
    plant = Plant(setup.model, truth, mission, int(rng.integers(2**63)))
    allocation, lost = Allocation(vehicle), np.ones(vehicle.n)
    named: tuple[int, ...] = ()
    without: tuple[int, ...] = ()
    lost[rotor] = left
    detector: Any = setup.detector(truth) if way == 'detected' else None
    rows, failed = [], -1
    for i in range(round(duration / PERIOD)):
        row, wrench = plant.sense()
        if failed < 0 and (row['failed'] or (way.startswith('false') and i * PERIOD >= BEGIN)):
            failed = i
        if detector is not None:
            if observe(setup, detector, row):
                acted = acted_on(detector)
                allocation.tell(acted.health, acted.arms)
                without = tuple(np.flatnonzero(detector.health < 1.0).tolist())
                named = named or without
        elif failed >= 0:
            since = round((i - failed) * PERIOD, 6)
            told = since == 0.0 if way.startswith('false') else since == ANNOUNCED
            if told and way != 'unknown':
                allocation.tell(lost)
            if way == 'false for 1 s' and since == 1.0:
                allocation.tell(np.ones(vehicle.n))
        command = allocation.speeds(wrench)
        if detector is not None:
            detector.command(int(row['time']), command)
        plant.act(command)
        rows.append(plant.state[0])
    states = np.array(rows)
    up = 1.0 - 2.0 * (states[:, 6] ** 2 + states[:, 7] ** 2)
    tilt = np.arccos(np.clip(up, -1.0, 1.0))
    last = -round(LAST / PERIOD)
    begin = max(failed, 0)
    drop = float(states[begin, 2] - states[begin:, 2].min())
    climb = states[last:, 5].mean()
    flies = bool(tilt[last:].max() < TILT and climb > CLIMB and drop < DROP)
    return Flown(flies, float(tilt[begin:].max()), drop, rotor, named, without)


@dataclass
class Acted:
    """Flights in which the allocator does what the detector says.

    - `hours`: without a failure, or after a loss
    - `names`: how often a sound rotor with full health was named, but the partner of a lost one
    - `without`: how long a sound rotor was not fully used [s]
    - `turned_over`: flights that ended so
    """

    hours: float = 0.0
    names: int = 0
    without: float = 0.0
    turned_over: int = 0

    def __add__(self, other: 'Acted') -> 'Acted':
        return Acted(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


def acting(
    setup: Setup, name: str, seed: int, duration: float = DURATION, kind: str = ACTING
) -> Acted:
    """Fly; the detector is never reset, and the allocator does what it says.

    With `AFTERWARDS` a rotor is lost, the remainder of the seed; it is counted from then on.
    """
    rng, vehicle, found = rng_of(seed, setup.name, name), setup.vehicle, Acted()
    rotor, failure, sound = seed % vehicle.n, {}, np.ones(vehicle.n, bool)
    if kind == AFTERWARDS:
        failure = {**LOSSES['total'], 'rotor': rotor, 'time': BEGIN, 'low': 40.0, 'high': 50.0}
        sound[[i for i in (rotor, setup.partner(rotor)) if i is not None]] = False
    truth, mission = FLOWN[name].draw(setup.model, rng, duration, failure)
    plant = Plant(setup.model, truth, mission, int(rng.integers(2**63)))
    allocation, detector, health = Allocation(vehicle), setup.detector(truth), np.ones(vehicle.n)
    acted = acted_on(detector)
    idle = np.full(vehicle.n, setup.model.slowest)
    for _ in range(round(duration / PERIOD)):
        row, wrench = plant.sense()
        counts = not failure or bool(row['failed'])
        if observe(setup, detector, row):
            new = np.array(detector.health)
            found.names += int(((new < 1.0) & (health == 1.0) & sound).sum()) * counts
            health, acted = new, acted_on(detector)
            allocation.tell(acted.health, acted.arms)
        command = idle if row['mode'] == GROUNDED else allocation.speeds(wrench)
        detector.command(int(row['time']), command)
        plant.act(command)
        found.hours += PERIOD / 3600.0 * counts
        found.without += PERIOD * counts * bool((acted.health < 1.0)[sound].any())
        x, y = plant.state[0][6:8]
        if 1.0 - 2.0 * (x * x + y * y) < -0.2:
            found.turned_over = 1
            break
    return found


def observe(setup: Setup, detector: Any, row: Any) -> bool:
    """Give a detector a row; return whether the health has changed."""
    motion = row['attitude'], row['velocity'], row['rates']
    force = {'specific_force': row['specific_force']} if setup.force else {}
    return bool(detector.observe(int(row['time']), *motion, **force))


def act(job: Job) -> tuple[tuple[str, str, str], Acted]:
    """Fly for a vehicle, a condition, a kind and seeds; return key and what was counted."""
    vehicle, name, kind, seeds, options = job
    setup = Setup.load(vehicle, **options)
    found = [acting(setup, name, seed, kind=kind) for seed in seeds]
    return (vehicle, name, kind), sum(found, Acted())


def fly_on(job: Job, left: float = 0.0) -> tuple[tuple[str, str, str], list[Flown]]:
    """Fly for a vehicle, a condition, a way, and seeds; return key and what happened.

    `left`: see `flown`.
    """
    vehicle, name, way, seeds, options = job
    setup, condition = Setup.load(vehicle, **options), FLOWN[name]
    return (vehicle, name, way), [flown(setup, condition, way, seed, left) for seed in seeds]


def call(function: Callable[[Any], Any], job: Any) -> Any:
    """Call a function; a pool of processes finds this one by its module."""
    return function(job)
