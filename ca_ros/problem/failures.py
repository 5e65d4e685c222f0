"""Failures of effectors: what health and what sticks leave of their bounds."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import Box
from ca_ros.vehicle.motors import HEALTH_MIN
from ca_ros.vehicle.validation import health_of


def shares_of(health: ArrayLike, count: int) -> Array:
    """Return the share (count,) of its effect that each effector still has, 0 if it is lost.

    Raises a ParameterError if there is not one number in [0, 1] for each.
    """
    shares = health_of('health', health, count, 'effector')
    return np.where(shares < HEALTH_MIN, 0.0, shares)


def bounds_after(
    sets: Box, shares: Array, stuck: Mapping[int, float], resting: Array, names: Sequence[str]
) -> Box:
    """Return the bounds of effectors after failures: those without effect rest, and some stick.

    - `shares`: see `shares_of`
    - `stuck`: by effector, from 1, the value at which it stays
    - `resting` (n,): the value of each effector at rest

    Raises a ParameterError if an effector cannot stick there.
    """
    lower, upper = sets.lower.copy(), sets.upper.copy()
    if not isinstance(stuck, Mapping):
        raise ParameterError(
            f'stuck: expected values by effector, such as {{4: 0.1}}, got {stuck!r}')
    for effector, value in stuck.items():
        i, n = effector - 1, len(lower)
        if not 0 <= i < n:
            raise ParameterError(f'stuck: no effector {effector}; there are {n}')
        if not lower[i] <= value <= upper[i]:
            raise ParameterError(
                f'stuck: {names[i]} at {value!r}: expected a value within its bounds, '
                f'{lower[i]:.4g} to {upper[i]:.4g}'
            )
        lower[i] = upper[i] = value
    rest = (shares == 0.0) & (lower < upper)
    lower[rest] = upper[rest] = resting[rest]
    return Box(lower, upper)
