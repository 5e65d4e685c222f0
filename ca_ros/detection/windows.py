"""Sums of impulses over windows of time that end now."""

import numpy as np

from ca_ros.arrays import Array

BLOCK = 0.00943  # least length of a block [s]
HALF = 0.505
"""Share of a block that may be missing at the end of a window.  Of stamps at an even rate, such as
125 or 4000 Hz, rounding would decide with a half, and with a block of 0.0095 s; so times that are
compared with sums of blocks are not round either."""

LENGTH = 34  # blocks that are kept: of this length or longer they cover the longest window
ROOM = 8 * LENGTH  # rows, of which those that are kept move on
ROTORS = 9  # first column of what rotors give
WINDOWS = np.array([0.04, 0.08, 0.16, 0.24, 0.32])  # lengths, to half a block [s]


class Windows:
    """Sums over T windows of blocks, of about a hundredth of a second each, the last one new.

    Of n columns of what rotors give: force and torque in the body frame.

    - `block`: length of the last block [s]
    - `ages` (T,): length of each window [s]
    - `lacked` (T, 6): the unexplained impulse [N s, N m s]
    - `lateral` (T, 2): impulse of the drag along x and y [N s]
    """

    def __init__(self, n: int) -> None:
        self.block, self._last = 0.0, np.zeros((6, n))
        # A row a block, the newest first: length, lacked, lateral, given, change.
        self._all, self._newest = np.zeros((ROOM, ROTORS + 12 * n)), ROOM - LENGTH
        self._rows, self._row = self._all[self._newest :], np.zeros(ROTORS + 12 * n)
        self._lacked, self._lateral = self._row[1:7], self._row[7:ROTORS]
        self._given, self._change = self._row[ROTORS:].reshape(2, 6, n)

    def add(self, step: float, lacked: Array, lateral: Array, given: Array) -> bool:
        """Take a step [s]; return whether it ends a block.

        - `lacked` (6,): the unexplained impulse [N s, N m s]
        - `lateral` (2,): the drag along x and y [N]
        - `given` (6, n): what the rotors gave [N, N m]
        """
        self._row[0] += step
        self._lacked += lacked
        self._lateral += step * lateral
        self._given += step * given
        if self._row[0] < BLOCK:
            return False
        self.block = float(self._row[0])
        np.subtract(given, self._last, out=self._change)
        self._last = given
        if self._newest == 0:
            self._newest = ROOM - LENGTH
            self._all[self._newest + 1 :] = self._rows[:-1]
        else:
            self._newest -= 1
        self._rows = self._all[self._newest : self._newest + LENGTH]
        self._rows[0] = self._row
        self._row.fill(0.0)
        lengths = self._rows[:, 0]
        middles = np.append(0.0, lengths[:-1].cumsum()) + HALF * lengths
        middles[0] = 0.0
        self._blocks = middles.searchsorted(WINDOWS)
        self._of = (np.arange(LENGTH) < self._blocks[:, None]).astype(float)
        sums = self._of.dot(self._rows[:, :ROTORS])
        self.ages, self.lacked, self.lateral = sums[:, 0], sums[:, 1:7], sums[:, 7:]
        return True

    def rotors(self) -> tuple[Array, Array]:
        """Return what the rotors gave in each window, (T, 6, n) [N s, N m s], and its change.

        The change is [N, N m].
        """
        sums = (self._of @ self._rows[:, ROTORS:]).reshape(len(WINDOWS), 2, 6, -1)
        return sums[:, 0], sums[:, 1]

    def forget(self, before: int | None = None) -> None:
        """Forget all blocks, or those before a window."""
        kept = 0 if before is None else self._blocks[before]
        self._rows[kept:] = self._row[:] = 0.0

    @property
    def blocks(self) -> Array:
        """What the rotors gave in each block (L, 6, n) [N s, N m s]."""
        n = self._given.shape[1]
        return self._rows[:, ROTORS : ROTORS + 6 * n].reshape(LENGTH, 6, n)

    @property
    def laterals(self) -> Array:
        """The impulse of the drag in each block (L, 2) [N s]."""
        return self._rows[:, 7:ROTORS]

    def explain(self, given: Array) -> None:
        """Explain what is lacked in each block (L, 6) by what was not given [N s, N m s]."""
        self._rows[:, 1:7] += given
