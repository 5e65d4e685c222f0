"""Sets of wrenches: samples of the admissible set and around it."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet

BLOCK = 1000  # samples of one seed, so that sample i depends on seed and i alone

SAMPLINGS = {
    'volume': 'drawn uniformly by volume in the admissible set',
    'thrusts': 'given by thrusts that are drawn uniformly in their bounds',
    'boundary': 'drawn by volume and projected from the centre onto the boundary of the set',
    'outside': 'drawn by volume and moved away from the centre of the set, to between one and two '
    'times the distance of its boundary; none is attainable',
}

DEPTHS = (1e-3, 1e-6, 1e-9)  # of `near_boundary`, relative to the distance from the centre


def samples(admissible: AdmissibleSet, sampling: str, seed: int, start: int, stop: int) -> Array:
    """Return samples `start` to `stop`, excluding the last, (stop - start, m) [N, N m]."""
    first, end = start // BLOCK, -(-stop // BLOCK)
    rngs = [np.random.default_rng([seed, k]) for k in range(first, end)]
    blocks = np.concatenate([_block(admissible, sampling, rng) for rng in rngs])
    return blocks[start - first * BLOCK : stop - first * BLOCK]


def _block(admissible: AdmissibleSet, sampling: str, rng: np.random.Generator) -> Array:
    problem, center = admissible.problem, admissible.center
    if sampling == 'thrusts':
        problem.program.refuse_vectors('the sampling thrusts', 'volume takes both')
        return rng.uniform(problem.lower, problem.upper, (BLOCK, problem.n)) @ problem.gamma.T
    wrenches = admissible.sample(rng, BLOCK)
    if sampling in ('boundary', 'outside'):
        offsets = wrenches - center
        wrenches = center + offsets / problem.attainable_set.gauge(center + offsets)[:, None]
        if sampling == 'outside':
            wrenches = center + (wrenches - center) * (2.0 - rng.random((BLOCK, 1)))
    return wrenches


def near_boundary(admissible: AdmissibleSet, rng: np.random.Generator, size: int) -> Array:
    """Draw wrenches (size, m) inside, on and outside the boundary, in turn [N, N m]."""
    center = admissible.center
    offsets = admissible.sample(rng, size) - center
    offsets /= admissible.problem.attainable_set.gauge(center + offsets)[:, None]
    side = np.arange(size) % 3 - 1
    return center + offsets * (1.0 + side * rng.choice(DEPTHS, size))[:, None]
