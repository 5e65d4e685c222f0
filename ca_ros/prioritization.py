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
    by the same rows of Gamma.  With the earlier axes served, a group of one axis gets the
    attainable value that is nearest to its demand.  A group of several moves on a straight line
    from hover to its demand, as far as it gets: its direction is kept.  Where the earlier axes do
    not leave hover to it, the line begins at a point inside of what they leave, which depends
    continuously on the demand.

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
            serve = self._serve_one if len(group) == 1 else self._serve_several
            served[group], levels[group] = serve(k, served, u[group])
        return served, levels

    def _serve_one(self, k: int, served: Array, demand: Array) -> tuple[Array, float]:
        low, high = self._shadows[k].section(served[self._prefixes[k]])
        start, end = np.clip([self._reference[self._groups[k][0]], demand[0]], low, high)
        level = 1.0 if end == demand[0] else (end - start) / (demand[0] - start)
        return np.array([end]), float(level)

    def _serve_several(self, k: int, served: Array, demand: Array) -> tuple[Array, float]:
        group, shadow = self._groups[k], self._shadows[k]
        start = served[self._prefixes[k]]
        inner = self._inner(k, served)

        def reach(begin: Array, way: Array) -> float:
            start[-len(group) :] = begin
            direction = np.concatenate([np.zeros(len(start) - len(group)), way])
            return shadow.reach(start, direction)

        to_hover = self._reference[group] - inner
        # On the border the way might go off it or along it, so a start out of reach is moved in.
        begin = inner + min(reach(inner, to_hover), 1.0) ** 2 * to_hover
        level = min(reach(begin, demand - begin), 1.0)
        return begin + level * (demand - begin), level

    def _inner(self, k: int, served: Array) -> Array:
        """Return a value of group k well inside of what the earlier groups leave.

        The earlier axes are as far from the middle of their set as a share of the way to its
        boundary; the thrusts that belong to it are that share of the way from the middle of their
        range to those on the boundary.
        """
        group = self._gamma[self._groups[k]]
        if k == 0:
            return group @ self._middle
        rows, shadow = self._prefixes[k - 1], self._shadows[k - 1]
        way = served[rows] - shadow.center
        reach = shadow.reach(shadow.center, way)
        if reach == np.inf:
            return group @ self._middle
        image = Zonotope(0.0 * shadow.center, shadow.generators)
        least = LeastNorm(self._gamma[rows], -self._reach, self._reach, image)
        return group @ (self._middle + least.solve(reach * way, 1e-12)[0] / reach)
