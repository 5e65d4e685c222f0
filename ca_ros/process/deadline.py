"""A deadline that excludes stalls of the machine."""

from __future__ import annotations

import time


class Deadline:
    """A time limit for a loop that polls; at most `POLL` of the time between two polls counts.

    A stall of the machine also stalls the process that the loop waits for, so it must not use up
    the time limit [s].
    """

    POLL = 0.5
    """Longest time between two polls that counts [s]."""

    def __init__(self, limit: float) -> None:
        self._left = limit
        self._polled = time.monotonic()

    def passed(self) -> bool:
        """Poll: return whether the deadline has passed."""
        now = time.monotonic()
        self._left -= min(now - self._polled, self.POLL)
        self._polled = now
        return self._left < 0.0
