"""Rotor failures in flight: when they happen, and when they are announced."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError

LATEST = 1e6  # latest time of a failure or an announcement [s]
ANNOUNCE = 0.1  # default time from a failure to its announcement [s]

FAILURE = re.compile(r'(?P<rotor>[0-9]+)@(?P<time>[^=]+)(=(?P<health>.+))?')


@dataclass(frozen=True)
class RotorFailure:
    """A rotor that fails.

    - `rotor`: number of the rotor, from 1
    - `time`: time of flight at which it fails [s]
    - `health`: thrust delivered over thrust expected after the failure: 0 if the rotor is lost
    """

    rotor: int
    time: float
    health: float = 0.0

    @classmethod
    def parse(cls, text: str) -> RotorFailure:
        """Read ``ROTOR@TIME`` or ``ROTOR@TIME=HEALTH``; a ValueError names what is wrong."""
        found = FAILURE.fullmatch(text)
        try:
            if found is None:
                raise ValueError
            rotor, time = int(found['rotor']), float(found['time'])
            health = float(found['health'] or 0.0)
        except ValueError:
            raise ValueError(
                f'{text!r}: expected ROTOR@TIME or ROTOR@TIME=HEALTH, such as 1@2.5 or 1@2.5=0.4'
            ) from None
        if rotor < 1:
            raise ValueError(f'{text!r}: rotors are numbered from 1 on')
        if not 0.0 <= time <= LATEST:
            raise ValueError(f'{text!r}: expected a time from 0 to {LATEST:g} s')
        if not 0.0 <= health <= 1.0:
            raise ValueError(f'{text!r}: expected a health in [0, 1]')
        return cls(rotor, time, health)

    def __str__(self) -> str:
        """Return the failure as on a command line."""
        return f'{self.rotor}@{self.time:g}' + (f'={self.health:g}' if self.health else '')


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

    def check(self, rotors: int) -> None:
        """Raise a ParameterError if a failing rotor has a number above the number of rotors."""
        for failure in self.failures:
            if failure.rotor > rotors:
                raise ParameterError(f'--fail {failure}: the vehicle has {rotors} rotors')

    def times(self) -> list[int]:
        """Return the times of flight of all failures and announcements, in order [ns]."""
        late = [] if self.announce is None else [0.0, self.announce]
        delays = late or [0.0]
        return sorted({_ns(each.time + delay) for each in self.failures for delay in delays})

    def moments(self, detected: Iterable[float] = ()) -> dict[str, list[float]]:
        """Return the times of flight [s] of failures, announcements and detections."""
        failed = [each.time for each in self.failures]
        announced = [] if self.announce is None else [time + self.announce for time in failed]
        return {'failure': failed, 'announced': announced, 'detected': list(detected)}

    def physical(self, health: Array, time: int) -> Array:
        """Return the actual health (n,) at a time of flight [ns] from that at the start."""
        return self._after(health, time, 0.0)

    def believed(self, health: Array, time: int) -> Array:
        """Return the announced health (n,) at a time of flight [ns] from that at the start."""
        return health if self.announce is None else self._after(health, time, self.announce)

    def _after(self, health: Array, time: int, delay: float) -> Array:
        after = np.array(health, dtype=float)
        for each in sorted(self.failures, key=lambda failure: failure.time):
            if _ns(each.time + delay) <= time:
                after[each.rotor - 1] = each.health
        return after


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
