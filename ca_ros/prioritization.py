"""Lexicographic priorities: what to give up first when a wrench is not attainable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ca_ros.allocation_problem import AllocationProblem
from ca_ros.arrays import Array
from ca_ros.least_norm import LeastNorm
from ca_ros.zonotope import Zonotope


class Prioritization:
    """Serve groups of axes in their order, each as far as those before it allow.

    The projection of the admissible set on the axes of the first k groups is a zonotope too, made
    by the same rows of Gamma.  With the earlier axes served, group k moves in that zonotope on a
    straight line from hover to its demand, as far as it gets: its direction is kept.  If
    hover is out of reach by now, the line begins at the nearest point to it; for a group of one
    axis the outcome is the attainable value that is nearest to the demand.

    Parameters
    ----------
    problem : AllocationProblem
    groups : sequence of sequences of int
        Rows of Gamma, the most important group first.
    """

    def __init__(self, problem: AllocationProblem, groups: Sequence[Sequence[int]]) -> None:
        lower, upper, gamma = problem.lower, problem.upper, problem.gamma
        self._reference = problem.hover
        self._middle, self._reach = (lower + upper) / 2.0, (upper - lower) / 2.0
        self._gamma = gamma
        self._groups = [np.array(group) for group in groups]
        prefixes = [np.concatenate(self._groups[: k + 1]) for k in range(len(groups))]
        self._prefixes = prefixes
        self._shadows = [
            Zonotope(gamma[rows] @ self._middle, gamma[rows] * self._reach) for rows in prefixes
        ]

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """Return the served wrench (m,) [N, N m] and the share (m,) of each axis's demand."""
        served, levels = self._reference.copy(), np.ones(len(u))
        for k, group in enumerate(self._groups):
            start = self._start(k, served)
            way = np.zeros(len(start))
            way[-len(group) :] = u[group] - start[-len(group) :]
            levels[group] = min(self._shadows[k].reach(start, way), 1.0)
            served[group] = (start + levels[group[0]] * way)[-len(group) :]
        return served, levels

    def _start(self, k: int, served: Array) -> Array:
        """Return the point, over the axes of groups 0 to k, where group k begins its way."""
        rows, group, shadow = self._prefixes[k], self._groups[k], self._shadows[k]
        start = served[rows]
        if shadow.margin(start) >= 0.0:
            return start
        if len(group) == 1:
            start[-1] = np.clip(start[-1], *shadow.section(start))
            return start
        inner = start.copy()
        thrusts = self._middle if k == 0 else self._central_thrusts(k - 1, served)
        inner[-len(group) :] = self._gamma[group] @ thrusts
        return inner + min(shadow.reach(inner, start - inner), 1.0) * (start - inner)

    def _central_thrusts(self, k: int, served: Array) -> Array:
        """Return the thrusts nearest to the middle of their range that serve groups 0 to k."""
        rows, shadow = self._prefixes[k], self._shadows[k]
        gamma, image = self._gamma[rows], Zonotope(0.0 * shadow.center, shadow.generators)
        least = LeastNorm(gamma, -self._reach, self._reach, image)
        return self._middle + least.solve(served[rows] - shadow.center, 1e-12)[0]
