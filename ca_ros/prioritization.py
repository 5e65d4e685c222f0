"""Lexicographic priorities: what to give up first when a wrench is not attainable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.least_norm import LeastNorm
from ca_ros.zonotope import Zonotope


class Prioritization:
    """Serve groups of axes in their order, each as far as those before it allow.

    The projection of the admissible set on the axes of the first k groups is a zonotope too, made
    by the same rows of Gamma.  With the earlier axes served, group k moves on a straight line
    towards its demand, and a step in that zonotope says how far it gets.  The line begins at the
    reference, whose direction to the demand is thereby kept, or where that is out of reach by now,
    as near to the reference as the line from an attainable point leads.  For a group of one axis
    this is the attainable value that is nearest to the demand.

    Parameters
    ----------
    gamma : (m, n) array
    lower, upper : (n,) arrays
        Bounds of the thrusts [N].
    reference : (m,) array
        In the admissible set [N, N m].
    groups : sequence of sequences of int
        Rows of gamma, the most important group first.
    """

    def __init__(
        self,
        gamma: Array,
        lower: Array,
        upper: Array,
        reference: Array,
        groups: Sequence[Sequence[int]],
    ) -> None:
        self.gamma, self.lower, self.upper, self.reference = gamma, lower, upper, reference
        self.groups = [np.array(group) for group in groups]
        self.prefixes = [np.concatenate(self.groups[: k + 1]) for k in range(len(groups))]
        center, generators = gamma @ (lower + upper) / 2.0, gamma * (upper - lower) / 2.0
        self.shadows = [Zonotope(center[rows], generators[rows]) for rows in self.prefixes]

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """Return the served wrench (m,) [N, N m] and the share (m,) of each axis's demand."""
        served, levels = self.reference.copy(), np.ones(len(u))
        for k, group in enumerate(self.groups):
            start = self._start(k, served)
            direction = np.zeros(len(self.prefixes[k]))
            direction[-len(group) :] = u[group] - start[-len(group) :]
            levels[group] = min(self.shadows[k].reach(start, direction), 1.0)
            served[self.prefixes[k]] = start + levels[group[0]] * direction
        return served, levels

    def _start(self, k: int, served: Array) -> Array:
        """Return the point, over the axes of groups 0 to k, where group k begins its way."""
        rows, group, shadow = self.prefixes[k], self.groups[k], self.shadows[k]
        start = served[rows]
        start[-len(group) :] = self.reference[group]
        if k == 0 or shadow.margin(start) >= 0.0:
            return start
        attainable = served[rows]
        attainable[-len(group) :] = self.gamma[group] @ self._nearest_thrusts(
            self.prefixes[k - 1], served
        )
        return attainable + min(shadow.reach(attainable, start - attainable), 1.0) * (
            start - attainable
        )

    def _nearest_thrusts(self, rows: Array, served: Array) -> Array:
        """Return the thrusts next to the middle of their range that serve the axes in `rows`."""
        middle = (self.lower + self.upper) / 2.0
        least = LeastNorm(self.gamma[rows], self.lower - middle, self.upper - middle)
        return middle + least.solve(served[rows] - self.gamma[rows] @ middle, 1e-12)
