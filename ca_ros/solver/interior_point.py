"""Linear and quadratic costs over a product of convex sets, by an interior-point method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ca_ros.arrays import Array
from ca_ros.solver.convex_sets import ConvexSets

GROWTH = 30.0  # factor by which the weight of the cost grows from one centre to the next
CENTERED = 0.2  # newton decrement at which a point counts as a centre
STEPS = 300  # limit of Newton's iteration; the tests have not seen half of it
BACK = 0.9  # greatest share of the way to the boundary that one step goes


ROUNDING = 1e-15  # distance from the boundary that rounding errors make; the method ends before it


class Minimum(NamedTuple):
    """The result of `minimize`.

    `point` (n,): inside the sets, with ``matrix @ point = goal`` to rounding.  `multipliers` (m,):
    of the equations.
    """

    point: Array
    multipliers: Array
    steps: int


def minimize(
    sets: ConvexSets, matrix: Array, goal: Array, cost: Array, start: Array, gap: float,
    curvature: Array | None = None, weight: float = 1.0,
) -> Minimum:
    """Minimise ``c @ x + x @ (d * x) / 2`` with ``A x = b`` and x in the sets.

    The method follows the centres of ``weight cost(x) + barrier(x)`` while the weight grows.  At
    a centre the cost is at most ``complexity / weight`` greater than its least value.

    - `matrix` and `goal` (m, n): a and b
    - `cost` (n,): c
    - `start` (n,): inside the sets; it need not satisfy the equations
    - `gap`: by how much the cost may exceed the least one
    - `curvature` (n,): d, not negative; by default zeros
    - `weight`: of the cost, at first
    """
    bound = sets.upper > sets.lower
    if not bound.all():
        # What cannot move is no part of the program.
        moving = [each for each, k in zip(sets.sets, sets.first, strict=True) if bound[k]]
        fixed = sets.lower * ~bound
        some = minimize(
            ConvexSets(moving), matrix[:, bound], goal - matrix @ fixed, cost[bound],
            start[bound], gap, None if curvature is None else curvature[bound], weight,
        )
        point = sets.lower.copy()
        point[bound] = some.point
        return some._replace(point=point)
    x, last, steps = start.copy(), sets.complexity / gap, 0
    bend = np.zeros(len(x)) if curvature is None else curvature
    multipliers = np.zeros(len(goal))
    while steps < STEPS:
        steps += 1
        slope, terms = sets.barrier(x)
        gradient = weight * (cost + bend * x) + slope
        # Scaled by a root of the Hessian, the system keeps its digits near the boundary.  Great
        # rows come first, for the digits of the small ones.
        terms = np.concatenate([terms, np.diag(np.sqrt(weight * bend))])
        order = np.argsort(-np.abs(terms).max(axis=1))
        root = np.asarray(np.linalg.qr(terms[order], mode='r')).T
        rows = np.linalg.solve(root, matrix.T)
        scaled = np.linalg.solve(root, gradient)
        left = goal - matrix @ x
        basis, triangle = np.linalg.qr(rows)
        to = np.linalg.lstsq(triangle.T, left, rcond=1e-14)[0]
        along = basis.T @ scaled
        centering = basis @ along - scaled
        multipliers = np.linalg.lstsq(triangle, to + along, rcond=1e-14)[0] / weight
        way = np.linalg.solve(root.T, centering + basis @ to)
        decrement = float(np.sqrt(centering @ centering))
        size = 1.0 if decrement < CENTERED else 1.0 / (1.0 + 0.25 * decrement)
        while not (sets.slacks(x + size / BACK * way) > 0.0).all():
            size *= 0.7
            if size < 1e-12:
                return Minimum(x, multipliers, steps)
        if not (sets.slacks(x + size * way) > ROUNDING).all():
            return Minimum(x, multipliers, steps)
        x = x + size * way
        if decrement < CENTERED and size == 1.0:
            if weight >= last:
                break
            weight = min(GROWTH * weight, last)
    # The equations to the last digits.
    left = goal - matrix @ x
    near = x + np.linalg.solve(root.T, basis @ np.linalg.lstsq(triangle.T, left, rcond=1e-14)[0])
    if (sets.slacks(near) > 0.0).all() and np.linalg.norm(goal - matrix @ near) < np.linalg.norm(
        left
    ):
        x = near
    return Minimum(x, multipliers, steps)
