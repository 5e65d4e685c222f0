"""The answers of a node in lockstep, where late copies of a question may come."""

from collections.abc import Hashable
from typing import Any

KEPT = 50  # newest questions whose late copies are known


class Answers:
    """The newest questions of a flight in lockstep, with their answers.

    A copy of a question has the same answer, although parameters may have changed since: whether
    a copy comes depends on the clock, and must not change what the node remembers.
    """

    def __init__(self) -> None:
        self._kept: dict[Hashable, tuple[object, Any]] = {}

    def again(self, time: int, question: Hashable, by: object) -> Any:
        """Return the answer to a question that came before at a time [ns], else None.

        At time 0 another answerer (`by`) answers anew, because the flight begins again there.
        """
        before, answer = self._kept.get(question, (by, None))
        if time == 0 and before != by:
            self._kept.clear()
            return None
        return answer

    def keep(self, question: Hashable, by: object, answer: Any) -> None:
        """Keep the answer to a question."""
        self._kept[question] = by, answer
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
