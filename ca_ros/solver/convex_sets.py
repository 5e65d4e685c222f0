"""Convex sets of effectors, and their products: projection, derivative, support function."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, cos, isfinite, pi, sin, tan
from typing import Any

import numpy as np

from ca_ros.arrays import Array, IntArray, constant

THIN = 1e-9  # half angle below which a sector is an interval along its axis [rad]


@dataclass(frozen=True)
class Interval:
    """The numbers between two bounds: an effector with a fixed direction.

    Parameters
    ----------
    lower, upper : float
    """

    lower: float
    upper: float
    size = 1

    def __post_init__(self) -> None:
        if not -np.inf < self.lower <= self.upper < np.inf:
            raise ValueError(f'expected lower <= upper, finite; got {self}')


@dataclass(frozen=True)
class Sector:
    """Vectors of length up to `radius`, turned by up to `half_angle` from the first axis.

    In the plane this is a sector: a rotor with one tilt angle.  In space it is a cone with a round
    base: a rotor on a gimbal.  With a half angle of pi it is a disc or a ball.

    Parameters
    ----------
    half_angle : float
        Up to pi/2, or pi: between half a circle and a circle it is not convex [rad].
    radius : float
        Positive.
    size : {2, 3}, default 2
        Number of components.
    least : float, default 0
        Least component along the axis, below `radius`.  Vectors from a length `least` on are not a
        convex set; these are a convex part of them.
    """

    half_angle: float
    radius: float
    size: int = 2
    least: float = 0.0

    def __post_init__(self) -> None:
        angle = self.half_angle
        if not (THIN < angle <= pi / 2 + 1e-12 or angle == pi):
            raise ValueError(f'half_angle: expected up to pi/2, or pi; got {angle:g} rad')
        if self.size not in (2, 3):
            raise ValueError(f'size: expected 2 or 3 components, got {self.size!r}')
        if not (self.radius > 0.0 and isfinite(self.radius)):
            raise ValueError(f'radius: expected a positive number, got {self.radius!r}')
        if not 0.0 <= self.least < self.radius or (self.least and angle == pi):
            raise ValueError(
                f'least: expected 0 up to the radius {self.radius:g}, and 0 for a half angle of '
                f'pi; got {self.least!r}'
            )

    @property
    def fields(self) -> tuple[float, ...]:
        """The numbers of the set for `ConvexSets.fields`."""
        angle = min(self.half_angle, pi / 2)
        cosine = cos(angle) if angle < pi / 2 - 1e-12 else 0.0
        # The flank goes from `least` to the arc; it is empty if `least` cuts all of it off.
        begin = self.least / cosine if cosine else self.radius * (self.least > 0.0)
        end, inner = self.half_angle, 0.0
        if self.least:
            end = min(end, acos(self.least / self.radius))
            inner = self.radius * sin(end) if end < self.half_angle else self.least * tan(end)
        return (
            self.size, self.least, self.radius, float(self.half_angle == pi), cosine, sin(angle),
            min(begin, self.radius), self.radius * cos(end), self.radius * sin(end), inner,
        )


ConvexSet = Interval | Sector


class ConvexSets:
    """The product of convex sets, one for each effector.

    Sectors are symmetric about their axis, so everything reduces to the half plane of the
    components along and across it.  All methods take leading dimensions.

    - `limits`: least and greatest `sizes` (k,), by default those of the sets

    - `n`: number of components
    - `first`: the first component of each set
    - `owners` (n,): the set of each component
    - `leading` (n,): which components are the first of their set
    - `lower` and `upper` (n,): the least box around the product
    - `middle` (n,): a point inside all sets
    - `half_range` (n,): half of the lengths of the box's edges
    """

    def __init__(
        self, sets: Sequence[ConvexSet], limits: tuple[Array, Array] | None = None
    ) -> None:
        self.sets = tuple(sets)
        self._limits = self.length_limits if limits is None else limits
        ends = np.cumsum([0, *(each.size for each in sets)])
        self.n, self.first = int(ends[-1]), ends[:-1].tolist()
        self.owners = np.repeat(np.arange(len(self.sets)), [each.size for each in sets])
        self.leading = np.diff(self.owners, prepend=-1) > 0
        placed = list(zip(self.sets, self.first, strict=True))
        intervals = [(each, k) for each, k in placed if isinstance(each, Interval)]
        self._line = np.array([k for _, k in intervals], int)
        self._numbers = [i for i, each in enumerate(sets) if isinstance(each, Interval)]
        self._low = np.array([each.lower for each, _ in intervals], float)
        self._high = np.array([each.upper for each, _ in intervals], float)
        sectors = [(each, k) for each, k in placed if isinstance(each, Sector)]
        groups = [[pair for pair in sectors if pair[0].size == size] for size in (2, 3)]
        self._groups = [_Sectors(group) for group in groups if group]
        self.lower, self.upper, self.middle = np.zeros((3, self.n))
        self.lower[self._line], self.upper[self._line] = self._low, self._high
        self.middle[self._line] = 0.5 * (self._low + self._high)
        for group in self._groups:
            along, across = group.places[:, 0], group.places[:, 1:]
            self.lower[along], self.upper[along], width = group.box
            self.upper[across] = width[:, None]
            self.lower[across] = -self.upper[across]
            self.middle[along] = group.middle
        self.half_range = (self.upper - self.lower) / 2.0

    def project(self, points: Array) -> Array:
        """Return the nearest points (..., n) of the sets."""
        nearest = np.empty_like(points)
        line = points[..., self._line]
        nearest[..., self._line] = np.minimum(np.maximum(line, self._low), self._high)
        for group in self._groups:
            nearest[..., group.places] = group.project(points[..., group.places])[0]
        return nearest

    def project_with_derivative(self, points: Array) -> tuple[Array, Array]:
        """Return the projection (..., n) and one of its generalized derivatives (..., n, n)."""
        nearest = np.empty_like(points)
        rate = np.zeros((*points.shape, self.n))
        line = points[..., self._line]
        nearest[..., self._line] = np.minimum(np.maximum(line, self._low), self._high)
        rate[..., self._line, self._line] = (line > self._low) & (line < self._high)
        for group in self._groups:
            place = group.places
            nearest[..., place], blocks = group.derivative(points[..., place])
            rate[..., place[:, :, None], place[:, None, :]] = blocks
        return nearest, rate

    def saturate(self, points: Array) -> Array:
        """Return points (..., n) with angle and length clipped one after the other.

        This is what is usual in place of the projection.  It is as far from the given point as the
        projection or further, and may have a length between `least` and ``least / cos``.
        """
        clipped = self.project(points)
        for each, k in zip(self.sets, self.first, strict=True):
            if isinstance(each, Sector):
                place = slice(k, k + each.size)
                vector = points[..., place]
                across = np.linalg.norm(vector[..., 1:], axis=-1)
                length = np.hypot(vector[..., 0], across)
                angle = np.minimum(np.arctan2(across, vector[..., 0]), each.half_angle)
                length = np.minimum(np.maximum(length, each.least), each.radius)
                side = vector[..., 1:] / np.where(across > 0.0, across, 1.0)[..., None]
                clipped[..., k] = length * np.cos(angle)
                clipped[..., k + 1 : k + each.size] = (length * np.sin(angle))[..., None] * side
        return clipped

    def support(self, slopes: Array) -> Array:
        """Return the greatest ``slopes @ x`` (...) of points x of the sets."""
        line = slopes[..., self._line]
        total = np.maximum(line * self._low, line * self._high).sum(axis=-1)
        for group in self._groups:
            total = total + group.farthest(slopes[..., group.places])[1].sum(axis=-1)
        return np.asarray(total, float)

    def farthest(self, slopes: Array) -> Array:
        """Return points (..., n) with the greatest ``slopes @ x``."""
        points = np.empty_like(slopes)
        line = slopes[..., self._line]
        points[..., self._line] = np.where(line > 0.0, self._high, self._low)
        for group in self._groups:
            points[..., group.places] = group.farthest(slopes[..., group.places])[0]
        return points

    def fields(self) -> dict[str, Array | float]:
        """Return the fields of the sets in ``ca_vectored``, see `ca_ros/kernel/vectored.h`."""
        rows = [
            (1, each.lower, each.upper, *[0.0] * 7) if isinstance(each, Interval) else each.fields
            for each in self.sets
        ]
        names = (
            'size', 'least', 'radius', 'full', 'cosine', 'sine', 'flank', 'end_along',
            'end_across', 'inner',
        )
        columns = zip(names, np.array(rows, float).T, strict=True)
        return {'sets': len(rows), 'components': self.n, **dict(columns)}

    @property
    def length_limits(self) -> tuple[Array, Array]:
        """Least and greatest length (k,) of each set's vectors, of an interval its ends."""
        low, high = np.array([
            (each.lower, each.upper) if isinstance(each, Interval) else (each.least, each.radius)
            for each in self.sets
        ]).T
        return low, high

    def at_bounds(self, points: Array, rounding: float) -> IntArray:
        """Return (..., k) -1 at the least and +1 at the greatest length of each effector."""
        sizes, (low, high) = self.lengths(points), self.length_limits
        off = rounding * np.maximum(1.0, high)
        at_upper = (sizes >= high - off).astype(np.int8)
        return np.where(sizes <= low + off, np.int8(-1), at_upper)

    def image(self, matrix: Array) -> tuple[Array, Array]:
        """Return the middle and half of the range of each component (m,) of ``matrix @ x``."""
        most, least = np.split(self.support(np.concatenate([matrix, -matrix])), 2)
        least = -least
        return (most + least) / 2.0, (most - least) / 2.0

    def sizes(self, points: Array) -> Array:
        """Return the lengths (..., k), within the limits to the last bit."""
        return np.minimum(np.maximum(self.lengths(points), self._limits[0]), self._limits[1])

    def lengths(self, points: Array) -> Array:
        """Return the length (..., k) of each effector's vector; of an interval its number."""
        lengths = np.sqrt(np.add.reduceat(points * points, self.first, axis=-1))
        lengths[..., self._numbers] = points[..., self._line]
        return np.asarray(lengths, float)


class Box:
    """The product of intervals, one for each effector; a `ConvexSets` that needs less time.

    - `n`: number of effectors
    - `lower`, `upper`, `middle`, `half_range` (n,)
    - `first`, `owners`: of each effector its component, and the other way round: the same numbers
    """

    owners = slice(None)
    leading = True

    def __init__(self, lower: Array, upper: Array) -> None:
        self.lower, self.upper, self.n = constant(lower), constant(upper), len(lower)
        self.middle = constant((self.lower + self.upper) / 2.0)
        self.half_range = constant((self.upper - self.lower) / 2.0)
        self.first = range(self.n)

    def project(self, points: Array) -> Array:
        """Return points (..., n) within the bounds."""
        return np.minimum(np.maximum(points, self.lower), self.upper)

    def saturate(self, points: Array) -> Array:
        """Return the projection: numbers saturate at their bounds."""
        return self.project(points)

    def support(self, slopes: Array) -> Array:
        """Return the greatest ``slopes @ x`` (...) of points x within the bounds."""
        return np.asarray(np.maximum(slopes * self.lower, slopes * self.upper).sum(axis=-1))

    def sizes(self, points: Array) -> Array:
        """Return the numbers (..., n) themselves."""
        return points

    def at_bounds(self, points: Array, rounding: float) -> IntArray:
        """Return (..., n) -1 at the lower and +1 at the upper bound, to rounding; 0 between."""
        below, above = (
            rounding * np.maximum(1.0, np.abs(end)) for end in (self.lower, self.upper))
        at_upper = (points >= self.upper - above).astype(np.int8)
        return np.where(points <= self.lower + below, np.int8(-1), at_upper)

    def image(self, matrix: Array) -> tuple[Array, Array]:
        """Return the middle and half of the range of each component (m,) of ``matrix @ x``."""
        return matrix @ self.middle, np.abs(matrix * self.half_range).sum(axis=1)


class _Sectors:
    """Sectors with the same number of components; arrays are (..., k, size)."""

    def __init__(self, placed: Sequence[tuple[Sector, int]]) -> None:
        self.places = np.array([np.arange(k, k + each.size) for each, k in placed])
        _, self._least, self._radius, full, self._cos, self._sin, self._begin, *corners = np.array(
            [each.fields for each, _ in placed]).T
        self._end, self._across, self._inner = corners
        self._full = full > 0.0
        self._flank = (self._begin < self._radius) & ~self._full
        inner = self._least + 0.6 * (self._radius - self._least)
        self.middle = np.where(self._full, 0.0, inner)

    @property
    def box(self) -> tuple[Array, Array, Array]:
        """Least and greatest component along the axis, and the greatest across (k,)."""
        least = np.where(self._full, -self._radius, np.minimum(self._end, self._least))
        width = np.where(self._full, self._radius, np.maximum(self._across, self._inner))
        return least, self._radius, width

    def project(self, points: Array) -> tuple[Array, Any, Array, Array, Array, Array]:
        """Return nearest points, the number of the case, and the half plane's coordinates.

        The cases: 0 inside, 1 on the arc, 2 on the flank, 3 on the plane at `least`, 4 a corner.
        """
        along, rest = points[..., 0], points[..., 1:]
        across = np.abs(rest[..., 0]) if rest.shape[-1] == 1 else np.linalg.norm(rest, axis=-1)
        length = np.hypot(along, across)
        radius = self._radius
        on_flank = along * self._cos + across * self._sin
        ahead = self._full | (across * self._end <= along * self._across)
        inside = (length <= radius) & (self._full | (
            (across * self._cos <= along * self._sin) & (along >= self._least)))
        # The nearest point of each part of the boundary.
        scale = radius / np.where(length > 0.0, length, 1.0)
        held = np.minimum(np.maximum(on_flank, self._begin), radius)
        flank = (np.where(self._flank, held * self._cos, self._end),
                 np.where(self._flank, held * self._sin, self._across))
        plane = self._least + 0.0 * along, np.minimum(across, self._inner)
        arc = ahead & (length > radius)
        # Distances would not tell flank and plane apart far away.
        by_flank = ~arc & (across > self._inner)
        case = np.where(arc, 1, np.where(by_flank, 2, 3))
        corner = np.where(by_flank, (held != on_flank) | ~self._flank, across >= self._inner)
        case = np.where(inside, 0, np.where(~arc & corner, 4, case))
        to = np.where(arc, along * scale, np.where(by_flank, flank[0], plane[0]))
        up = np.where(arc, across * scale, np.where(by_flank, flank[1], plane[1]))
        to, up = np.where(inside, along, to), np.where(inside, across, up)
        ratio = up / np.where(across > 0.0, across, 1.0)
        nearest = np.concatenate([to[..., None], rest * ratio[..., None]], axis=-1)
        return nearest, case, along, across, length, ratio

    def derivative(self, points: Array) -> tuple[Array, Array]:
        """Return nearest points and derivatives (..., k, size, size)."""
        nearest, case, along, across, length, ratio = self.project(points)
        size = points.shape[-1]
        shrink = self._radius / np.where(length > 0.0, length, 1.0)
        c = along / np.where(length > 0.0, length, 1.0)
        s = across / np.where(length > 0.0, length, 1.0)
        one, zero = np.ones_like(along), np.zeros_like(along)
        cos_, sin_ = self._cos + zero, self._sin + zero
        choices = [
            (one, zero, one), (shrink * s * s, -shrink * c * s, shrink * c * c),
            (cos_ * cos_, cos_ * sin_, sin_ * sin_), (zero, zero, one), (zero, zero, zero),
        ]
        aa, ac, cc = (np.choose(case, [choice[i] for choice in choices]) for i in range(3))
        blocks = np.zeros((*points.shape, size))
        away = points[..., 1:] / np.where(across > 0.0, across, 1.0)[..., None]
        blocks[..., 0, 0] = aa
        blocks[..., 0, 1:] = blocks[..., 1:, 0] = ac[..., None] * away
        # Around the axis a vector turns with its projection.
        turn = np.where(across > 0.0, ratio, cc)
        outer = away[..., :, None] * away[..., None, :]
        blocks[..., 1:, 1:] = turn[..., None, None] * np.eye(size - 1) + (
            (cc - turn)[..., None, None] * outer)
        return nearest, blocks

    def farthest(self, slopes: Array) -> tuple[Array, Array]:
        """Return points with the greatest product with slopes, and the products (..., k)."""
        along, rest = slopes[..., 0], slopes[..., 1:]
        across = np.linalg.norm(rest, axis=-1)
        length = np.hypot(along, across)
        ahead = (self._full | (across * self._end <= along * self._across)) & (length > 0.0)
        scale = self._radius / np.where(length > 0.0, length, 1.0)
        outer = along * self._end + across * self._across
        inner = along * self._least + across * self._inner
        out = outer >= inner
        to = np.where(ahead, along * scale, np.where(out, self._end, self._least))
        up = np.where(ahead, across * scale, np.where(out, self._across, self._inner))
        up = np.where(across > 0.0, up, 0.0)
        value = np.where(ahead, self._radius * length, np.maximum(outer, inner))
        still = self._full & (length == 0.0)
        value, to = np.where(still, 0.0, value), np.where(still, 0.0, to)
        ratio = (up / np.where(across > 0.0, across, 1.0))[..., None]
        return np.concatenate([to[..., None], rest * ratio], axis=-1), value
