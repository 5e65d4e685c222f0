"""The test for servos that stick: which angle explains an unexplained impulse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.tilts import Tilts

ANGLES = 101  # angles that are tested of each servo


@dataclass(frozen=True)
class StuckServo:
    """A servo that may stick.

    - `rotor`: its rotor
    - `angle`: the likeliest one [rad]
    - `score`: see `Finding`
    - `window`: in which it has this score
    - `share`: change of the rotor's force, over its thrust
    """

    rotor: int
    angle: float
    score: float
    window: int
    share: float


class StuckServos:
    """A generalized likelihood ratio test over servos, angles and windows of time.

    A rotor with a single servo that sticks at an angle a gives cos(a) p + sin(a) q, where p and q
    are its impulses at the angle zero and after a quarter turn, instead of those at the commanded
    angles.

    `tilts`: of a vehicle with at least one rotor that has a single servo.
    """

    def __init__(self, tilts: Tilts) -> None:
        self._rotors = tilts.planar
        ends = tilts.lower[self._rotors], tilts.upper[self._rotors]
        self._angles = np.linspace(*ends, ANGLES)

    def __call__(
        self, lacked: Array, weights: Array, given: Array, health: Array
    ) -> tuple[Array, StuckServo]:
        """Return the score for each rotor (n,), zero without a single servo, and the likeliest.

        - `lacked` (T, 6), `given` (T, 6, n + 2 s) and `health` (n,): as of `FailureTest`
        - `weights` (T, 6): one over the variance of what is lacked
        """
        n, rotors = len(health), self._rotors
        own, p, q = given[:, :, rotors], *np.split(given[:, :, n:], 2, axis=2)
        own, p, q = (health[rotors] * each for each in (own, p, q))
        rest = lacked[:, :, None] + own

        def product(a: Array, b: Array) -> Array:
            return np.einsum('tk,tks,tks->ts', weights, a, b)

        cosine, sine = np.cos(self._angles)[:, None], np.sin(self._angles)[:, None]
        seen = np.einsum('tk,tk->t', weights, lacked**2)[:, None]
        left = (
            product(rest, rest) - 2.0 * (cosine * product(rest, p) + sine * product(rest, q))
            + cosine**2 * product(p, p) + sine**2 * product(q, q)
            + 2.0 * cosine * sine * product(p, q)
        )
        scores = seen - left
        i, window, servo = np.unravel_index(scores.argmax(), scores.shape)
        angle = float(self._angles[i, servo])
        force = np.cos(angle) * p[window, :3, servo] + np.sin(angle) * q[window, :3, servo]
        moved = float(np.linalg.norm(force - own[window, :3, servo]))
        share = moved / max(float(np.linalg.norm(force)), 1e-12)
        best = np.zeros(n)
        best[rotors] = scores.max(axis=(0, 1))
        likeliest = StuckServo(
            rotors[servo], angle, float(scores.max()), int(window), share
        )
        return best, likeliest
