"""Coaxial arms: pairs of rotors that motion hardly tells apart."""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array


def as_effectors(
    health: Array, given: Array, error: Array, arms: Sequence[tuple[int, int]]
) -> tuple[Array, Array, Array]:
    """Return the same where each named arm is one effector: both of its rotors show its mean.

    `health` (n,), and `given` and `error` (T, 6, n): see `HypothesisTest.signatures`.
    """
    health, given, error = health.copy(), given.copy(), error.copy()
    for pair in map(list, arms):
        health[pair] = health[pair].sum()
        given[:, :, pair] = given[:, :, pair].mean(axis=2, keepdims=True)
        error[:, :, pair] = error[:, :, pair].mean(axis=2, keepdims=True)
    return health, given, error


def compared(
    lacked: Array, variance: Array, given: Array, error: Array,
    arms: Sequence[tuple[int, int]], lost: Array,
) -> Array:
    """Return for each arm the evidence that its first rotor has failed, less that of its second.

    It is that of the window that shows most.  Of the two rotors of each other arm the likelier one
    has failed: if the reaction torques of two failed rotors cancel, neither arm shows which.

    - `lacked` and `variance` (T, 6): see `HypothesisTest.__call__`
    - `given` and `error` (T, 6, n): see `HypothesisTest.signatures`
    - `lost` (m,): what both rotors of each arm are taken to have lost
    """
    first, second = np.array(arms).T
    apart = lost * (given[:, :, first] - given[:, :, second])
    wider = variance + 4.0 * (lost**2 * error[:, :, first]).sum(axis=2)
    own = (apart * (lacked / wider)[:, :, None]).sum(axis=1)
    both = np.einsum('tka,tkb,tk->tab', apart, apart, 1.0 / wider)
    others = abs(own[:, None] + both) - abs(own[:, None] - both)
    others[:, range(len(arms)), range(len(arms))] = 0.0
    ratios = others.sum(axis=2) - 2.0 * own
    return np.asarray(ratios[abs(ratios).argmax(axis=0), range(len(arms))])


def unknown(given: Array, arms: Sequence[tuple[int, int]], lost: Array) -> Array:
    """Return the variance (T, 6) of what arms lack, since which rotor has failed is unknown.

    `given`, `arms` and `lost`: see `compared`.
    """
    first, second = np.array(arms, int).reshape(-1, 2).T
    return np.asarray(((lost * (given[:, :, first] - given[:, :, second])) ** 2).sum(axis=2))
