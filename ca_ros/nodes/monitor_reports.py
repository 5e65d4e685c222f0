"""What monitors have found: of each start and of each reset the newest report."""

from collections.abc import Hashable, Iterable

import numpy as np
from std_msgs.msg import Float64MultiArray

from ca_ros.allocation.reconfiguration import Failures
from ca_ros.nodes.messages import RESET, failed_arms, fill_speeds, health_message, origin_of

MONITORS_MAX = 8
"""Origins that are known one by one; what older ones found is kept together."""

EARLIER = 'earlier'
"""What stands for the origin of older ones; no message has it."""


class MonitorReports:
    """The reports of monitors by their origin, the newest origin last: see `health_message`.

    A report replaces the one before of the same origin.  The first one of a reset ends those of
    all other origins, which stay known; what a monitor still holds it says again.
    """

    def __init__(self) -> None:
        self._found: dict[str, Failures] = {}
        self._word: tuple[str, Hashable] | None = None

    def has(self, origin: str, said: Failures) -> bool:
        """Return whether this is the newest report of its origin."""
        before = self._found.get(origin)
        return before is not None and said.key == before.key

    def take(self, origin: str, said: Failures) -> None:
        """Take a report."""
        if origin.startswith(RESET) and origin not in self._found:
            self._found = {each: none_of(said) for each in self._found}
        self._found[origin] = said
        if len(self._found) > MONITORS_MAX:
            # A reset that is not known would count anew, so starts are put together first.
            older = [*self._found][:-1]
            starts = [each for each in older if not each.startswith(RESET)]
            first, second, *_ = starts if len(starts) > 1 else older
            both = least([self._found.pop(first), self._found.pop(second)])
            self._found = {EARLIER: both, **self._found}

    @property
    def others(self) -> list[Failures]:
        """The reports of all but the newest origin."""
        return [*self._found.values()][:-1]

    @property
    def together(self) -> Failures:
        """What all found."""
        return least(self._found.values())

    def word_to_newest(self) -> Float64MultiArray | None:
        """Return the message to the newest origin of what others found; None: it has no news.

        By this, the others hear of a reset.
        """
        newest, said = [*self._found.items()][-1]
        health, arms, _ = others = least([none_of(said), *self.others])
        word = newest, others.key
        # Who has started late knows nothing, and the newest one may have been told more.
        knows = self._word is not None or newest.startswith(RESET) or health.min() < 1.0
        if word == self._word or not knows:
            return None
        self._word = word
        return fill_speeds(health_message(health, arms, newest), health, None)


def report_of(message: Float64MultiArray) -> tuple[str, Failures]:
    """Return the origin and the report of a `health_message`."""
    return origin_of(message), Failures(np.array(message.data), failed_arms(message), {})


def none_of(said: Failures) -> Failures:
    """Return that nothing has failed of what a report is about."""
    return Failures(np.ones_like(said.health), (), {})


def least(reports: Iterable[Failures]) -> Failures:
    """Return what reports say together: the least health of each rotor, and all arms.

    An arm counts no more where a later report tells which of its rotors has failed.
    """
    found, shares, arms = [*reports], [], dict[tuple[int, int], None]()
    for k, each in enumerate(found):
        health = each.health.copy()
        for arm in each.arms:
            pair = [i - 1 for i in arm]
            told = [later.health[pair] for later in found[k + 1:] if arm not in later.arms]
            lowest = np.min([np.ones(2), *told], axis=0)
            if (lowest < 1.0).any():
                health[pair] = np.where(lowest < 1.0, health[pair], 1.0)
            else:
                arms[arm] = None
        shares.append(health)
    return Failures(np.min(shares, axis=0), tuple(arms), {})
