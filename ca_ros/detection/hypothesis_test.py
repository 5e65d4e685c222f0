"""The test for failures: what explains an impulse: lost thrust, a stuck servo, a disturbance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.detection.stuck_servos import stuck_servos
from ca_ros.detection.windows import WINDOWS
from ca_ros.vehicle.vehicle import Vehicle

CLEAR_LOSS = 0.5  # least share of its thrust that a rotor lost which is named at once
LEAST_LOSS = 0.4  # the same of each of two rotors, and of one that is slow
LEAST_TURN = 0.25  # least change of force over thrust of a rotor whose servo sticks
WEAK_LOSS = 0.3  # the same, in one of the windows, of one that leads for long

ASKED = 0.75
"""Least thrust of a rotor that is named, as commanded, over its usual one, which is taken as that
of hover at most, and as half of that at least."""

THRUST_ERROR = 0.1  # relative standard deviation of the thrust of each rotor

DRAG_LOST = 0.5
"""Share of its drag that a failing rotor loses, and the standard deviation of this: a weak one
keeps its drag, and one without a propeller loses it."""

LIMIT = 20.0
"""Evidence from which a rotor is named."""

ODDS = 5.3
"""Lead of the evidence over that of each other rotor: the odds of a probability of 0.995."""

TELLING = 5.3
"""Evidence for one rotor of a named arm against the other one."""

MARGIN = 4.0
"""Lead of the evidence over that of a disturbance."""

CONTACT = 4.0
"""Evidence for the ground where the vehicle is pushed up: a lost rotor lets it drop, and feet
touch the ground more often than rotors are lost."""

LASTING, SEEN = 4.0, 15.0
"""Lead that a weak rotor gathers, and its evidence in the longest window, from which it is
named."""

EXCESS, DOUBT, DEBT = 1.2, 3.0, 15.0
"""A rotor that would lack so much of its health, in the window in which a disturbance is likeliest
and leads it by `DOUBT`, owes a lead of `DEBT` before it is named: it gives no more than it has."""

PRIOR = 6.25
"""The share lost is taken as uniform from 0 to 1.  Its likelihood has an integral of
sqrt(2 pi / information); 2 pi is rounded."""

NEAR = 2.83  # windows with less evidence than the best by this times its root are as likely

PAIRED = 0.1
"""Share of the variance of thrusts that counts for pairs, which differ by less."""

PAIR_ODDS = 1.0  # lead of a pair from which a rotor alone is not named

LEVER = 0.36
"""Least lever of the wrench that two failing rotors take, over that of one rotor: one with a
shorter lever may be a load, too."""

COAXIAL = 0.1
"""Two rotors are a coaxial pair if their forces per thrust, and their roll and pitch over the mean
arm, differ by less."""

SLACK = 0.1  # side forces and yaw of a contact, over those of a push


def partners(wrenches: Array, arm: float) -> list[int | None]:
    """Return for each rotor the other one of its coaxial pair, if any.

    - `wrenches` (6, n): force and torque per thrust of each rotor
    - `arm`: mean distance of the rotors [m]
    """
    sizes = np.array([1.0, 1.0, 1.0, arm, arm])[:, None, None]
    found: list[int | None] = []
    away = np.linalg.norm((wrenches[:5, :, None] - wrenches[:5, None, :]) / sizes, axis=0)
    np.fill_diagonal(away, np.inf)
    for i, row in enumerate(away):
        j = int(row.argmin())
        found.append(j if row[j] < COAXIAL and away[j].argmin() == i else None)
    return found


def _least_shares(ages: Array, given: Array, peaks: Array) -> Array:
    """Return the least share (T, n) that each rotor may have lost, 0 or negative.

    A negative share says that the rotor gives more than commanded: at most its peak thrust.

    `ages`, `given` (T, 6, n) and `peaks`: see `HypothesisTest.__call__`.
    """
    most = ages[:, None] * peaks
    # A rotor that is commanded hardly any thrust has a large share, but a finite one.
    own = np.maximum(np.linalg.norm(given[:, :3], axis=1), 0.01 * most + 1e-9)
    return np.minimum(1.0 - most / own, 0.0)


@dataclass(frozen=True, eq=False)
class Finding:
    """What a test finds.

    - `evidence` (n,): logarithm of the Bayes factor of the failure of each rotor against nothing
    - `disturbance`: the same of a disturbance, or of a rotor that gives more than commanded
    - `rotor`: the likeliest rotor
    - `named`: rotors that have failed with the wanted certainty
    - `arm`: whether only one of both has failed, and which one does not show
    - `lost`: share of the thrust of a sound rotor that each has lost
    - `angle`: at which the servo of the named rotor sticks [rad]; None: the rotor has failed
    - `window`: the shortest likely one
    - `leads` (n,): what each rotor has gathered; see `HypothesisTest`
    - `lasting`: whether these name the rotor
    - `shares` and `errors` (n,): in the longest window, the share that each rotor alone would have
      lost, which may be negative, and its standard deviation
    """

    evidence: Array
    disturbance: float
    rotor: int
    named: tuple[int, ...]
    arm: bool
    lost: Array
    angle: float | None
    window: int
    leads: Array
    lasting: bool
    shares: Array
    errors: Array

    @property
    def greatest(self) -> float:
        """The greatest evidence."""
        return max(float(self.evidence.max()), self.disturbance)

    @property
    def probabilities(self) -> Array:
        """Probabilities (n + 1,): that each rotor has failed; and of a disturbance."""
        each = np.append(self.evidence, self.disturbance)
        likelihoods = np.exp(each - self.greatest)
        return np.asarray(likelihoods / (np.exp(-self.greatest) + likelihoods.sum()))


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


class HypothesisTest:
    """Compares the failure of each rotor with a free disturbance, over windows of time.

    In a window with the unexplained impulse c (6,) and its variance S (6,), the hypotheses are

    - nothing: c ~ N(0, S);
    - a disturbance: c ~ N(0, S + D).  D is that of a force of a rotor's size in any direction,
      with a lever of the mean arm: a push, a gust, a load.  Where the vehicle is pushed up, it may
      also be a contact with the ground, whose D has a tenth of the side forces and of the yaw,
      and whose evidence is `CONTACT` greater;
    - the loss of a share theta of rotor i: c ~ N(-theta s_i, S + theta^2 E_i).  s_i (6,) is what
      the sound rotor gives, its thrust and half of its drag, and E_i the variance of this.
      theta is the likeliest one within [0, health_i], and its prior is uniform.  A rotor whose
      speed is stuck may give more than it is commanded, at most what it gave in the last second.
      theta is then negative, and the evidence counts as that of a disturbance: it names nobody.

    The evidence for each is the greatest logarithm of its Bayes factor against nothing in any
    window (Kass and Raftery, Bayes factors, J. American Statistical Association 90, 1995).  A
    rotor is named if its evidence is over `LIMIT`, leads that of each other rotor by `ODDS`, and
    that of the disturbance by `MARGIN`, and it lost `CLEAR_LOSS` of its thrust.

    What loses less shows in time: windows that do not overlap are independent, so their evidence
    adds up.  In the longest window, the lead of each rotor over all else is gathered, as its
    integral over the length of the window, not below zero; `LASTING` of it names a rotor.  A push
    down on the end of an arm begins with more than a rotor can lack, and lets it owe `DEBT`:
    later, when the controller has answered, the same push may look like a loss.

    If the rotor does not lead its partner of a coaxial pair, the
    arm is named, until `of_arm` tells which one has failed.  Servos that stick compete with the
    rotors: see `stuck_servos`.

    Pairs of rotors are tested where a rotor would be named, in its window: the rotor between two
    that are lost explains their torque, and is not named if a pair leads it by `PAIR_ODDS`.  Where
    a disturbance is over `LIMIT` and no rotor leads it, they are tested in the window in which the
    disturbance is likeliest.  A pair is named if it leads a rotor by `ODDS`, a disturbance by
    `MARGIN`, and cannot be a load.

    - `vehicle`
    - `wrenches` (6, n): force and torque per thrust of each rotor
    """

    def __init__(self, vehicle: Vehicle, wrenches: Array) -> None:
        arm = float(np.linalg.norm(vehicle.arms, axis=1).mean())
        yaw = 2.0 * float(np.abs(wrenches[5]).mean())
        levers = np.array([1.0, 1.0, 1.0, arm, arm, yaw])
        self.unit = levers**2
        levers[5] = arm
        contact = levers * [SLACK, SLACK, 1.0, 1.0, 1.0, SLACK]
        self.disturbances = (vehicle.weight / vehicle.n * np.array([levers, contact])) ** 2
        self.lever = LEVER * float(np.linalg.norm(wrenches[3:], axis=0).mean())
        self.partners = partners(wrenches, arm)
        self._arms = vehicle.arms.T
        self._servos = vehicle.servos

    def signatures(
        self, given: Array, lateral: Array, share: float = 1.0
    ) -> tuple[Array, Array]:
        """Return what the sound rotors give in each window, and its variance, both (T, 6, n).

        - `given` (T, 6, n): by their thrusts [N s, N m s]
        - `lateral` (T, 2): the drag along x and y [N s]
        - `share`: of the variance of the thrusts that counts
        """
        drag = self.drags(given, lateral)
        thrusts = share * THRUST_ERROR**2 * (given[:, :3] ** 2).sum(axis=1)
        error = thrusts[:, None, :] * self.unit[:, None] + drag**2
        return given + drag, error

    def drags(self, given: Array, lateral: Array) -> Array:
        """Return the drag that each rotor loses (T, 6, n) [N s, N m s]; see `signatures`.

        Drag goes with the speed of a rotor, here with its thrust.
        """
        thrusts, arms = np.linalg.norm(given[:, :3], axis=1), self._arms
        parts = DRAG_LOST * thrusts / np.maximum(thrusts.sum(axis=1), 1e-9)[:, None]
        x, y = lateral.T[:, :, None] * parts
        rows = [x, y, 0.0 * x, -arms[2] * y, arms[2] * x, arms[0] * y - arms[1] * x]
        return np.stack(rows, axis=1)

    def __call__(
        self, ages: Array, lacked: Array, given: Array, lateral: Array, variance: Array,
        health: Array, peaks: Array, usual: Array, leads: Array, block: float,
        arms: Sequence[int] = (), known: bool = True,
    ) -> Finding:
        """Test windows.

        - `ages` (T,): their lengths [s]
        - `lacked` and `variance` (T, 6): the unexplained impulse of each window, and its variance
        - `given` (T, 6, n + 2 s): the impulses of the rotors, see `CommandedRotors.given`
        - `lateral` (T, 2): see `signatures`
        - `health` (n,)
        - `peaks` (n,): the greatest thrust that each rotor gave about the last second [N]
        - `usual` (n,): the mean thrust of each rotor [N]
        - `leads` (n,): what each rotor has gathered
        - `block`: time since the last test [s]
        - `arms`: rotors of named arms, which are not named again
        - `known`: whether it flies for long enough that no rotor owes a lead for the take-off
        """
        n, longest = len(health), len(ages) - 1
        held, asked = np.isin(np.arange(n), arms), self._asked(ages, given[:, :, :n], usual)
        signature, error = self.signatures(given[:, :, :n], lateral)
        seen = (lacked**2 / variance).sum(axis=1)
        least = _least_shares(ages, given[:, :, :n], peaks)
        losses = self._of_losses(lacked, signature, error, variance, seen, least, health)
        disturbances = np.maximum(
            self._of_disturbances(ages, lacked, variance, seen), losses.excess)
        likeliest = int(disturbances.argmax())
        disturbance = max(float(disturbances[likeliest]), 0.0)
        evidence = np.maximum(losses.evidence.max(axis=0), 0.0)
        servos, servo = np.zeros(n), None
        if self._servos.planar:
            servos, servo = stuck_servos(self._servos, lacked, 1.0 / variance, given, health)
            servo = servo if servo.evidence > evidence.max() else None
            evidence = np.maximum(evidence, servos)
        rotor = int(evidence.argmax()) if servo is None else servo.rotor
        best, window = float(evidence[rotor]), likeliest if servo is None else servo.window
        named: tuple[int, ...] = ()
        lost, angle, arm = np.zeros(0), None, False
        leads_all = best - self._rival(evidence, rotor) > ODDS

        def pairs(t: int) -> tuple[tuple[int, ...], Array, float]:
            return self._pair(
                lacked[t], variance[t], given[t, :, :n], lateral[t], np.where(held, 0.0, health),
                max(best + ODDS, disturbance + MARGIN))

        if best > LIMIT and best - disturbance > MARGIN:
            if servo is not None:
                if leads_all and servo.share >= LEAST_TURN:
                    named, lost, angle = (rotor,), health[[rotor]], servo.angle
            else:
                likely = losses.evidence[:, rotor] >= best - NEAR * best**0.5
                window = int(np.where(likely, losses.shares[:, rotor], -1.0).argmax())
                share = losses.shares[window, rotor]
                clear = share >= CLEAR_LOSS * health[rotor] and asked[window, rotor]
                if leads_all and clear and not held[rotor] and leads[rotor] >= 0.0:
                    # The rotor between two lost ones explains their torque.
                    named, lost, score = pairs(window)
                    if not named and best > score - PAIR_ODDS:
                        named, lost, arm = self._name(rotor, share, evidence)
        elif disturbance > LIMIT:
            named, lost, _ = pairs(likeliest)
        last = losses.evidence[longest]
        leads = self._gather(leads, block, last, servos, max(float(disturbances[longest]), 0.0))
        if known and disturbance > LIMIT:
            owes = (losses.raw[likeliest] > EXCESS * health) & (evidence > LIMIT)
            leads = np.where(owes & (disturbance - evidence > DOUBT), -DEBT, leads)
        top = int(leads.argmax())
        weak = losses.raw[:, top].max() >= WEAK_LOSS * health[top]
        weak = weak and asked[longest, top] and not held[top]
        lasting = bool(not named and leads[top] > LASTING and last[top] > SEEN and weak)
        if lasting:
            rotor, window, share = top, longest, min(losses.raw[longest, top], health[top])
            named, lost, arm = self._name(top, share, leads)
        return Finding(
            evidence, disturbance, rotor, named, arm, lost, angle, window, leads, lasting,
            losses.raw[longest], losses.errors[longest])

    def _of_losses(
        self, lacked: Array, signature: Array, error: Array, variance: Array, seen: Array,
        least: Array, health: Array,
    ) -> Losses:
        """Return the evidence for the loss of each rotor.

        `signature` and `error` (T, 6, n): what it gives, and its variance; `seen` (T,): chi
        squared of what is lacked; `least` (T, n): see `_least_shares`.
        Others: see `__call__`.
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
        excess = np.where(first < 0.0, each, 0.0).max(axis=1)
        return Losses(
            np.where(less, each, 0.0), excess, np.where(less, shares, 0.0), raw, errors)

    def _of_disturbances(
        self, ages: Array, lacked: Array, variance: Array, seen: Array
    ) -> Array:
        """Return the evidence (T,) for the likelier one of a push and a contact with the ground.

        `seen` (T,): chi squared of what is lacked.  Others: see `__call__`.
        """
        disturbed = variance + ages[:, None] ** 2 * self.disturbances[:, None]
        left = (lacked**2 / disturbed).sum(axis=2)
        push, contact = 0.5 * (seen - left - np.log((disturbed / variance).prod(axis=2)))
        contact = np.where(lacked[:, 2] > 0.0, contact + CONTACT, push)
        return np.asarray(np.maximum(push, contact))

    def _gather(
        self, leads: Array, block: float, evidence: Array, servos: Array, disturbance: float
    ) -> Array:
        """Return what each rotor has gathered (n,) after a further time [s].

        `evidence` (n,) and `disturbance` in the longest window; `servos` (n,): that for servos
        that stick.
        """
        n = len(leads)
        others = np.tile(np.maximum(evidence, servos), (n, 1))
        np.fill_diagonal(others, servos)
        for i, partner in enumerate(self.partners):
            if partner is not None:
                others[i, partner] = 0.0
        lead = np.minimum(evidence - np.maximum(others.max(axis=1), disturbance), LIMIT)
        least = np.where(leads < 0.0, -DEBT, 0.0)
        return np.asarray(np.maximum(leads + block / WINDOWS[-1] * lead, least))

    def _asked(self, ages: Array, given: Array, usual: Array) -> BoolArray:
        """Return which rotors (T, n) give enough thrust (T, 6, n) in each window to be named."""
        hover = self.disturbances[0, 0] ** 0.5
        least = ASKED * np.minimum(np.maximum(usual, 0.5 * hover), hover)
        return np.asarray(np.linalg.norm(given[:, :3], axis=1) >= least * ages[:, None])

    def _rival(self, evidence: Array, rotor: int) -> float:
        """Return the greatest evidence (n,) of a rotor that is not this one or its partner."""
        partner, rivals = self.partners[rotor], evidence.copy()
        rivals[[rotor] if partner is None else [rotor, partner]] = 0.0
        return float(rivals.max())

    def _name(
        self, rotor: int, share: float, evidence: Array
    ) -> tuple[tuple[int, ...], Array, bool]:
        """Return a rotor, or the arm of which it is one, what they lost, and whether it is an arm.

        It is the arm if the rotor's evidence (n,) does not lead that of its partner.
        """
        partner = self.partners[rotor]
        if partner is None or evidence[rotor] - evidence[partner] > ODDS:
            return (rotor,), np.array([share]), False
        return (min(rotor, partner), max(rotor, partner)), np.repeat(0.5 * share, 2), True

    def of_arm(
        self, lacked: Array, given: Array, lateral: Array, variance: Array, rotor: int,
        partner: int, lost: float,
    ) -> float:
        """Return the evidence that a rotor of a named arm has failed, less that of its partner.

        `lost`: what both are taken to have lost.  Others: see `__call__`.
        """
        given, error = self.signatures(given[:, :, : len(self.partners)], lateral)
        apart = lost * (given[:, :, rotor] - given[:, :, partner])
        wider = variance + 4.0 * lost**2 * error[:, :, rotor]
        ratios = -2.0 * (apart * lacked / wider).sum(axis=1)
        return float(ratios[abs(ratios).argmax()])

    def _pair(
        self, lacked: Array, variance: Array, given: Array, lateral: Array, health: Array,
        bound: float,
    ) -> tuple[tuple[int, ...], Array, float]:
        """Return two rotors whose failures explain a window, what they lost, and their evidence.

        Only the evidence if it is not over the bound, or they are not named for another reason.
        """
        given, error = (each[0] for each in self.signatures(given[None], lateral[None], PAIRED))
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
        possible = lost & lost.T & (first <= 1.3 * health[:, None])
        taken = first * product
        prior = np.maximum(1.0, norm / PRIOR)
        ratio = (wider / variance[:, None, None]).prod(axis=0) * prior * prior.T
        scores = 0.5 * (rest + taken + taken.T - np.log(ratio))
        upper = np.triu(np.where(possible & possible.T, scores, 0.0), 1)
        i, j = (int(k) for k in np.unravel_index(upper.argmax(), upper.shape))
        score, upper[i, j] = float(upper[i, j]), 0.0
        if score <= max(LIMIT, bound) or score - float(upper.max()) <= ODDS:
            return (), np.zeros(0), score
        force, torque = (given[:, [i, j]] @ [first[i, j], first[j, i]]).reshape(2, 3)
        if np.linalg.norm(torque) < self.lever * np.linalg.norm(force):
            return (), np.zeros(0), score
        return (i, j), np.minimum([first[i, j], first[j, i]], health[[i, j]]), score
