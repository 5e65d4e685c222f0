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
        self._prefixes = [np.concatenate(self._groups[: k + 1]) for k in range(len(groups))]
        self._shadows = [
            Zonotope(gamma[rows] @ self._middle, gamma[rows] * self._reach)
            for rows in self._prefixes
        ]
        # For thrusts counted from their middle.
        self._least = {
            k: LeastNorm(gamma[self._prefixes[k - 1]], -self._reach, self._reach)
            for k, group in enumerate(self._groups)
            if k > 0 and len(group) > 1
        }
        self._first = self._begin(0, self._reference)

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """Return the served wrenches (..., m) [N, N m] and the shares (..., m) of each demand."""
        served, levels = np.broadcast_to(self._reference, u.shape).copy(), np.ones(u.shape)
        for k, group in enumerate(self._groups):
            serve = self._serve_one if len(group) == 1 else self._serve_several
            served[..., group], share = serve(k, served, u[..., group])
            levels[..., group] = share[..., None]
        # A facet that is steep in an axis makes the rounding errors of the others great in it.
        served[..., self._prefixes[-1]] = self._shadows[-1].pull(served[..., self._prefixes[-1]])
        return served, levels

    def _serve_one(self, k: int, served: Array, demand: Array) -> tuple[Array, Array]:
        low, high = self._shadows[k].section(served[..., self._prefixes[k]])
        start = np.minimum(np.maximum(self._reference[self._groups[k][0]], low), high)
        wanted = demand[..., 0]
        end = np.minimum(np.maximum(wanted, low), high)
        with np.errstate(invalid='ignore'):
            share = np.where(end == wanted, 1.0, (end - start) / (wanted - start))
        return end[..., None], share

    def _serve_several(self, k: int, served: Array, demand: Array) -> tuple[Array, Array]:
        # The first group has no earlier ones, so that its way always begins at the same place.
        begin = self._begin(k, served) if k else self._first
        share = self._share(k, served, begin, demand - begin)
        return begin + share * (demand - begin), share[..., 0]

    def _begin(self, k: int, served: Array) -> Array:
        """Return where the way (..., of group k) to the demand begins."""
        inner = self._inner(k, served)
        to_hover = self._reference[self._groups[k]] - inner
        # On the border the way might go off it or along it, so a start out of reach is moved in.
        return inner + self._share(k, served, inner, to_hover) ** 2 * to_hover

    def _share(self, k: int, served: Array, begin: Array, way: Array) -> Array:
        """Return the share (..., 1) of a way of group k that can be gone."""
        shape = (*np.broadcast_shapes(served.shape[:-1], way.shape[:-1]), len(self._prefixes[k]))
        start, direction = np.empty(shape), np.zeros(shape)
        count = len(self._groups[k])
        start[...] = served[..., self._prefixes[k]]
        start[..., -count:] = begin
        direction[..., -count:] = way
        return np.minimum(self._shadows[k].reach(start, direction), 1.0)[..., None]

    def _inner(self, k: int, served: Array) -> Array:
        """Return values (..., of group k) well inside of what the earlier groups leave.

        The earlier axes are as far from the middle of their set as a share of the way to its
        boundary; the thrusts that belong to it are that share of the way from the middle of their
        range to those on the boundary.
        """
        group = self._gamma[self._groups[k]]
        if k == 0:
            return group @ self._middle
        middle = np.broadcast_to(group @ self._middle, (*served.shape[:-1], len(group)))
        rows, shadow, least = self._prefixes[k - 1], self._shadows[k - 1], self._least[k]
        ways = served[..., rows] - shadow.center
        reaches = shadow.reach(shadow.center, ways)
        inner = middle.copy()
        for i in np.ndindex(reaches.shape):
            if reaches[i] < np.inf:
                inner[i] += group @ (least.solve(reaches[i] * ways[i], 1e-12)[0] / reaches[i])
        return inner
