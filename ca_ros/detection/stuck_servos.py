"""Servos that stick, and what they explain of an impulse."""

from dataclasses import dataclass
from math import log

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.servos import Servos

ANGLES = 101  # angles that are tested of each servo


@dataclass(frozen=True)
class StuckServo:
    """A servo that may stick.

    - `rotor`: its rotor
    - `angle`: the likeliest one [rad]
    - `evidence`: see `Finding`
    - `window`: in which it has this evidence
    - `share`: change of the rotor's force, over its thrust
    """

    rotor: int
    angle: float
    evidence: float
    window: int
    share: float


def stuck_servos(
    servos: Servos, lacked: Array, weights: Array, given: Array, health: Array
) -> tuple[Array, StuckServo]:
    """Return the evidence for each rotor (n,), zero without a single servo, and the likeliest.

    All angles within the bounds of a servo are as likely before.  A rotor with a single servo that
    sticks at an angle a gives cos(a) p + sin(a) q, where p and q are its impulses at the angle
    zero and after a quarter turn, instead of those at the commanded angles.

    - `servos`: with at least one rotor that has a single servo
    - `lacked` (T, 6), `given` (T, 6, n + 2 s) and `health` (n,): as of `HypothesisTest`
    - `weights` (T, 6): one over the variance of what is lacked
    """
    n, rotors = len(health), servos.planar
    angles = np.linspace(servos.lower[rotors], servos.upper[rotors], ANGLES)
    own, p, q = given[:, :, rotors], *np.split(given[:, :, n:], 2, axis=2)
    own, p, q = (health[rotors] * each for each in (own, p, q))
    rest = lacked[:, :, None] + own

    def product(a: Array, b: Array) -> Array:
        return np.einsum('tk,tks,tks->ts', weights, a, b)

    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    seen = np.einsum('tk,tk->t', weights, lacked**2)[:, None]
    left = (
        product(rest, rest) - 2.0 * (cosine * product(rest, p) + sine * product(rest, q))
        + cosine**2 * product(p, p) + sine**2 * product(q, q)
        + 2.0 * cosine * sine * product(p, q)
    )
    evidence = 0.5 * (seen - left) - log(ANGLES)
    i, window, servo = np.unravel_index(evidence.argmax(), evidence.shape)
    angle = float(angles[i, servo])
    force = np.cos(angle) * p[window, :3, servo] + np.sin(angle) * q[window, :3, servo]
    moved = float(np.linalg.norm(force - own[window, :3, servo]))
    share = moved / max(float(np.linalg.norm(force)), 1e-12)
    best = np.zeros(n)
    best[rotors] = np.maximum(evidence.max(axis=(0, 1)), 0.0)
    return best, StuckServo(rotors[servo], angle, float(evidence.max()), int(window), share)
