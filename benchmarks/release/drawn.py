"""Wrenches and rotor speeds that depend on the vehicle's matrix and bounds alone.

Both versions of a comparison get the same numbers, whatever their classes are called.
"""

from typing import Any

import numpy as np

KINDS = 'flight', 'uniform', 'beyond'


def wrenches(problem: Any, kind: str, size: int, seed: int = 0) -> Any:
    """Return wrenches (size, m) of a problem [N, N m].

    - ``flight``: close to each other, about thrusts in the middle of their bounds
    - ``uniform``: attainable, from thrusts drawn uniformly within their bounds
    - ``beyond``: from the middle, 1.5 to 3 times as far as the largest attainable wrench
    """
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    gamma, low, high = (np.asarray(getattr(problem, x)) for x in ('gamma', 'lower', 'upper'))
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    if kind == 'uniform':
        return (middle + half * rng.uniform(-1.0, 1.0, (size, len(half)))) @ gamma.T
    if kind == 'flight':
        phases = np.linspace(0.0, 6.0 * np.pi, size)[:, None] + rng.uniform(0.0, 6.0, len(half))
        return (middle + 0.3 * half * np.sin(phases)) @ gamma.T
    directions = rng.normal(size=(size, len(gamma))) * (np.abs(gamma) @ half)
    reach = np.abs(directions @ gamma) @ half / np.sum(directions**2, axis=1)
    return gamma @ middle + directions * (rng.uniform(1.5, 3.0, size) * reach)[:, None]


def speeds(vehicle: Any, size: int, seed: int = 0) -> Any:
    """Return rotor speeds (size, n) within the bounds [rad/s]."""
    low, high = (np.asarray(each) for each in vehicle.speed_limits)
    return np.random.default_rng(seed).uniform(low, high, (size, len(low)))
