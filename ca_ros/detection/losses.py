"""What the loss of a share of its thrust explains, for each rotor."""

from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array

LIMIT = 20.0
"""Evidence from which a rotor is named."""

PRIOR = 6.25
"""The share lost is taken as uniform from 0 to 1.  Its likelihood has an integral of
sqrt(2 pi / information); 2 pi is rounded."""

NEAR = 0.5  # evidence of windows that show the share lost, over that of the best

GIVING = 1.0
"""What is added to positive evidence for a rotor that gives more than commanded: if its speed is
stuck, it has nearly the wrench that the loss of the opposite rotor has."""


@dataclass(frozen=True, eq=False)
class Losses:
    """What the loss of each rotor explains in each window, (T, n) but for `excess`.

    - `evidence`: see `Finding`
    - `excess` (T,): the same for the likeliest rotor that gives more than commanded
    - `shares`: the likeliest loss, within [0, health]
    - `raw` and `errors`: the loss without bounds, and its standard deviation
    """

    evidence: Array
    excess: Array
    shares: Array
    raw: Array
    errors: Array

    def telling_window(self, rotor: int) -> int:
        """Return the window that shows how much a rotor lost.

        Of those that show its loss, it is the one with the greatest share: longer ones began
        before the loss.
        """
        evidence = self.evidence[:, rotor]
        likely = evidence >= NEAR * evidence.max()
        return int(np.where(likely, self.shares[:, rotor], -1.0).argmax())


def least_shares(ages: Array, given: Array, peaks: Array) -> Array:
    """Return the least share (T, n) that each rotor may have lost, 0 or negative.

    A negative share says that the rotor gives more than commanded: at most its peak thrust.

    `ages`, `given` (T, 6, n) and `peaks`: see `HypothesisTest.__call__`.
    """
    most = ages[:, None] * peaks
    # A rotor that is commanded hardly any thrust has a large share, but a finite one.
    own = np.maximum(np.linalg.norm(given[:, :3], axis=1), 0.01 * most + 1e-9)
    return np.minimum(1.0 - most / own, 0.0)


def losses_of(
    lacked: Array, signature: Array, error: Array, variance: Array, seen: Array,
    least: Array, health: Array,
) -> Losses:
    """Return the evidence for the loss of each rotor.

    - `lacked` and `variance` (T, 6), and `health` (n,): see `HypothesisTest.__call__`
    - `signature` and `error` (T, 6, n): what each rotor gives, and its variance
    - `seen` (T,): chi squared of what is lacked
    - `least` (T, n): see `least_shares`
    """
    def products(weights: Array) -> tuple[Array, Array]:
        return (
            -np.einsum('tki,tk,tki->ti', weights, lacked, signature),
            np.einsum('tki,tki->ti', weights, signature**2) + 1e-12)

    product, norm = products(1.0 / (variance[:, :, None] + error))
    raw, errors = product / norm, norm**-0.5
    lower, upper = np.where(raw < 0.0, least, 0.0), np.where(raw < 0.0, 0.0, health)
    first = np.minimum(np.maximum(raw, lower), upper)
    wider = variance[:, :, None] + first[:, None, :] ** 2 * error
    product, norm = products(1.0 / wider)
    shares = np.minimum(np.maximum(product / norm, lower), upper)
    rest = (lacked[:, :, None] ** 2 / wider).sum(axis=1)
    ratios = (wider / variance[:, :, None]).prod(axis=1) * np.maximum(1.0, norm / PRIOR)
    explained = seen[:, None] - rest + shares * (2.0 * product - shares * norm)
    each, less = 0.5 * (explained - np.log(ratios)), first > 0.0
    excess = np.where((first < 0.0) & (each > 0.0), each + GIVING, 0.0).max(axis=1)
    return Losses(
        np.where(less, each, 0.0), excess, np.where(less, shares, 0.0), raw, errors)
