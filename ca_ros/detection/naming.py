"""Which rotors, or arms of them, the evidence of a test names."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.detection.leads import GATHERED, LASTING
from ca_ros.detection.losses import LIMIT, Losses
from ca_ros.detection.pairs import PAIRED, likeliest_pair
from ca_ros.detection.stuck_servos import StuckServo
from ca_ros.vehicle.vehicle import Vehicle

CLEAR_LOSS = 0.35  # least share of its thrust that a rotor lost which is named at once
LEAST_TURN = 0.25  # least change of force over thrust of a rotor whose servo sticks
WEAK_LOSS = 0.3  # least share lost, in one of the windows, by a rotor that leads for long

ASKED = 0.75
"""Least thrust of a rotor that is named, as commanded, over its usual one, which is taken as that
of hover at most, and as half of that at least.  One that usually gives less than the least of
this after a failure idles: it is asked for more only when something turns the vehicle, and is not
named."""

ODDS = 5.3
"""Lead of the evidence over that of each other rotor: the odds of a probability of 0.995."""

MARGIN = 4.0
"""Lead of the evidence over that of a disturbance."""

SEEN = 15.0  # evidence, where leads are gathered, of a weak rotor that leads for long

PAIR_ODDS = 1.0  # lead of a pair from which a rotor alone is not named

LEVER = 0.36
"""Least lever of the wrench that two failing rotors take, over that of one rotor: one with a
shorter lever may be a load, too."""


@dataclass(frozen=True, eq=False)
class Name:
    """What is named: see `Finding`; `evidence`: that for two rotors."""

    rotors: tuple[int, ...] = ()
    lost: Array = field(default_factory=lambda: np.zeros(0))
    arms: tuple[tuple[int, int], ...] = ()
    angle: float | None = None
    evidence: float = 0.0


@dataclass(frozen=True, eq=False)
class Case:
    """What is tested, and what explains it.

    - `lacked`, `variance`, `given` (T, 6, n), `lateral` and `health`: see
      `HypothesisTest.__call__`
    - `held` (n,): whether each rotor is one of a named arm
    - `asked` (T, n): whether it is asked for enough thrust to be named
    - `losses`, `evidence` (n,) and `disturbance`: see `Losses` and `Finding`
    - `known`: see `HypothesisTest.__call__`
    - `gathers`: whether every rotor may gather a lead; see `gathered`
    """

    lacked: Array
    variance: Array
    given: Array
    lateral: Array
    health: Array
    held: BoolArray
    asked: BoolArray
    losses: Losses
    evidence: Array
    disturbance: float
    known: bool
    gathers: bool


class Naming:
    """Names what leads everything else clearly; see `HypothesisTest`.

    - `vehicle`
    - `wrenches` (6, n): force and torque per thrust of each rotor
    - `signatures`: those of `HypothesisTest`
    """

    def __init__(
        self, vehicle: Vehicle, wrenches: Array,
        signatures: Callable[[Array, Array, float], tuple[Array, Array]],
    ) -> None:
        self._partners, self._signatures = vehicle.partners, signatures
        self._hover = vehicle.weight / vehicle.n
        self.lever = LEVER * float(np.linalg.norm(wrenches[3:], axis=0).mean())

    def now(
        self, case: Case, rotor: int, likeliest: int, servo: StuckServo | None, leads: Array
    ) -> tuple[Name, int]:
        """Return what is named by the evidence of one test, and the window that shows it.

        - `rotor`: the likeliest one
        - `likeliest`: the window in which a disturbance is likeliest
        - `servo`: that of the rotor, if it sticks
        - `leads` (n,): what each rotor has gathered
        """
        best, losses, health = float(case.evidence[rotor]), case.losses, case.health
        if best <= LIMIT or best - case.disturbance <= MARGIN:
            pair = case.disturbance > LIMIT
            return self._pair(case, likeliest, best)[0] if pair else Name(), likeliest
        leads_all = best - self._rival(case.evidence, rotor) > ODDS
        if servo is not None:
            clear = leads_all and servo.share >= LEAST_TURN
            name = Name((rotor,), health[[rotor]], angle=servo.angle) if clear else Name()
            return name, servo.window
        window = losses.telling_window(rotor)
        share = losses.shares[window, rotor]
        clear = share >= CLEAR_LOSS * health[rotor] and case.asked[window, rotor]
        if not leads_all or not clear or leads[rotor] < 0.0:
            return Name(), window
        # The rotor between two lost ones explains their torque.
        name, evidence = self._pair(case, window, best)
        # What shows only in the window of leads or a longer one is named by its lead, while leads
        # are gathered.
        early = window < GATHERED or not case.gathers
        if not name.rotors and early and best > evidence - PAIR_ODDS:
            name = self.name(rotor, share, case.evidence)
        return name, window

    def lasts(self, case: Case, leads: Array, at: int) -> bool:
        """Return whether the rotor that has gathered most (n,) is named for it.

        `at`: the window in which leads are gathered.
        """
        top, losses = int(leads.argmax()), case.losses
        weak = losses.raw[:, top].max() >= WEAK_LOSS * case.health[top]
        seen = leads[top] > LASTING and losses.evidence[at, top] > SEEN
        return bool(seen and weak and case.asked[at, top])

    def asked(self, ages: Array, given: Array, usual: Array, health: Array) -> BoolArray:
        """Return which rotors (T, n) give enough thrust (T, 6, n) in each window to be named."""
        half = 0.5 * self._hover
        least = ASKED * np.clip(usual, half, self._hover) * ages[:, None]
        idles = (health < 1.0).any() & (usual < ASKED * half)
        return np.asarray((np.linalg.norm(given[:, :3], axis=1) >= least) & ~idles)

    def _rival(self, evidence: Array, rotor: int) -> float:
        """Return the greatest evidence (n,) of a rotor that is not this one or its partner."""
        partner, rivals = self._partners[rotor], evidence.copy()
        rivals[[rotor] if partner is None else [rotor, partner]] = 0.0
        return float(rivals.max())

    def name(self, rotor: int, share: float, evidence: Array) -> Name:
        """Return the name of a rotor that lost a share, by the evidence (n,) for each."""
        partner = self._partners[rotor]
        lead = np.inf if partner is None else evidence[rotor] - evidence[partner]
        return self._names((rotor,), np.array([share]), np.array([lead]))

    def _names(self, rotors: tuple[int, ...], lost: Array, leads: Array) -> Name:
        """Return the name of rotors that lost shares, or of the arms of which they are.

        It is the arm if a rotor does not lead its partner.
        """
        found, shares, arms = list[int](), list[float](), []
        for rotor, share, lead in zip(rotors, lost.tolist(), leads.tolist(), strict=True):
            partner = self._partners[rotor]
            if partner is None or lead > ODDS:
                found.append(rotor)
                shares.append(share)
            else:
                both = min(rotor, partner), max(rotor, partner)
                found += both
                shares += 2 * [0.5 * share]
                arms.append(both)
        return Name(tuple(found), np.array(shares), tuple(arms))

    def _pair(self, case: Case, window: int, best: float) -> tuple[Name, float]:
        """Return the name of two rotors whose failures explain a window, and their evidence.

        `best`: the greatest evidence of one rotor.
        """
        if not case.known:
            return Name(), 0.0
        given, error = (each[0] for each in self._signatures(
            case.given[[window]], case.lateral[[window]], PAIRED))
        pair = likeliest_pair(
            case.lacked[window], case.variance[window], given, error,
            np.where(case.held, 0.0, case.health), self._partners)
        force, torque = np.linalg.norm(pair.wrench.reshape(2, 3), axis=1)
        leads = pair.evidence > max(LIMIT, max(best, case.disturbance) + ODDS)
        clear = leads and pair.lead > ODDS and torque >= self.lever * force
        if not clear:
            return Name(), pair.evidence
        name = self._names(pair.rotors, pair.lost, pair.leads)
        return replace(name, evidence=pair.evidence), pair.evidence
