"""Failures of rotors and servos in flight: when they happen, and when they are announced."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

LATEST = 1e6  # latest time of a failure or an announcement [s]
ANNOUNCE = 0.1  # default time from a failure to its announcement [s]
NONE = 'none'  # the value of `simulator.failures` without failures

FAILURE = re.compile(r'(?P<rotor>[0-9]+)@(?P<time>[^=]+)(=((?P<angle>.+)rad|(?P<health>.+)))?')


@dataclass(frozen=True)
class RotorFailure:
    """A rotor that fails, or whose servo sticks.

    - `rotor`: number of the rotor, from 1
    - `time`: time of flight at which it fails [s]
    - `health`: thrust delivered over thrust expected after the failure: 0 if the rotor is lost
    - `angle`: angle at which the servo sticks [rad]; None: the rotor fails
    """

    rotor: int
    time: float
    health: float = 0.0
    angle: float | None = None

    @classmethod
    def parse(cls, text: str) -> RotorFailure:
        """Read ``ROTOR@TIME``, ``ROTOR@TIME=HEALTH``, or ``ROTOR@TIME=ANGLErad`` of a servo.

        Raises a ValueError that names what is wrong.
        """
        found = FAILURE.fullmatch(text)
        try:
            if found is None:
                raise ValueError
            rotor, time = int(found['rotor']), float(found['time'])
            health = float(found['health'] or 0.0)
            angle = None if found['angle'] is None else float(found['angle'])
        except ValueError:
            raise ValueError(
                f'{text!r}: expected ROTOR@TIME or ROTOR@TIME=HEALTH, such as 1@2.5 or 1@2.5=0.4, '
                'or the angle of a servo that sticks, such as 1@2.5=0.4rad'
            ) from None
        if rotor < 1:
            raise ValueError(f'{text!r}: rotors are numbered from 1 on')
        if not 0.0 <= time <= LATEST:
            raise ValueError(f'{text!r}: expected a time from 0 to {LATEST:g} s')
        if not 0.0 <= health <= 1.0:
            raise ValueError(f'{text!r}: expected a health in [0, 1]')
        return cls(rotor, time, health, angle)

    def __str__(self) -> str:
        """Return the failure as on a command line."""
        share = f'={_text(self.health)}' if self.health else ''
        angle = share if self.angle is None else f'={_text(self.angle)}rad'
        return f'{self.rotor}@{_text(self.time)}{angle}'


@dataclass(frozen=True)
class RotorFailures:
    """The failures of a flight.

    `announce`: time from each failure to its announcement to allocator and controller [s]; None:
    never.
    """

    failures: tuple[RotorFailure, ...] = ()
    announce: float | None = ANNOUNCE

    @classmethod
    def read(
        cls, words: str | Sequence[str], announce: float | None = ANNOUNCE
    ) -> RotorFailures:
        """Read failures from texts, see `RotorFailure.parse`, or from `NONE`.

        Raises a ParameterError if a text is wrong, or two failures are at the same time.
        """
        texts = [words] if isinstance(words, str) else [*words]
        try:
            found = [] if texts == [NONE] else map(RotorFailure.parse, texts)
            return cls(tuple(found), announce)
        except ValueError as error:
            raise ParameterError(str(error)) from None

    def __post_init__(self) -> None:
        """Refuse two failures of a rotor at the same time."""
        seen = set()
        for failure in self.failures:
            if (key := (failure.rotor, _ns(failure.time))) in seen:
                raise ParameterError(
                    f'{failure}: rotor {failure.rotor} fails twice at {_text(failure.time)} s'
                )
            seen.add(key)

    @property
    def words(self) -> list[str]:
        """The value of `simulator.failures`, see `read`."""
        return [*map(str, self.failures)] or [NONE]

    def check(self, vehicle: Vehicle) -> None:
        """Raise a ParameterError if the vehicle has not the rotors and servos that fail."""
        for failure in self.failures:
            if failure.rotor > vehicle.n:
                raise ParameterError(f'{failure}: the vehicle has {vehicle.n} rotors')
            if failure.angle is not None:
                try:
                    vehicle.with_stuck_servo(failure.rotor, failure.angle)
                except ParameterError as error:
                    raise ParameterError(f'{failure}: {error}') from None

    @property
    def times(self) -> list[int]:
        """The times of flight of the failures, in order [ns]."""
        return sorted({_ns(each.time) for each in self.failures})

    @property
    def announced_times(self) -> list[int]:
        """The times of flight of the announcements, in order [ns]."""
        if (delay := self.announce) is None:
            return []
        return sorted({_ns(each.time + delay) for each in self.failures})

    def moments(self, detected: Iterable[float] = ()) -> dict[str, list[float]]:
        """Return the times of flight [s] of failures, announcements and detections."""
        failed = [each.time for each in self.failures]
        announced = [] if self.announce is None else [time + self.announce for time in failed]
        return {'failure': failed, 'announced': announced, 'detected': list(detected)}

    def after(self, vehicle: Vehicle, time: int) -> Vehicle:
        """Return the vehicle that starts a flight as it is at a time of flight [ns]."""
        return _failed(vehicle, self._until(time, 0.0))

    def known(self, vehicle: Vehicle, time: int) -> Vehicle:
        """Return the vehicle that starts a flight as it is announced at a time of flight [ns].

        What is announced makes no rotor sounder than it was at the start.
        """
        announced = _failed(vehicle.intact, self._until(time, self.announce))
        return announced.with_health(np.minimum(announced.health, vehicle.health))

    def announced(self, n: int, time: int) -> tuple[Array, dict[int, float]]:
        """Return what is announced until a time of flight [ns].

        It is the health (n,) of n rotors, and by rotor, from 1, the angle [rad] at which its servo
        sticks.
        """
        past = self._until(time, self.announce)
        stuck = {each.rotor: each.angle for each in past if each.angle is not None}
        return _health(np.ones(n), past), stuck

    def _until(self, time: int, delay: float | None) -> list[RotorFailure]:
        if delay is None:
            return []
        ordered = sorted(self.failures, key=lambda failure: failure.time)
        return [each for each in ordered if _ns(each.time + delay) <= time]


def _failed(vehicle: Vehicle, failures: Sequence[RotorFailure]) -> Vehicle:
    if not failures:
        return vehicle
    for each in failures:
        if each.angle is not None:
            vehicle = vehicle.with_stuck_servo(each.rotor, each.angle)
    return vehicle.with_health(_health(vehicle.health, failures))


def _health(before: Array, failures: Iterable[RotorFailure]) -> Array:
    health = np.array(before, dtype=float)
    for each in failures:
        if each.angle is None:
            health[each.rotor - 1] = each.health
    return health


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _text(number: float) -> str:
    """Return the shortest text of a number."""
    short = f'{number:g}'
    return short if float(short) == number else repr(number)
