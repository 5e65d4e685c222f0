"""The modes of a node: real time follows the clock, lockstep the stamps of the states."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from math import inf
from time import monotonic_ns
from typing import Any

import numpy as np

from ca_ros.allocation.rates import PERIOD_MAX
from ca_ros.arrays import Array
from ca_ros.nodes.topics import DEPTH

PERIOD_MAX_NS = round(1e9 * PERIOD_MAX)
REMEMBERED = 50  # newest questions whose late copies are known


class RealTime:
    """A node follows the clock: it serves the newest message, and what it is told holds at once.

    - `name`: the parameter `mode`
    - `clocked`: whether timeouts count and old messages are left out; otherwise each message
      counts, and time passes by the stamps of the states alone
    """

    name, clocked = 'realtime', True

    def __init__(self) -> None:
        # Before the first command the rotors have all the time that counts.
        self._moment = -PERIOD_MAX_NS
        self._published = monotonic_ns() - PERIOD_MAX_NS

    def take(self, stamp: int, what: str, act: Callable[[], object]) -> bool:
        """Do what a message asks for from its stamp on [ns]; return whether it is taken."""
        act()
        return True

    def advance(self, time: int) -> None:
        """Do what was asked for until the time of a state [ns], before the state is answered."""

    def values(self) -> Mapping[str, object]:
        """Return what waits for its stamp, for the diagnostics."""
        return {}

    def waits(self, time: int, health: int) -> bool:
        """Return whether a state [ns] waits for the health with its stamp; the newest has one."""
        return False

    def lacks_answer(self, time: int, health: int) -> bool:
        """Return whether this health says that its giver lacks the answer to a state [ns]."""
        return False

    def recall(self, time: int, question: Hashable, by: object) -> Any:
        """Return the answer to a question that came before at a time [ns], else None."""
        return None

    def remember(self, question: Hashable, by: object, answer: Any) -> None:
        """Note the answer to a question, and who gave it."""

    def previous(self, last: Array, moment: int, idle: Array) -> tuple[Array, int]:
        """Return the command before a moment [ns], and the time since then [ns].

        `last` is the last command, and `idle` that of rotors that were not commanded yet.
        """
        elapsed = moment - self._moment
        # A clock that stands still, or runs back, says nothing of what rotors reach.
        return last, elapsed if elapsed > 0 else monotonic_ns() - self._published

    def commanded(self, moment: int | None = None) -> None:
        """Note that a command went out, for a moment [ns] unless it was a timeout action."""
        self._published = monotonic_ns()
        if moment is not None:
            self._moment = moment


class Lockstep(RealTime):
    """A node answers each state once, and the clock does not matter.

    A message that holds from a stamp on is kept until the state of this stamp comes; at most
    `DEPTH` are.  A copy of a question has the same answer, although parameters may have
    changed since: whether a copy comes depends on the clock, and must not change what the node
    remembers.

    `await_health`: whether a state waits for the health with its stamp.
    """

    name, clocked = 'lockstep', False

    def __init__(self, await_health: bool = False) -> None:
        super().__init__()
        self._await_health = await_health
        self._time = 0
        self._later: dict[tuple[int, str], Callable[[], object]] = {}
        self._due = inf
        self._answers: dict[Hashable, tuple[object, Any]] = {}
        self._before = np.empty(0), self._moment

    def take(self, stamp: int, what: str, act: Callable[[], object]) -> bool:
        """Do it at once without a stamp, or with that of a state that has come; else keep it."""
        if stamp <= self._time:
            act()
        elif len(self._later) >= DEPTH and (stamp, what) not in self._later:
            return False
        else:
            self._later[stamp, what] = act
            self._due = min(self._due, stamp)
        return True

    def advance(self, time: int) -> None:
        """Do what was kept until the time of a state [ns]."""
        self._time = time
        if time < self._due:
            return
        for key in sorted(key for key in self._later if key[0] <= time):
            self._later.pop(key)()
        self._due = min((stamp for stamp, _ in self._later), default=inf)

    def values(self) -> Mapping[str, object]:
        """Return what waits for its stamp, for the diagnostics."""
        if not self._later:
            return {}
        first = f'the first from {self._due / 1e9:g} s on'
        return {'kept for their stamps': f'{len(self._later)}, {first}'}

    def waits(self, time: int, health: int) -> bool:
        """Return whether a state [ns] waits for the health with its stamp; the newest has one."""
        return self._await_health and health < time

    def lacks_answer(self, time: int, health: int) -> bool:
        """Return whether this health says that its giver lacks the answer to a state [ns].

        An answered state has had its health: that comes once more only while the answer is missed.
        """
        return self._await_health and 0 <= health == time

    def recall(self, time: int, question: Hashable, by: object) -> Any:
        """Return the answer to a question that came before at a time [ns], else None.

        At time 0 another answerer (`by`) answers anew, because the flight begins again there.
        """
        before, answer = self._answers.get(question, (by, None))
        if time == 0 and before != by:
            self._answers.clear()
            return None
        return answer

    def remember(self, question: Hashable, by: object, answer: Any) -> None:
        """Note the answer to a question, and who gave it; only the newest are known."""
        self._answers[question] = by, answer
        if len(self._answers) > REMEMBERED:
            del self._answers[next(iter(self._answers))]

    def previous(self, last: Array, moment: int, idle: Array) -> tuple[Array, int]:
        """Return the command before a moment [ns], and the time since then [ns].

        A second wrench with the same stamp replaces the first.  At 0 a flight begins, maybe after
        a reset of the simulator.
        """
        if moment != self._moment:
            self._before = last, self._moment
        if moment == 0:
            self._before = idle, -PERIOD_MAX_NS
        command, before = self._before
        return command, moment - before


def mode_of(settings: Any) -> RealTime:
    """Return the mode that the settings of a node ask for; without such a setting real time."""
    if getattr(settings, 'mode', RealTime.name) == RealTime.name:
        return RealTime()
    return Lockstep(getattr(settings, 'await_health', False))
