"""Boxes: the sets of effectors that are numbers within bounds."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ca_ros.arrays import Array, IntArray, constant
from ca_ros.solver.convex_sets import Interval


class Box:
    """The product of intervals, one for each effector; `ConvexSets` has the same methods.

    - `n`: number of effectors
    - `lower`, `upper`, `middle` (n,)
    - `first`, `owners`: of each effector its component, and the other way round: the same numbers
    """

    owners = slice(None)
    leading = True

    def __init__(self, lower: Array, upper: Array) -> None:
        self.lower, self.upper, self.n = constant(lower), constant(upper), len(lower)
        self.middle = constant((self.lower + self.upper) / 2.0)
        self.first = range(self.n)

    @cached_property
    def sets(self) -> Sequence[Interval]:
        """The intervals."""
        ends = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        return tuple(Interval(low, high) for low, high in ends)

    def project(self, points: Array) -> Array:
        """Return points (..., n) within the bounds."""
        return np.minimum(np.maximum(points, self.lower), self.upper)

    def saturate(self, points: Array) -> Array:
        """Return the same: numbers saturate at their bounds."""
        return self.project(points)

    def support(self, slopes: Array) -> Array:
        """Return the greatest ``slopes @ x`` (...) of points x within the bounds."""
        return np.asarray(np.maximum(slopes * self.lower, slopes * self.upper).sum(axis=-1))

    def farthest(self, slopes: Array) -> Array:
        """Return points (..., n) with the greatest ``slopes @ x``."""
        return np.where(slopes > 0.0, self.upper, self.lower)

    def lengths(self, points: Array) -> Array:
        """Return the numbers (..., n) themselves."""
        return points

    @property
    def length_limits(self) -> tuple[Array, Array]:
        """The bounds."""
        return self.lower, self.upper

    def at_bounds(self, points: Array, rounding: float) -> IntArray:
        """Return (..., n) -1 at the lower and +1 at the upper bound, to rounding; 0 between."""
        below, above = (
            rounding * np.maximum(1.0, np.abs(end)) for end in (self.lower, self.upper))
        at_upper = (points >= self.upper - above).astype(np.int8)
        return np.where(points <= self.lower + below, np.int8(-1), at_upper)

    def image(self, matrix: Array) -> tuple[Array, Array]:
        """Return the middle and half of the range of each component (m,) of ``matrix @ x``."""
        half = (self.upper - self.lower) / 2.0
        return matrix @ self.middle, np.abs(matrix * half).sum(axis=1)
