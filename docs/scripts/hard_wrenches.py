"""Wrenches that may take the kernel many steps, for worst_case.py."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem

HUGE = {'single': 11.0, 'double': 90.0}
"""Decimal exponent of the largest wrenches, in units of the extent."""


def sampled(
    problem: AllocationProblem, precision: str, rng: np.random.Generator, size: int
) -> Array:
    """Return about `size` wrenches (N, m) of all kinds."""
    n, m, count = problem.n, len(problem.axes), size // 12
    sides = problem.image.sides

    def given_by(ways: Array) -> Array:
        return (problem.middle + problem.half_range * ways) @ problem.gamma.T

    def powers(low: float, high: float, columns: int = 1) -> Array:
        """Return random numbers of either sign and any order of magnitude."""
        sign = rng.choice([-1.0, 1.0], (count, columns))
        return sign * 10.0 ** rng.uniform(low, high, (count, columns))

    def on_boundary(bound: float) -> Array:
        """Return wrenches on facets; a thrust that is free in one is at a bound by chance."""
        outward = np.sign(sides[rng.integers(len(sides), size=count)])
        free = rng.uniform(-1.0, 1.0, (count, n))
        free = np.where(rng.random((count, n)) < bound, np.sign(free), free)
        return given_by(np.where(outward, rng.choice([-1.0, 1.0], (count, 1)) * outward, free))

    anything = rng.uniform(-1.0, 1.0, (count, n))
    at_bounds = np.where(rng.random((count, n)) < 0.5, np.sign(anything), anything)
    facets, edges, vertices = on_boundary(0.0), on_boundary(0.5), on_boundary(1.0)
    some = np.where(rng.random((count, 1)) < 0.5, facets, edges)
    start = np.where(rng.random((count, 1)) < 0.5, problem.center, problem.hover)
    noise, extent = rng.standard_normal((count, m)), problem.extent
    axes = np.eye(m)[rng.integers(m, size=count)]
    return np.vstack([
        given_by(anything),
        given_by(at_bounds),
        facets,
        edges,
        vertices,
        problem.center + (1.0 + powers(-13.0, -3.0)) * (some - problem.center),
        vertices + powers(-13.0, -3.0) * noise * extent,
        start + rng.uniform(1.0, 3.0, (count, 1)) * (some - start),
        powers(-3.0, 3.0) * problem.hover + powers(-16.0, -1.0) * noise * extent,
        start + powers(-3.0, 3.0) * axes * extent,
        start + powers(-6.0, 2.0, m) * (rng.random((count, m)) < 0.5) * extent,
        powers(0.0, HUGE[precision]) * noise * extent,
    ])  # fmt: skip


def mutated(problem: AllocationProblem, pool: Array, rng: np.random.Generator) -> Array:
    """Return a changed copy of each wrench of a pool (N, m), for each of five kinds of changes."""
    size, m = pool.shape
    other = pool[rng.permutation(size)]
    axes = np.eye(m)[rng.integers(m, size=size)]
    noise = rng.standard_normal((size, m)) * 10.0 ** rng.uniform(-14.0, 0.5, (size, 1))
    return np.vstack([
        pool + noise * problem.extent,
        pool + axes * noise * problem.extent,
        problem.center + (1.0 + noise[:, :1]) * (pool - problem.center),
        pool + rng.uniform(-0.5, 1.5, (size, 1)) * (other - pool),
        np.where(axes, other, pool),
    ])  # fmt: skip
