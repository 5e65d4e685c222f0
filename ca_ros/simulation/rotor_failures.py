"""Failures of rotors and servos in flight: when they happen, and when they are announced."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError
from ca_ros.vehicle.vehicle import Vehicle

LATEST = 1e6  # latest time of a failure or an announcement [s]
ANNOUNCE = 0.1  # default time from a failure to its announcement [s]

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
        share = f'={self.health:g}' if self.health else ''
        angle = share if self.angle is None else f'={self.angle:g}rad'
        return f'{self.rotor}@{self.time:g}{angle}'


@dataclass(frozen=True)
class RotorFailures:
    """The failures of a flight.

    `announce`: time from each failure to its announcement to allocator and controller [s]; None:
    never.
    """

    failures: tuple[RotorFailure, ...] = ()
    announce: float | None = ANNOUNCE

    def __post_init__(self) -> None:
        """Refuse two failures of a rotor at the same time."""
        seen = set()
        for failure in self.failures:
            if (key := (failure.rotor, _ns(failure.time))) in seen:
                raise ParameterError(
                    f'--fail {failure}: rotor {failure.rotor} fails twice at {failure.time:g} s'
                )
            seen.add(key)

    def check(self, vehicle: Vehicle) -> None:
        """Raise a ParameterError if the vehicle has not the rotors and servos that fail."""
        for failure in self.failures:
            if failure.rotor > vehicle.n:
                raise ParameterError(f'--fail {failure}: the vehicle has {vehicle.n} rotors')
            if failure.angle is not None:
                try:
                    vehicle.with_stuck_servo(failure.rotor, failure.angle)
                except ParameterError as error:
                    raise ParameterError(f'--fail {failure}: {error}') from None

    def times(self) -> list[int]:
        """Return the times of flight of all failures and announcements, in order [ns]."""
        delays = 0.0, self.announce or 0.0
        return sorted({_ns(each.time + delay) for each in self.failures for delay in delays})

    def moments(self, detected: Iterable[float] = ()) -> dict[str, list[float]]:
        """Return the times of flight [s] of failures, announcements and detections."""
        failed = [each.time for each in self.failures]
        announced = [] if self.announce is None else [time + self.announce for time in failed]
        return {'failure': failed, 'announced': announced, 'detected': list(detected)}

    def health(self, health: Array, time: int, told: bool = False) -> Array:
        """Return the health (n,) at a time of flight [ns] from that at the start.

        It is the actual one, or if `told` the announced one.
        """
        after = np.array(health, dtype=float)
        for each in self._past(time, told):
            if each.angle is None:
                after[each.rotor - 1] = each.health
        return after

    def values(
        self, health: Array, pairs: Numbers, time: int, told: bool
    ) -> tuple[list[float], list[float]]:
        """Return `rotors.health` and `rotors.stuck_servos` at a time of flight [ns].

        They come from those at the start, and are the actual ones, or if `told` the announced
        ones.
        """
        stuck = [] if pairs in (0.0, [0.0]) else np.ravel(pairs).tolist()
        for each in self._past(time, told):
            stuck += [] if each.angle is None else [float(each.rotor), each.angle]
        return self.health(health, time, told).tolist(), stuck or [0.0]

    def _past(self, time: int, told: bool) -> list[RotorFailure]:
        delay = self.announce if told else 0.0
        if delay is None:
            return []
        ordered = sorted(self.failures, key=lambda failure: failure.time)
        return [each for each in ordered if _ns(each.time + delay) <= time]


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
