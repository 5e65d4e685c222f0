"""Flights with a detector: false alarms, and the names of rotors that fail."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.conditions import CAUSES, CONTACTS, DELAY, FLOWN, LAG, LOSSES, Condition
from benchmarks.detection.plant import (
    CLIMBING,
    DESCENDING,
    GROUNDED,
    PERIOD,
    SHUTTING,
    Plant,
    Rows,
    believed,
)
from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.inertial import Standby
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.vehicle.vehicle import Vehicle

VEHICLES = 'hexarotor', 'quadrotor', 'octorotor', 'x8', 'y6'

TUNING = 5000
"""Seeds below are for the choice of settings."""

PUBLISHED = 41000
"""The first seed of what is published; settings were chosen on seeds below 5000."""

DURATION = 120.0  # of a flight without a failure [s]
LOST = 6.0, 12.0  # when a rotor fails in a flight, at the earliest [s]
LIFTED = 0.1, 1.0  # the same after a take-off, where there are landings [s]
NAMED = 2.0  # how long a failure may take to be named [s]
STOPPED = 4.0  # when states stop, with `force` 'stopped' [s]
BEFORE = 0.5  # a landing begins so long before its first contact [s]
STATED = 'time', 'attitude', 'velocity', 'rates', 'specific_force', 'command'

Job = tuple[str, str, str, range, Mapping[str, Any]]
"""A vehicle, a condition, a kind, seeds, and the options of `Setup.load`."""

Alarm = tuple[int, tuple[int, ...]]
"""A row, and the rotors that are named there."""


def namings(detector: Any, rows: Rows, n: int, force: str = '') -> Iterator[Alarm]:
    """Yield what a detector names in a flight; it is reset after each name.

    `force`: see `Setup`.
    """
    come = np.ones(len(rows), bool)
    if force in ('alone', 'stopped'):
        rows, come = alone(rows, detector.vehicle.gravity, STOPPED if force == 'stopped' else 0.0)
    times, *columns, commands = (rows[name] for name in STATED)
    commands = np.ascontiguousarray(commands[:, :n])
    columns = [np.ascontiguousarray(each) for each in columns[:None if force else 3]]
    observe, command = detector.observe, detector.command
    if force:
        states = [{'specific_force': each} for each in columns.pop()]
    for i, (time, *state) in enumerate(zip(times.tolist(), *columns, strict=True)):
        if come[i] and observe(time, *state, **(states[i] if force else {})):
            health = np.asarray(detector.health)
            if (health < 1.0).any():
                yield i, tuple(np.flatnonzero(health < 1.0).tolist())
                detector.reset()
        command(time, commands[i])


def alone(rows: Rows, gravity: float, stop: float) -> tuple[Rows, NDArray[np.bool_]]:
    """Return rows with attitude and velocity of gyro and accelerometer alone from a time [s] on.

    Also return which rows a detector gets: until the unit takes over, none.
    """
    standby, rows, come = Standby(gravity), rows.copy(), np.ones(len(rows), bool)
    for i, row in enumerate(rows):
        carried = standby.sense(int(row['time']), row['rates'], row['specific_force'])
        if row['time'] - rows['time'][0] < 1e9 * stop:
            standby.hear(row['attitude'].copy(), row['velocity'])
        elif standby.alone:
            row['attitude'], row['velocity'] = carried
        else:
            come[i] = False
    return rows, come


@dataclass
class Count:
    """What was counted in flights without a failure."""

    hours: float = 0.0
    alarms: int = 0  # at most one in a landing
    landings: int = 0
    landing_alarms: int = 0  # landings with an alarm
    takeoff_alarms: int = 0  # alarms from the command to climb until the height is reached
    pushes: int = 0
    push_alarms: int = 0  # pushes with an alarm until half a second after them
    overturned: int = 0
    names: dict[tuple[int, ...], int] = field(default_factory=dict)

    def __add__(self, other: 'Count') -> 'Count':
        names = {
            key: self.names.get(key, 0) + other.names.get(key, 0)
            for key in {**self.names, **other.names}}
        sums = {
            each.name: getattr(self, each.name) + getattr(other, each.name)
            for each in fields(self) if each.name != 'names'}
        return Count(**sums, names=names)

    def add(self, rows: Rows, found: Sequence[Alarm]) -> None:
        """Count a flight."""
        places = np.array([i for i, _ in found], int)
        self.hours += len(rows) * PERIOD / 3600.0
        for _, rotors in found:
            self.names[rotors] = self.names.get(rotors, 0) + 1
        landings = list(landed(rows))
        again, ends = _within(places, landings)
        self.alarms += len(found) - again + ends
        self.landings += len(landings)
        self.landing_alarms += ends
        self.takeoff_alarms += int((rows['mode'][places] == CLIMBING).sum())
        pushes = [(begin, end + round(0.5 / PERIOD)) for begin, end in runs(rows['pushed'] > 0)]
        self.pushes += len(pushes)
        self.push_alarms += _within(places, pushes)[1]


def _within(places: Array, intervals: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return how many places are in intervals, and how many intervals have one."""
    inside = [int(((places >= a) & (places < b)).sum()) for a, b in intervals]
    return sum(inside), sum(map(bool, inside))


def runs(flags: Any) -> list[tuple[int, int]]:
    """Return where flags (N,) are set: first row, and the row after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def landed(rows: Rows) -> Iterator[tuple[int, int]]:
    """Yield landings: from half a second before the first contact until the rotors stop."""
    mode = rows['mode']
    for begin, end in runs((mode == DESCENDING) | (mode == SHUTTING)):
        touching = np.flatnonzero(rows['feet'][begin:end] > 0)
        if len(touching):
            still = np.flatnonzero(mode[end:end + 100] != GROUNDED)
            idle = end + (int(still[0]) if len(still) else min(30, len(rows) - end))
            yield begin + int(touching[0]) - round(BEFORE / PERIOD), idle


@dataclass(frozen=True)
class Setup:
    """A vehicle, what the controller believes of it, and its detector.

    - `make`: makes the detector
    - `force`: 'beside': it also gets the specific force; 'alone': rates and specific force alone;
      'stopped': the same from `STOPPED` s on
    - `settings`: of `detector.*`, beside the lag and the delay that it is told
    """

    name: str
    vehicle: Vehicle
    model: Any
    make: Callable[..., Any] = make_detector
    force: str = ''
    settings: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def load(cls, name: str, **options: Any) -> 'Setup':
        """Return the set-up of a shipped vehicle."""
        vehicle = Vehicle.load(name)
        return cls(name, vehicle, believed(vehicle), **options)

    def detector(self, truth: Any = None) -> Any:
        """Return a detector with the settings, and its defaults otherwise.

        Of the truth it is told where the accelerometer is, to the centimetre.
        """
        given = {'motor_time_constant': LAG, 'delay': DELAY, **self.settings}
        if truth is not None:
            given['imu_position'] = np.round(np.array(truth.imu), 2).tolist()
        return self.make(self.vehicle, DetectorSettings(**given))

    def partner(self, rotor: int) -> int | None:
        """Return the other rotor of a coaxial arm."""
        away = np.linalg.norm((self.vehicle.arms - self.vehicle.arms[rotor])[:, :2], axis=1)
        return next((int(i) for i in np.flatnonzero(away < 1e-6) if i != rotor), None)



def healthy(setup: Setup, name: str, condition: Condition, seeds: range) -> Count:
    """Fly without a failure, a flight of each seed; return what was counted."""
    count = Count()
    kind: type[Plant] = Plant
    if name in CONTACTS:
        from benchmarks.detection.mujoco_body import MujocoPlant
        kind = MujocoPlant
    for seed in seeds:
        rng = rng_of(seed, setup.name, name)
        truth, mission = condition.draw(setup.model, rng, DURATION)
        rows = kind(setup.model, truth, mission, int(rng.integers(2**63))).fly(DURATION)
        count.overturned += len(rows) < round(DURATION / PERIOD)
        found = namings(setup.detector(truth), rows, setup.vehicle.n, setup.force)
        count.add(rows, list(found))
    return count


def rng_of(seed: int, *labels: str) -> np.random.Generator:
    return np.random.default_rng([seed, *b'/'.join(label.encode() for label in labels)])


@dataclass(frozen=True)
class Outcome:
    """What happened to one failure: `named` are the first names in `after` seconds."""

    rotor: int
    partner: int | None
    early: int  # alarms before the failure
    named: tuple[int, ...] = ()
    after: float = np.inf

    @property
    def right(self) -> bool:
        """The rotor alone was named."""
        return self.named == (self.rotor,)

    @property
    def arm(self) -> bool:
        """The arm of the rotor was named: the rotor, or both of a coaxial pair."""
        return self.rotor in self.named and set(self.named) <= {self.rotor, self.partner}

    @property
    def same_arm(self) -> bool:
        """The other rotor of the coaxial pair alone was named."""
        return self.partner is not None and self.named == (self.partner,)

    @property
    def wrong(self) -> bool:
        """A sound rotor was named, and not the arm of the rotor that failed."""
        return bool(self.named) and not self.arm


def failing(
    setup: Setup, name: str, condition: Condition, loss: str, seeds: range
) -> list[Outcome]:
    """Let a rotor fail in a flight of each seed; return what the detector named."""
    outcomes = []
    for seed in seeds:
        rng = rng_of(seed, setup.name, name, loss)
        rotor = seed % setup.vehicle.n
        landing = 'period' in condition.mission
        place = {} if landing else {'low': 40.0, 'high': 50.0}
        at = rng.uniform(*(LIFTED if landing else LOST))
        failure = {**place, **LOSSES[loss], 'rotor': rotor, 'time': at}
        duration = LOST[1] + NAMED + 3.0
        truth, mission = condition.draw(setup.model, rng, duration, failure)
        rows = Plant(setup.model, truth, mission, int(rng.integers(2**63))).fly(duration)
        outcome = outcome_of(setup, rows, rotor, truth)
        if outcome is not None:
            outcomes.append(outcome)
    return outcomes


def outcome_of(setup: Setup, rows: Rows, rotor: int, truth: Any = None) -> Outcome | None:
    """Return what the detector names in a flight; None if its rotor did not fail.

    `truth`: see `Setup.detector`.
    """
    failed = np.flatnonzero(rows['failed'])
    if not len(failed):
        return None
    begin = int(failed[0])
    rows = rows[:begin + round(NAMED / PERIOD) + 1]
    found = list(namings(setup.detector(truth), rows, setup.vehicle.n, setup.force))
    early = sum(i < begin for i, _ in found)
    after = next(((i, names) for i, names in found if i >= begin), None)
    parts = (after[1], (after[0] - begin) * PERIOD) if after else ()
    return Outcome(rotor, setup.partner(rotor), early, *parts)


POOLED = 'usual', 'turbulence', 'aggressive'
"""The conditions of which the hours are added."""


def fly(job: Job) -> tuple[tuple[str, str, str], Count | list[Outcome]]:
    """Fly a job, whose kind is that of a failure ('': none); return its key and what was found."""
    vehicle, name, loss, seeds, options = job
    setup, condition = Setup.load(vehicle, **options), {**CAUSES, **FLOWN, **CONTACTS}[name]
    key = vehicle, name, loss
    if loss:
        return key, failing(setup, name, condition, loss, seeds)
    return key, healthy(setup, name, condition, seeds)
