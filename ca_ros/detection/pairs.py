"""Two rotors that fail at once, and what they explain of an impulse."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.losses import PRIOR

LEAST_LOSS = 0.4  # least share that each of two rotors lost, and one that is slow
MOST_LOSS = 1.3  # the greatest of each of two, over its health

ALIKE = 0.7
"""Least share that one of two rotors lost, over that of the other: they fail at once.  Where one
loses much less, it makes up for what the other does not explain."""

PAIRED = 0.1
"""Share of the variance of thrusts that counts for pairs, which differ by less."""


@dataclass(frozen=True, eq=False)
class Pair:
    """The likeliest two rotors.

    - `rotors`
    - `lost` (2,): the share of its thrust that each lost, at most its health
    - `evidence`: logarithm of the Bayes factor of both failures against nothing; 0 if no two
      rotors can have failed
    - `lead`: of this evidence over that of the next two that are not of the same arms
    - `leads` (2,): of this evidence over that with the partner in the place of each of the two
    - `wrench` (6,): what is lost
    """

    rotors: tuple[int, int]
    lost: Array
    evidence: float
    lead: float
    leads: Array
    wrench: Array


def likeliest_pair(
    lacked: Array, variance: Array, given: Array, error: Array, health: Array,
    partners: Sequence[int | None],
) -> Pair:
    """Return the two rotors whose failures explain a window best.

    - `lacked` and `variance` (6,): the unexplained impulse, and its variance
    - `given` and `error` (6, n): what the rotors give, and its variance; see
      `HypothesisTest.signatures`
    - `health` (n,): 0 for a rotor that is not named
    - `partners`: the other rotor of each coaxial pair
    """
    wider = variance[:, None, None] + error[:, :, None] + error[:, None, :]
    product = -np.einsum('ki,k,kij->ij', given, lacked, 1.0 / wider)
    norm = np.einsum('ki,kij->ij', given**2, 1.0 / wider)
    mixed = np.einsum('ki,kj,kij->ij', given, given, 1.0 / wider)
    rest = np.einsum('k,kij->ij', lacked**2, 1.0 / variance[:, None, None] - 1.0 / wider)
    determinant = norm * norm.T - mixed**2
    # Rotors with parallel wrenches cannot be told apart.
    apart = determinant > 1e-6 * norm * norm.T
    first = np.where(apart, norm.T * product - mixed * product.T, 0.0)
    first = first / np.where(apart, determinant, 1.0)
    lost = first >= LEAST_LOSS * np.maximum(health, 1e-9)[:, None]
    relative = first * health
    alike = relative >= ALIKE * relative.T
    possible = lost & lost.T & alike & (first <= MOST_LOSS * health[:, None])
    taken = first * product
    prior = np.maximum(1.0, norm / PRIOR)
    ratio = (wider / variance[:, None, None]).prod(axis=0) * prior * prior.T
    scores = 0.5 * (rest + taken + taken.T - np.log(ratio))
    scores = np.triu(np.where(possible & possible.T, scores, 0.0), 1)
    scores = scores + scores.T
    i, j = (int(k) for k in np.unravel_index(scores.argmax(), scores.shape))
    evidence, shares = float(scores[i, j]), np.array([first[i, j], first[j, i]])
    # Those of the same two arms are no rivals.
    one, other = ([k for k in (rotor, partners[rotor]) if k is not None] for rotor in (i, j))
    if j in one:
        one, other = [i], [j]
    same = scores[np.ix_(one, other)]
    scores[np.ix_(one, other)] = scores[np.ix_(other, one)] = 0.0
    swapped = np.array([same[1:].max(initial=0.0), same[:, 1:].max(initial=0.0)])
    return Pair(
        (i, j), np.minimum(shares, health[[i, j]]), evidence, evidence - float(scores.max()),
        evidence - swapped, given[:, [i, j]] @ shares)
