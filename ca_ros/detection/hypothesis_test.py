"""The test for failures: what explains an impulse: lost thrust, a stuck servo, a disturbance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.detection.arms import as_effectors, compared, unknown
from ca_ros.detection.disturbances import Disturbances
from ca_ros.detection.leads import GATHERED, gathered, owed
from ca_ros.detection.losses import least_shares, losses_of
from ca_ros.detection.naming import Case, Naming
from ca_ros.detection.stuck_servos import stuck_servos
from ca_ros.vehicle.vehicle import Vehicle

THRUST_ERROR = 0.1  # relative standard deviation of the thrust of each rotor

DRAG_LOST = 0.5
"""Share of its drag that a failing rotor loses, and the standard deviation of this: a weak one
keeps its drag, and one without a propeller loses it."""

TELLING = 6.5
"""Evidence for one rotor of a named arm against the other one."""

@dataclass(frozen=True, eq=False)
class Finding:
    """What a test finds.

    - `evidence` (n,): logarithm of the Bayes factor of the failure of each rotor against nothing
    - `disturbance`: the same of a disturbance, or of a rotor that gives more than commanded
    - `rotor`: the likeliest rotor
    - `margin`: lead of what is named, else of the likeliest rotor, over a disturbance
    - `named`: rotors that have failed with the wanted certainty
    - `arms`: pairs of these of which only one has failed, and which one does not show
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
    margin: float
    named: tuple[int, ...]
    arms: tuple[tuple[int, int], ...]
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


class HypothesisTest:
    """Compares the failure of each rotor with a free disturbance, over windows of time.

    In a window with the unexplained impulse c (6,) and its variance S (6,), the hypotheses are

    - nothing: c ~ N(0, S);
    - a disturbance: c ~ N(0, S + D), see `Disturbances`;
    - the loss of a share theta of rotor i: c ~ N(-theta s_i, S + theta^2 E_i).  s_i (6,) is what
      the sound rotor gives, its thrust and half of its drag, and E_i the variance of this.
      theta is the likeliest one within [0, health_i], and its prior is uniform.  A rotor whose
      speed is stuck may give more than it is commanded, at most what it gave in the last second.
      theta is then negative, and the evidence counts as that of a disturbance: it names nobody.

    The evidence for each is the greatest logarithm of its Bayes factor against nothing in any
    window (Kass and Raftery, Bayes factors, J. American Statistical Association 90, 1995).  A
    rotor is named if its evidence is over `LIMIT`, leads that of each other rotor by `ODDS`, and
    that of the disturbance by `MARGIN`, and it lost `CLEAR_LOSS` of its thrust.  This must
    show in a window shorter than that of `GATHERED`, or in any one while no leads are gathered:
    in the beginning of a flight, and while a loss is recent.

    What does not show so soon shows in time: a rotor that gathers a lead of `LASTING` is named,
    too; see `gathered`.

    If the rotor does not lead its partner of a coaxial pair, the arm is named, until `of_arms`
    tells which one has failed; meanwhile it is one effector, which may be named again.  Servos
    that stick compete with the rotors: see `stuck_servos`.

    Pairs of rotors are tested where a rotor would be named, in its window: the rotor between two
    that are lost explains their torque, and is not named if a pair leads it by `PAIR_ODDS`.  Where
    a disturbance is over `LIMIT` and no rotor leads it, they are tested in the window in which the
    disturbance is likeliest.  A pair is named if it leads rotors and disturbance by `ODDS`, since
    a push on an arm looks like the loss of the two rotors beside it, and cannot be a load; of its
    rotors again the arm if one does not lead its partner.

    - `vehicle`
    - `wrenches` (6, n): force and torque per thrust of each rotor
    """

    def __init__(self, vehicle: Vehicle, wrenches: Array) -> None:
        arm = float(np.linalg.norm(vehicle.arms, axis=1).mean())
        yaw = 2.0 * float(np.abs(wrenches[5]).mean())
        self.unit = np.array([1.0, 1.0, 1.0, arm, arm, yaw]) ** 2
        self.disturbances = Disturbances(vehicle.weight / vehicle.n, arm)
        self.partners = vehicle.partners
        self.naming = Naming(vehicle, wrenches, self.signatures)
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
        arms: Sequence[tuple[int, int]] = (), lost: ArrayLike = (), known: bool = True,
        recent: Sequence[int] = (),
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
        - `arms`: the named ones
        - `lost` (m,): what both rotors of each are taken to have lost
        - `known`: whether it flies for long enough that its trim is known: before, no two rotors
          are named, which together explain almost any trim, and no weak one
        - `recent`: rotors that failed so lately that others gather no lead; while there are any,
          no rotor comes to owe one
        """
        n, at = len(health), min(GATHERED, len(ages) - 1)
        own = given[:, :, :n]
        signature, error = self.signatures(own, lateral)
        variance = variance + unknown(signature, arms, np.asarray(lost))
        health, signature, error = as_effectors(health, signature, error, arms)
        seen = (lacked**2 / variance).sum(axis=1)
        losses = losses_of(
            lacked, signature, error, variance, seen, least_shares(ages, own, peaks), health)
        disturbances = np.maximum(
            self.disturbances.evidence(ages, lacked, variance, seen), losses.excess)
        likeliest = int(disturbances.argmax())
        disturbance = max(float(disturbances[likeliest]), 0.0)
        evidence = np.maximum(losses.evidence.max(axis=0), 0.0)
        servos, servo = np.zeros(n), None
        if self._servos.planar:
            servos, servo = stuck_servos(self._servos, lacked, 1.0 / variance, given, health)
            servo = servo if servo.evidence > evidence.max() else None
            evidence = np.maximum(evidence, servos)
        rotor = int(evidence.argmax()) if servo is None else servo.rotor
        gathers = known and not recent
        case = Case(
            lacked, variance, own, lateral, health, np.isin(np.arange(n), list(arms)),
            self.naming.asked(ages, own, usual, health), losses, evidence, disturbance, known,
            gathers)
        name, window = self.naming.now(case, rotor, likeliest, servo, leads)
        for_leads = losses.evidence[at]
        steady = max(float(disturbances[at]), 0.0)
        if known:
            leads = gathered(leads, block, for_leads, servos, steady, self.partners, recent)
            if gathers:
                leads = owed(leads, losses.raw[likeliest], health, evidence, disturbance)
        else:
            leads = np.zeros(n)
        margin = max(float(evidence[rotor]), name.evidence) - disturbance
        lasting = bool(not name.rotors and self.naming.lasts(case, leads, at))
        if lasting:
            rotor = int(leads.argmax())
            margin, window = float(for_leads[rotor]) - steady, losses.telling_window(rotor)
            share = losses.shares[window, rotor]
            name = self.naming.name(rotor, share, np.where(health > 0.0, for_leads, -np.inf))
        return Finding(
            evidence, disturbance, rotor, margin, name.rotors, name.arms, name.lost, name.angle,
            window, leads, lasting, losses.raw[-1], losses.errors[-1])

    def of_arms(
        self, lacked: Array, given: Array, lateral: Array, variance: Array,
        arms: Sequence[tuple[int, int]], lost: Array,
    ) -> Array:
        """Return what `compared` does of what the rotors give; see `__call__`."""
        own = given[:, :, : len(self.partners)]
        return compared(lacked, variance, *self.signatures(own, lateral), arms, lost)
