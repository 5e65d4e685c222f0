"""Random wrenches for the static study."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet

BLOCK = 1000
"""Samples are drawn in blocks, each from its own seed: sample i depends on seed and i alone."""


def by_volume(admissible: AdmissibleSet, rng: np.random.Generator) -> Array:
    """Draw wrenches (BLOCK, m) uniformly by volume."""
    return admissible.sample(rng, BLOCK)


def by_thrusts(admissible: AdmissibleSet, rng: np.random.Generator) -> Array:
    """Draw thrusts uniformly in their bounds; return the wrenches (BLOCK, m) that they give."""
    problem = admissible.problem
    thrusts = rng.uniform(problem.lower, problem.upper, (BLOCK, len(problem.lower)))
    return thrusts @ problem.gamma.T


def on_boundary(admissible: AdmissibleSet, rng: np.random.Generator) -> Array:
    """Draw wrenches (BLOCK, m) by volume and push them out to the boundary, from the centre."""
    offsets = admissible.sample(rng, BLOCK) - admissible.center
    return admissible.center + offsets / gauge(admissible, admissible.center + offsets)[:, None]


SAMPLINGS: dict[str, Callable[[AdmissibleSet, np.random.Generator], Array]] = {
    'volume': by_volume,
    'thrusts': by_thrusts,
    'boundary': on_boundary,
}


def gauge(admissible: AdmissibleSet, wrenches: Array) -> Array:
    """Return how far out wrenches (..., m) are: 0 at the centre, 1 on the boundary."""
    zonotope = admissible.zonotope
    heights = np.abs((wrenches - zonotope.center) @ zonotope.normals.T)
    return (heights / zonotope.widths).max(axis=-1)


def samples(admissible: AdmissibleSet, sampling: str, seed: int, start: int, stop: int) -> Array:
    """Return samples `start` to `stop`, without the last (stop - start, m) [N, N m]."""
    first, end = start // BLOCK, -(-stop // BLOCK)
    draw = SAMPLINGS[sampling]
    blocks = [draw(admissible, np.random.default_rng([seed, k])) for k in range(first, end)]
    return np.concatenate(blocks)[start - first * BLOCK : stop - first * BLOCK]
