"""Piecewise affine solutions, learned piece by piece."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array
from ca_ros.solver.critical_region import AffineLaw

LAWS_MAX = 512
"""How many laws are kept; the exact allocation of the paper's hexarotor has 37."""

GROWTH = 8
"""Room is made for so many laws at a time."""


class AffineLaws:
    """Remembers affine laws as they are met, and looks them up.

    The last law is tried first, for the next command is likely to be in the same region; then all
    of them in one product; then a new one is learned.  Which laws are known has no influence on
    the answers beyond rounding.

    Parameters
    ----------
    n : int
        Number of thrusts.
    learn : callable
        Returns the thrusts (n,) for a wrench (m,), and the law of the region around it, or None
        where there is none.

    Attributes
    ----------
    last : AffineLaw or None
        The law by which the last wrench was answered.
    proven : bool
        Whether that answer needs no judgement any more.
    """

    def __init__(self, n: int, learn: Callable[[Array], tuple[Array, AffineLaw | None]]) -> None:
        self._n, self._learn = n, learn
        self.last: AffineLaw | None = None
        self.proven = False
        self._laws: list[AffineLaw] = []
        self._served: Counter[AffineLaw] = Counter()
        self._next = 0
        self._rows: Array = np.empty((0, 0))
        self._sides: Array = np.empty(0)

    def __len__(self) -> int:
        """Return the number of laws that are known."""
        return len(self._laws)

    def find(self, u: Array) -> Array | None:
        """Return the thrusts (n,) for a wrench (m,); None if its law is not known."""
        law = self.last
        if law is None:
            return None
        thrusts = law.thrusts(u)
        if thrusts is None:
            # Bytes are searched faster than arrays are reduced.
            found = (self._rows.dot(u) <= self._sides).tobytes().find(self._all_true)
            if found < 0:
                return None
            law = self.last = self._laws[found // self._block]
            thrusts = law.thrusts(u)
        if thrusts is None:
            self.proven = False
            return law.clipped(u)
        self.proven = law.proven
        return thrusts

    def find_or_learn(self, u: Array) -> Array:
        """Return the thrusts (n,) for a wrench (m,)."""
        thrusts = self.find(u)
        return self._learn_at(u) if thrusts is None else thrusts

    def _learn_at(self, u: Array) -> Array:
        thrusts, law = self._learn(u)
        self.proven = False
        if law is not None:
            found, served = law.served(u[:, None])
            # A law of great numbers may not even serve the wrench at which it was learned.
            if len(found):
                self._keep(law)
                return served[:, 0]
        return thrusts

    def find_batch(self, wrenches: Array) -> Array:
        """Return the thrusts (N, n) for wrenches (N, m); NaN where no law is known."""
        thrusts = np.full((len(wrenches), self._n), np.nan)
        self._fill(self._laws, wrenches, thrusts, np.arange(len(wrenches)))
        return thrusts

    def find_or_learn_batch(self, wrenches: Array) -> Array:
        """Return the thrusts (N, n) for wrenches (N, m)."""
        thrusts = self.find_batch(wrenches)
        left = np.flatnonzero(np.isnan(thrusts[:, 0]))
        while len(left):
            first, left = left[0], left[1:]
            before = self.last
            thrusts[first] = self._learn_at(wrenches[first])
            if self.last is not None and self.last is not before:
                left = self._fill([self.last], wrenches, thrusts, left)
        return thrusts

    def _fill(
        self, laws: list[AffineLaw], wrenches: Array, thrusts: Array, left: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Fill in the thrusts of the wrenches that are left where one of the laws serves them.

        Return those that are left then.
        """
        # One column a wrench: sums over the rows of an array are faster than over its columns.
        rest = np.ascontiguousarray(wrenches[left].T)
        unserved = np.ones(len(left), dtype=bool)
        # Those that served most come first, so that little is left for the others.
        for law in sorted(laws, key=self._served.__getitem__, reverse=True):
            found, served = law.served(rest)
            if not len(found):
                continue
            self._served[law] += len(found)
            thrusts[left[found]] = served.T
            unserved[found] = False
            # To close the gaps costs more than to look at some wrenches once more.
            if np.count_nonzero(unserved) < 0.8 * len(left):
                left, rest = left[unserved], rest[:, unserved]
                unserved = np.ones(len(left), dtype=bool)
        return left[unserved]

    def _keep(self, law: AffineLaw) -> None:
        """Remember a law; where there are too many, the oldest is forgotten for it."""
        i = self._next
        self._next = (i + 1) % LAWS_MAX
        if i == len(self._laws):
            self._laws.append(law)
        else:
            self._served.pop(self._laws[i], None)
            self._laws[i] = law
        n, m = law.slope.shape
        # Each law has a block of inequalities ``row u <= side`` for its region, closed by one that
        # never holds: where the others of a block hold, but nowhere else, as many in a row do.
        self._block = 2 * n + 1
        if i * self._block == len(self._sides):
            # In the order of columns, in which the product takes half as long.
            rows = np.zeros((len(self._sides) + GROWTH * self._block, m), order='F')
            rows[: len(self._sides)] = self._rows.reshape(-1, m)
            self._rows = rows
            self._sides = np.append(self._sides, np.full(GROWTH * self._block, -1.0))
        place = i * self._block
        self._rows[place : place + n] = law.slope
        self._rows[place + n : place + 2 * n] = -law.slope
        self._sides[place : place + n] = law.greatest - law.offset
        self._sides[place + n : place + 2 * n] = law.offset - law.least
        self._all_true = bytes([True] * (2 * n))
        self.last = law
