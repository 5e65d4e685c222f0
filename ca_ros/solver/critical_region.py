"""The affine solution of one region of wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray

SLACK = 1e-12
"""How far, in units of the greatest thrust, z may be outside of a region and be served."""

ROUNDING = 8 * float(np.finfo(float).eps)
"""The same in units of the offset, for a law of great numbers that nearly cancel."""

EDGE = 16 * float(np.finfo(float).eps)
"""How far, in units of the greatest thrust, z may be beyond a bound: the answer, put at it, need
not be judged: a saturated wrench is at the edge of a region, to rounding."""


@dataclass(frozen=True, eq=False)
class AffineLaw:
    """The thrusts of one region of wrenches: ``f = clip(z)`` with ``z = slope u + offset``.

    The region is where z proves f to be the solution: ``least <= z <= greatest``, that is between
    the bounds for the rotors that are free, and beyond its bound for each of the others.

    Attributes
    ----------
    slope, offset : (n, m) and (n,) arrays
    least, greatest : (n,) arrays
        [N]
    bound : array of int
        The rotors that are at a bound.
    ends : array
        Their thrusts [N].
    limits : pair of lists
        `least` and `greatest`, but without any slack for the free rotors: where z keeps them, the
        thrusts are z with `ends` in it, and nothing need be clipped.
    edge : float
        How far z may be outside of the limits, and the thrusts be clipped to them [N].
    linear : bool
        Whether the offset is nought.
    proven : bool
        Whether the thrusts are known to be right wherever z keeps the limits, but for `edge`, so
        that the single answer need not be judged.
    """

    slope: Array
    offset: Array
    least: Array
    greatest: Array
    bound: NDArray[np.intp]
    ends: Array
    limits: tuple[list[float], list[float]]
    edge: float
    linear: bool
    proven: bool = False

    @classmethod
    def of(
        cls,
        slope: Array,
        offset: Array,
        free: BoolArray,
        ends: Array,
        lower: Array,
        upper: Array,
    ) -> AffineLaw:
        """Return the law for rotors that are free, or at that of their bounds which is in `ends`.

        Parameters
        ----------
        slope, offset : (n, m) and (n,) arrays
        free : (n,) array of bool
        ends : (n,) array
            Thrusts; those of the free rotors do not matter [N].
        lower, upper : (n,) arrays
            Bounds [N].
        """
        greatest_thrust = max(1.0, float(upper.max(initial=0.0)))
        slack = SLACK * greatest_thrust + ROUNDING * np.abs(offset)
        movable = upper > lower
        at_lower, at_upper = movable & (ends <= lower), movable & (ends >= upper)
        least = np.where(free, lower, np.where(at_upper, upper, -np.inf))
        greatest = np.where(free, upper, np.where(at_lower, lower, np.inf))
        limits = (
            np.where(free, least, least - slack).tolist(),
            np.where(free, greatest, greatest + slack).tolist(),
        )
        bound = np.flatnonzero(~free)
        return cls(
            slope,
            offset,
            least - slack,
            greatest + slack,
            bound,
            ends[bound],
            limits,
            EDGE * greatest_thrust,
            linear=not offset.any(),
        )

    def thrusts(self, u: Array) -> Array | None:
        """Return the thrusts (n,) for a wrench (m,); None if z is beyond `limits` and `edge`."""
        # For so few numbers dot is faster than @, and Python than NumPy.
        z = self.slope.dot(u)
        if not self.linear:
            z += self.offset
        lower, upper = self.limits
        # To be strict would take as long as all comparisons.
        for least, value, greatest in zip(lower, z.tolist(), upper):  # noqa: B905
            if not least <= value <= greatest:
                return self._at_the_edge(z)
        if len(self.bound):
            z[self.bound] = self.ends
        return z

    def _at_the_edge(self, z: Array) -> Array | None:
        lower, upper = self.limits
        for least, value, greatest in zip(lower, z.tolist(), upper):  # noqa: B905
            if not least - self.edge <= value <= greatest + self.edge:
                return None
        return self._clip(z)

    def clipped(self, u: Array) -> Array:
        """Return the thrusts (n,) for a wrench (m,) of which z may be outside of `limits`."""
        return self._clip(self.slope.dot(u) + self.offset)

    def _clip(self, z: Array) -> Array:
        z[self.bound] = self.ends
        lower, upper = self.limits
        return np.minimum(np.maximum(z, lower), upper)

    def served(self, wrenches: Array) -> tuple[NDArray[np.intp], Array]:
        """Return which of the wrenches (m, N) are in the region, K indices, and thrusts (n, K)."""
        # Few pass the conditions of the rotors at a bound, so these are looked at first.
        rows, sides = self._held
        offset, least, greatest, lower, upper = self._columns
        if len(rows):
            found = np.logical_and.reduce(rows @ wrenches <= sides).nonzero()[0]
            wrenches = wrenches[:, found]
        else:
            found = np.arange(wrenches.shape[1])
        z = self.slope @ wrenches
        z += offset
        inside = np.logical_and.reduce((z >= least) & (z <= greatest))
        if not inside.all():
            found, z = found[inside], z[:, inside]
        z[self.bound] = self.ends[:, None]
        # In place: so many numbers take longer to make room for than to compare.
        np.maximum(z, lower, out=z)
        np.minimum(z, upper, out=z)
        return found, z

    @cached_property
    def _columns(self) -> tuple[Array, Array, Array, Array, Array]:
        """Offset, least and greatest z and the limits, as columns (n, 1)."""
        lower, upper = np.array(self.limits)[..., None]
        return self.offset[:, None], self.least[:, None], self.greatest[:, None], lower, upper

    @cached_property
    def _held(self) -> tuple[Array, Array]:
        """Rows (k, m) and sides (k, 1) of ``rows u <= sides``, the conditions at the bounds."""
        above, below = (
            self.bound[np.isfinite(side[self.bound])] for side in (self.least, self.greatest)
        )
        sides = np.concatenate(
            [self.offset[above] - self.least[above], self.greatest[below] - self.offset[below]]
        )
        return np.vstack([-self.slope[above], self.slope[below]]), sides[:, None]
