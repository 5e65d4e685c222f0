"""The faults of a link between nodes: losses, duplicates, delays, reordering, damage."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from heapq import heappop, heappush
from itertools import count
from math import copysign, inf, nan
from typing import Any, Generic, NamedTuple, TypeVar

from std_msgs.msg import Float64MultiArray

from ca_ros.nodes import topics
from ca_ros.settings import Numbers, ParameterError, Settings, Words, setting
from ca_ros.vehicle.validation import repeated

Message = TypeVar('Message')

# ROS would read the words nan and inf as numbers.
_OF_A_NUMBER = ('not_a_number', 'infinite', 'huge', 'sign')
CORRUPTIONS = (*_OF_A_NUMBER, 'length', 'frame')  # kinds of damage to number, array and frame

LINK_NAMES = tuple(topic.name for topic in topics.LINKS)

FAULTY = (*topics.LINKS, topics.TILT_COMMAND)

LINK_CORRUPTIONS: dict[str, tuple[str, ...]] = {
    topic.name: (*_OF_A_NUMBER, 'length' if topic.kind is Float64MultiArray else 'frame')
    for topic in FAULTY
}
"""The corruptions of each topic: arrays have no frame, and other types have no length."""

HUGE = 1e12


@dataclass(frozen=True, kw_only=True)
class FaultSettings(Settings):
    """The faults of the links; shares and times are given once, or for each topic."""

    topics: Words = setting(
        list(LINK_NAMES), 'topics that are faulty; command/tilt_angle has the faults of '
        'command/motor_speed, unless it is named', choices=tuple(LINK_CORRUPTIONS))
    seed: int = setting(0, 'the faults of a message depend on seed, topic and number')
    drop: Numbers = setting(
        0.0, 'share of the messages that are lost', minimum=0.0, maximum=1.0, mutable=True)
    duplicate: Numbers = setting(
        0.0, 'share that is sent twice', minimum=0.0, maximum=1.0, mutable=True)
    reorder: Numbers = setting(
        0.0, 'share that is sent after the next message', minimum=0.0, maximum=1.0, mutable=True)
    corrupt: Numbers = setting(
        0.0, 'share that is damaged', minimum=0.0, maximum=1.0, mutable=True)
    delay: Numbers = setting(
        0.0, 'delay of each message', unit='s', minimum=0.0, maximum=60.0, mutable=True)
    jitter: Numbers = setting(
        0.0, 'greatest random addition to the delay', unit='s', minimum=0.0, maximum=60.0,
        mutable=True)
    corruptions: Words = setting(
        list(CORRUPTIONS), 'kinds of damage; each topic has those that its type allows',
        choices=CORRUPTIONS, mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        names = _listed(self.topics)
        if not names or len({*names}) < len(names):
            raise ParameterError(f'topics: expected different topics, got {names}')
        for name in AMOUNTS:
            repeated(name, getattr(self, name), len(names), 'topic')

    def links(self) -> dict[str, FaultSettings]:
        """Return the settings of each topic."""
        names, kinds = _listed(self.topics), _listed(self.corruptions)
        found = {}
        for i, topic in enumerate(names):
            own: dict[str, Any] = {
                name: float(repeated(name, getattr(self, name), len(names))[i]) for name in AMOUNTS
            }
            if fitting := [kind for kind in LINK_CORRUPTIONS[topic] if kind in kinds]:
                own['corruptions'] = fitting
            else:
                own['corrupt'] = 0.0
            found[topic] = replace(self, topics=topic, **own)
        if speeds := found.get(topics.SPEED_COMMAND.name):
            tilts = topics.TILT_COMMAND.name
            found.setdefault(tilts, replace(speeds, topics=tilts))
        return found

    @property
    def active(self) -> dict[str, float]:
        """Shares and times of one topic that are not zero, by name."""
        return {name: getattr(self, name) for name in AMOUNTS if getattr(self, name)}

    def fate(self, k: int) -> Fate:
        """Return the fate of message k of one topic, which depends on no other message.

        Each fault has its own random number.  A message that is lost at one rate is therefore lost
        at every greater rate, independently of the other faults.
        """
        # The numbers, the same on every machine, depend on the digits of a seed with a point.
        words = f'{float(self.seed)!r} {self.topics} {k}'
        drop, duplicate, reorder, corrupt, kind, place, jitter = (
            (word >> 11) * 2.0**-53
            for word in struct.unpack('<7Q8x', blake2b(words.encode()).digest())
        )
        given: Any = self
        if drop < given.drop:
            return Fate(copies=0)
        copies, delay = 1 + (duplicate < given.duplicate), given.delay + jitter * given.jitter
        hit = corrupt < given.corrupt
        corruption = given.corruptions[int(kind * len(given.corruptions))] if hit else None
        return Fate(copies, delay, reorder < given.reorder, corruption, place)


AMOUNTS = ('drop', 'duplicate', 'reorder', 'corrupt', 'delay', 'jitter')
"""The settings that are given once, or for each topic."""


FAULT_KINDS = ('dropped', 'duplicated', 'delayed', 'reordered', 'corrupted')
"""The names under which the faults of messages are counted."""


class Fate(NamedTuple):
    """The faults of one message.

    It is sent `copies` times: not at all if it is lost, twice if it is duplicated; after a delay
    [s]; after the next message if it is `overtaken`.  The corruption is one of `CORRUPTIONS`;
    `place` is the index of the corrupted number over the number of numbers, in [0, 1).
    """

    copies: int = 1
    delay: float = 0.0
    overtaken: bool = False
    corruption: str | None = None
    place: float = 0.0

    @property
    def kinds(self) -> list[str]:
        """The names of the faults of the message."""
        twice, late, damaged = self.copies > 1, self.delay > 0.0, self.corruption is not None
        happens = not self.copies, twice, late, self.overtaken, damaged
        return [kind for kind, fault in zip(FAULT_KINDS, happens, strict=True) if fault]


def _listed(words: str | Sequence[str]) -> list[str]:
    return [words] if isinstance(words, str) else list(words)


def corrupted(numbers: list[float], corruption: str, place: float) -> list[float]:
    """Return the numbers of a message after a corruption."""
    if corruption == 'length':
        return numbers[:-1] if place < 0.5 and numbers else [*numbers, 0.0]
    if not numbers or corruption == 'frame':
        return numbers
    i = int(place * len(numbers))
    value = numbers[i]
    wrong = {
        'not_a_number': nan, 'infinite': copysign(inf, value), 'huge': copysign(HUGE, value),
        'sign': -value,
    }[corruption]
    return [*numbers[:i], wrong, *numbers[i + 1 :]]


class Link(Generic[Message]):
    """A link that delays and reorders messages."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, Message]] = []
        self._overtaken: list[tuple[float, Message]] = []
        self._order = count()

    def __len__(self) -> int:
        """Return the number of messages that are held back."""
        return len(self._waiting) + len(self._overtaken)

    @property
    def due(self) -> float:
        """The time at which the next message is due [s]; infinity if there is none."""
        return self._waiting[0][0] if self._waiting else inf

    def put(self, message: Message, fate: Fate, now: float) -> None:
        """Accept a message at a time [s], and the messages that it overtakes after it."""
        due = now + fate.delay
        copies = [(due, message)] * fate.copies
        late = [(max(due, own), each) for own, each in self._overtaken]
        self._overtaken = copies if fate.overtaken else []
        for time, each in late if fate.overtaken else copies + late:
            heappush(self._waiting, (time, next(self._order), each))

    def take(self, now: float) -> list[Message]:
        """Return the messages that are due by a time [s]."""
        taken = []
        while self._waiting and self.due <= now:
            taken.append(heappop(self._waiting)[2])
        return taken
