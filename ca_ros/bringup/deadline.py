"""A time limit that does not run out while the machine stands still."""

from __future__ import annotations

import time


class Patience:
    """A time limit that runs only while it is looked at, as in a loop that polls.

    Where the machine has stood still for a while, so has what is waited for.

    Parameters
    ----------
    limit : float
        Time until it is over [s].
    """

    LOOK = 0.5
    """Of the time between two looks no more than this counts [s]."""

    def __init__(self, limit: float) -> None:
        self._left = limit
        self._seen = time.monotonic()

    def over(self) -> bool:
        """Look whether the time is over."""
        now = time.monotonic()
        self._left -= min(now - self._seen, self.LOOK)
        self._seen = now
        return self._left < 0.0
