"""What effectors reach from their last values at given rates."""

from typing import Any

import numpy as np

from ca_ros.arrays import Array


def reached(
    last: Array, period: Any, up: Array, down: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return the least and greatest values (n,) that are reached in a period [s], within bounds.

    `up` is the greatest rate at which a value grows in size, and `down` at which it shrinks, (n,).
    The kernel computes the same bits (`ca_reach`), in the precision of the arrays.
    """
    start = np.minimum(np.maximum(last, low), high)
    return (
        np.maximum(_slowed(start, period, up, down), low),
        np.minimum(-_slowed(-start, period, up, down), high),
    )


def _slowed(start: Array, period: Any, up: Array, down: Array) -> Array:
    """Return the least values (n,); past zero they grow again, in the other direction."""
    change = down * period
    beyond = -up * (period - start / down)
    braked = np.where(change <= start, start - change, beyond)
    return np.where(start <= 0.0, start - up * period, braked)
