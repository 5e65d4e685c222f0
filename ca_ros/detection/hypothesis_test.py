"""The test for failures: which lost thrust, or servo that sticks, explains an impulse."""

from dataclasses import dataclass
from math import log

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.vehicle.servos import Servos

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


def stuck_servos(
    servos: Servos, lacked: Array, weights: Array, given: Array, health: Array
) -> tuple[Array, StuckServo]:
    """Return the score for each rotor (n,), zero without a single servo, and the likeliest.

    It is a generalized likelihood ratio test over servos, angles and windows of time.  A rotor
    with a single servo that sticks at an angle a gives cos(a) p + sin(a) q, where p and q are its
    impulses at the angle zero and after a quarter turn, instead of those at the commanded angles.

    - `servos`: with at least one rotor that has a single servo
    - `lacked` (T, 6), `given` (T, 6, n + 2 s) and `health` (n,): as of `FailureTest`
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
    scores = seen - left
    i, window, servo = np.unravel_index(scores.argmax(), scores.shape)
    angle = float(angles[i, servo])
    force = np.cos(angle) * p[window, :3, servo] + np.sin(angle) * q[window, :3, servo]
    moved = float(np.linalg.norm(force - own[window, :3, servo]))
    share = moved / max(float(np.linalg.norm(force)), 1e-12)
    best = np.zeros(n)
    best[rotors] = scores.max(axis=(0, 1))
    return best, StuckServo(rotors[servo], angle, float(scores.max()), int(window), share)


EXPLAINED = 0.7  # least share of what is seen that a failure explains
NEAR = 4.0  # windows whose score is this many standard deviations below the best are as likely


LEVER = 0.6
"""Least lever of the wrench that two failing rotors take, over that of one rotor: one with a
shorter lever may be a load, too."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What a test finds.

    - `score`: twice the logarithm of the likelihood ratio of the likeliest rotor against no
      failure
    - `rotor`: the likeliest rotor
    - `probabilities` (n,): that each rotor, and no other, has failed
    - `named`: rotors that have failed with the wanted certainty
    - `lost`: share of the thrust of a sound rotor that each has lost
    - `angle`: at which the servo of the named rotor sticks [rad]; None: the rotor has failed
    - `window`: the shortest likely one
    - `shares` and `errors` (n,): in the longest window, the share that each rotor alone would have
      lost, which may be negative, and its standard deviation
    """

    score: float
    rotor: int
    probabilities: Array
    named: tuple[int, ...]
    lost: Array
    angle: float | None
    window: int
    shares: Array
    errors: Array


class FailureTest:
    """A generalized likelihood ratio test over rotors and windows of time.

    For each window since when a rotor i may have failed there are an unexplained impulse c (6,)
    and the impulse s_i (6,) of each sound rotor.  With the variance of c, the least-squares share
    lost is theta_i = -(s_i, c) / (s_i, s_i), within [0, health_i], and the score is
    theta_i (-2 (s_i, c) - theta_i (s_i, s_i)), the greatest of all windows (Willsky and Jones,
    IEEE Trans. Automatic Control 21, 1976).  A rotor is named if its score is over the limit of
    the false alarms, explains most of what is seen, and is over that of any other rotor by the
    odds of the wanted certainty.  Servos that stick compete with the rotors: see `stuck_servos`.
    If no single rotor explains what is seen, all pairs are tested whose loss cannot be a load.

    - `wrenches` (6, n): force and torque per thrust of each rotor
    - `servos`: of the rotors
    - `tests`: tests in an hour
    """

    def __init__(
        self, wrenches: Array, servos: Servos, tests: float, settings: DetectorSettings
    ) -> None:
        # Here, as the import takes half a second, and only who detects failures needs it.
        from scipy.special import chdtri

        share = min(1.0, settings.false_alarms / (tests * wrenches.shape[1]))
        self.limit = float(chdtri(1.0, share))
        self.odds = 2.0 * log(settings.certainty / (1.0 - settings.certainty))
        self.lever = LEVER * float(np.linalg.norm(wrenches[3:], axis=0).mean())
        self._least_loss = settings.least_loss
        self._servos = servos

    def __call__(self, lacked: Array, given: Array, variance: Array, health: Array) -> Finding:
        """Test windows.

        - `lacked` and `variance` (T, 6): the unexplained impulse of each window, and its variance
        - `given` (T, 6, n + 2 s): the impulses of the rotors, see `CommandedRotors.given`
        - `health` (n,)
        """
        weights, everything, given = 1.0 / variance, given, given[:, :, : len(health)]
        products = -np.einsum('tk,tki->ti', weights * lacked, given)
        squares = np.einsum('tk,tki->ti', weights, given**2) + 1e-12
        raw = products / squares
        shares = np.minimum(np.maximum(raw, 0.0), health)
        scores = shares * (2.0 * products - shares * squares)
        best = scores.max(axis=0)
        rotor = int(best.argmax())
        score, window = float(best[rotor]), int(scores[:, rotor].argmax())
        stuck = None
        if self._servos.planar:
            of_servos, stuck = stuck_servos(self._servos, lacked, weights, everything, health)
            best = np.maximum(best, of_servos)
            seen = float(weights[stuck.window] @ lacked[stuck.window] ** 2)
            if stuck.score > max(score, EXPLAINED * seen):
                rotor, score, window = stuck.rotor, stuck.score, stuck.window
            else:
                stuck = None
        top = max(self.limit, score)
        likelihoods = np.exp(0.5 * (best - top))
        none = np.exp(0.5 * (self.limit - top))
        named: tuple[int, ...] = ()
        lost, angle = np.zeros(0), None
        if score > self.limit:
            seen = float(weights[window] @ lacked[window] ** 2)
            rivals = best.copy()
            rivals[rotor] = self.limit
            leads = score - rivals.max() > self.odds
            if stuck is not None:
                if leads and stuck.share >= self._least_loss:
                    named, lost, angle = (rotor,), health[[rotor]], stuck.angle
            elif score > EXPLAINED * seen:
                likely = scores[:, rotor] >= score - NEAR * score**0.5
                window = int(np.where(likely, shares[:, rotor], -1.0).argmax())
                share = shares[window, rotor]
                if leads and share >= self._least_loss * health[rotor]:
                    named, lost = (rotor,), np.array([share])
            else:
                named, lost = self._pair(
                    products[window], squares[window], weights[window], given[window], seen, health
                )
        return Finding(
            score, rotor, likelihoods / (none + likelihoods.sum()), named, lost, angle, window,
            raw[-1], squares[-1] ** -0.5,
        )

    def _pair(
        self, products: Array, squares: Array, weights: Array, given: Array, seen: float,
        health: Array,
    ) -> tuple[tuple[int, ...], Array]:
        """Return the two rotors whose failures explain a window, and what they lost, if any."""
        mixed = (given.T * weights) @ given
        determinant = np.outer(squares, squares) - mixed**2
        # Rotors with parallel wrenches cannot be told apart.
        apart = determinant > 1e-6 * np.outer(squares, squares)
        first = squares[None, :] * products[:, None] - mixed * products[None, :]
        first = np.where(apart, first, 0.0) / np.where(apart, determinant, 1.0)
        lost = first >= self._least_loss * np.maximum(health, 1e-9)[:, None]
        possible = lost & lost.T & (first <= 1.3 * health[:, None])
        scores = first * products[:, None]
        scores = np.where(possible & possible.T, scores + scores.T, 0.0)
        upper = np.triu(scores, 1)
        i, j = (int(k) for k in np.unravel_index(upper.argmax(), upper.shape))
        score, upper[i, j] = upper[i, j], 0.0
        rival = max(float(upper.max()), self.limit)
        if score - rival <= self.odds or score <= EXPLAINED * seen:
            return (), np.zeros(0)
        taken = given[:, [i, j]] @ [first[i, j], first[j, i]]
        force, torque = taken.reshape(2, 3)
        if np.linalg.norm(torque) < self.lever * np.linalg.norm(force):
            return (), np.zeros(0)
        return (i, j), np.minimum([first[i, j], first[j, i]], health[[i, j]])
