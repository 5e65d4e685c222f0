"""The messages of a flight, joined to samples by their stamps."""

from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.errors import CaRosError
from ca_ros.nodes.messages import pose_arrays, stamp_of, twist_arrays
from ca_ros.nodes.topics import POSE, SPEEDS, TILTS, VELOCITY, needed
from ca_ros.simulation.record import Flight

SAMPLED = (POSE, VELOCITY, SPEEDS)  # the topics of a sample; if rotors tilt, also `TILTS`

COLUMNS = ('position', 'attitude', 'velocity', 'angular_velocity', 'speeds')


class Samples:
    """The states and the rotor speeds of a vehicle, by their stamps [ns].

    `newest` has the newest stamp of each topic, `start` is the stamp at which the rotors start,
    None before, and `last` the newest stamp of a complete sample since then.
    """

    def __init__(self) -> None:
        self.newest: dict[str, int] = {}
        self.start: int | None = None
        self.last: int | None = None
        self._samples: dict[int, dict[str, Array]] = {}
        self._rotors: int | None = None
        self._columns: tuple[str, ...] = COLUMNS

    def add(self, topic: str, message: Any) -> None:
        """Add a message of one of these topics; ignore speeds and angles without a stamp.

        Raises a CaRosError if its stamp is earlier than the one before, or its numbers are not
        finite or not as many as the vehicle has rotors.
        """
        if (time := stamp_of(message)) is None:
            return
        parts = _parts(topic, message)
        if time < (before := self.newest.get(topic, time)):
            raise CaRosError(
                f'{topic}: stamp {time / 1e9:g} s after {before / 1e9:g} s: expected ascending')
        for numbers in parts.values():
            if not np.isfinite(numbers).all():
                raise CaRosError(
                    f'{topic} at {time / 1e9:g} s: {numbers.tolist()}: expected finite numbers')
        self.newest[topic] = time
        sample = self._samples.setdefault(time, {})
        sample.update(parts)
        if 'speeds' in parts:
            self._check_rotors(parts['speeds'])
            if parts['speeds'].any():
                self.begin(time)
        if self.start is not None and self._is_complete(sample):
            self.last = time if self.last is None else max(time, self.last)

    def begin(self, time: int) -> None:
        """Let the flight begin at a stamp [ns], unless it has begun."""
        if self.start is None:
            self.start = time

    def expect(self, rotors: int, servos: int = 0) -> None:
        """Refuse messages with another number of rotor speeds, also those of the past.

        With `servos`, a sample has tilt angles, too.
        """
        self._rotors = rotors
        angles = ('angles' for _ in needed((SPEEDS, TILTS), servos)[1:])
        self._columns = (*COLUMNS, *angles)
        for sample in self._samples.values():
            if 'speeds' in sample:
                self._check_rotors(sample['speeds'])

    def _check_rotors(self, speeds: Array) -> None:
        if self._rotors not in (None, len(speeds)):
            raise CaRosError(
                f'{SPEEDS.name} has {len(speeds)} rotor speeds: expected {self._rotors}, one for '
                'each rotor of the vehicle')

    def any_complete(self) -> bool:
        """Return whether a state and rotor speeds have had the same stamp."""
        return any(map(self._is_complete, self._samples.values()))

    def _is_complete(self, sample: dict[str, Array]) -> bool:
        return sample.keys() >= {*self._columns}

    def answered(self, time: int) -> bool:
        """Return whether there are rotor speeds with a stamp [ns], after the start."""
        sample = self._samples.get(time, {})
        return self.start is not None and {'speeds', *self._columns[5:]} <= sample.keys()

    def state(self, time: int) -> tuple[Array, Array, Array, Array]:
        """Return the state with a stamp [ns]: see `Flight`."""
        sample = self._samples[time]
        position, attitude, velocity, angular_velocity = (sample[name] for name in COLUMNS[:4])
        return position, attitude, velocity, angular_velocity

    def forget(self, age: int) -> None:
        """Discard what is older than the newest message by more than an age [ns]."""
        oldest = max(self.newest.values(), default=0) - age
        self._samples = {time: part for time, part in self._samples.items() if time >= oldest}

    def flight(self, end: int, origin: int = 0) -> Flight:
        """Return the complete samples up to an end; times count from an origin [ns]."""
        start = self.start if self.start is not None else end + 1
        stamps = sorted(
            time for time, sample in self._samples.items()
            if start <= time <= end and self._is_complete(sample)
        )
        found = [self._samples[time] for time in stamps]
        columns = {name: np.array([sample[name] for sample in found]) for name in self._columns}
        return Flight((np.array(stamps) - origin) / 1e9, **columns)


def _parts(topic: str, message: Any) -> dict[str, Array]:
    """Return what a message adds to a sample."""
    if isinstance(message, SPEEDS.kind):
        return {'angles' if topic == TILTS.name else 'speeds': np.array(message.data)}
    names, arrays = COLUMNS[2:4], twist_arrays
    if isinstance(message, POSE.kind):
        names, arrays = COLUMNS[:2], pose_arrays
    return dict(zip(names, arrays(message), strict=True))
