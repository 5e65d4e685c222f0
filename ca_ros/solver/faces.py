"""Faces of convex sets: what is left of the sets once a linear cost is at its least value."""

from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.solver.convex_sets import ConvexSet, ConvexSets, Interval, Sector

DEPENDENT = 1e-6  # share of a row that others do not give, below which they give it

LEVEL = 1e-8
"""Change of a linear function along a face that counts as none, as a share of its range."""


@dataclass
class Part:
    """What is left of the set of one effector: vectors ``base + ways @ z`` with z in `shape`.

    - `base` (k,), `ways` (k, d): with orthonormal columns
    - `shape`: a set with d components; None if nothing but `base` is left
    """

    base: Array
    ways: Array
    shape: ConvexSet | None


def whole(sets: ConvexSets) -> list[Part]:
    """Return the parts of sets from which nothing has been taken."""
    return [Part(np.zeros(each.size), np.eye(each.size), each) for each in sets.sets]


def face(part: Part, slope: Array, point: Array, level: float) -> Part:
    """Return the vectors of a part with the greatest product with a slope.

    - `slope` (k,): a normal of the boundary, times the columns of the effector
    - `point` (k,): the vector with the greatest product; this one is left if no other is
    - `level`: change of the product that counts as none
    """
    shape, rate = part.shape, slope @ part.ways
    if shape is None:
        return part
    still = Part(point, np.zeros((len(point), 0)), None)
    if isinstance(shape, Interval):
        return part if abs(rate[0]) * (shape.upper - shape.lower) <= level else still
    _, least, radius, full, cosine, sine, low, _, _, inner = shape.fields
    size, axis = len(point), np.eye(len(point))[0]
    if np.linalg.norm(rate) * radius <= level:
        return part
    if full:
        return still
    # In the half plane of the point: the flank, and the plane at `least`.
    across = float(np.linalg.norm(point[1:]))
    away = point[1:] / across if across > 0.0 else np.eye(size - 1)[0]
    flank = np.concatenate([[cosine], sine * away])
    out = float(rate[1:] @ away)
    turned = np.linalg.norm(rate[1:] - out * away)
    tilt = float(np.hypot(flank @ rate, turned))
    if cosine > 0.0 and low < radius and out > 0.0 and radius * tilt <= level:
        return Part(np.zeros(size), flank[:, None], Interval(low, radius))
    end = inner if least > 0.0 else radius * (cosine <= 0.0)
    if rate[0] < 0.0 < end and np.linalg.norm(rate[1:]) * radius <= level:
        flat: ConvexSet = Interval(-end, end) if size == 2 else Sector(np.pi, end)
        return Part(least * axis, np.eye(size)[:, 1:], flat)
    return still


def independent(rows: Array) -> list[int]:
    """Return the numbers of rows (k, n) that the rows before them do not give."""
    found, basis = list[int](), list[Array]()
    for i, row in enumerate(rows):
        rest = row.copy()
        for _ in range(2):
            for each in basis:
                rest = rest - (each @ rest) * each
        size = float(np.linalg.norm(rest))
        if size > DEPENDENT * float(np.linalg.norm(row)) and size > 0.0:
            found.append(i)
            basis.append(rest / size)
    return found
