"""Sums of impulses and thrusts over windows of time that end now."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array

BLOCK = 0.0095  # least length of a block [s]
LENGTH = 34  # blocks that are kept: of this length or longer they cover the longest window
WINDOWS = np.array([0.04, 0.06, 0.08, 0.12, 0.16, 0.24, 0.32])  # lengths [s]


class Windows:
    """Sums over T windows of blocks, of about a hundredth of a second each, the last one new.

    - `block`: length of the last block [s]
    - `ages` (T,): length of each window [s]
    - `lacked` (T, 6): the unexplained impulse [N s, N m s]
    - `given` (T, n): the integral of the thrust of each rotor, as if it were sound [N s]
    - `change` (T, n): by how much this thrust changed [N]
    """

    def __init__(self, n: int) -> None:
        self.block, self._usual, self._thrusts = 0.0, np.inf, np.zeros(n)
        # A row a block, the newest first: length, lacked, given, change.
        self._rows, self._row = np.zeros((LENGTH, 7 + 2 * n)), np.zeros(7 + 2 * n)

    def add(self, step: float, lacked: Array, thrusts: Array) -> bool:
        """Take a step [s], with its impulse (6,) and thrusts (n,); return whether it ends a block.
        """
        rows, row, n = self._rows, self._row, len(thrusts)
        row[0] += step
        row[1:7] += lacked
        row[7 : 7 + n] += step * thrusts
        if row[0] < BLOCK:
            return False
        self.block = float(row[0])
        row[7 + n :], self._thrusts = thrusts - self._thrusts, thrusts
        rows[1:], rows[0] = rows[:-1], row
        row[:] = 0.0
        if not 0.9 < self.block / self._usual < 1.1:
            self._usual = self.block
            self._blocks = np.clip(np.rint(WINDOWS / self.block).astype(int), 1, LENGTH)
            self._of = (np.arange(LENGTH) < self._blocks[:, None]).astype(float)
        sums = self._of @ rows
        self.ages, self.lacked = sums[:, 0], sums[:, 1:7]
        self.given, self.change = sums[:, 7 : 7 + n], sums[:, 7 + n :]
        return True

    def forget(self, before: int | None = None) -> None:
        """Forget all blocks, or those before a window."""
        kept = 0 if before is None else self._blocks[before]
        self._rows[kept:] = self._row[:] = 0.0

    def explain(self, rotor: int, share: float, wrench: Array) -> None:
        """Explain what is lacked by the lost share of a rotor's thrust with this wrench (6,)."""
        self._rows[:, 1:7] += np.outer(share * self._rows[:, 7 + rotor], wrench)
