"""The test of motion: which failures explain what a vehicle does."""

from math import cos, expm1, sin
from operator import gt

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import MomentumObserver
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.hypothesis_test import TELLING, Finding, HypothesisTest
from ca_ros.detection.leads import LASTING
from ca_ros.detection.losses import LIMIT
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.detection.noise_estimator import LEARNING, UsualMotion
from ca_ros.detection.rotor_beliefs import CERTAIN, IN_A_ROW, REFINED, TOLD, RotorBeliefs
from ca_ros.detection.windows import Windows
from ca_ros.vehicle.settings import triple
from ca_ros.vehicle.state import GAP, cross, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

CONFIRMATIONS = 3  # tests of a suspicion that name the same rotors, and no others
MOVING = 5.0  # motion of a vehicle that moves, over the noise in the settings

TOTAL = 0.8
"""Greatest loss of a rotor that is not lost when it is named: one that keeps less would be given
commands so low that its health cannot be estimated further."""

SUSPICION, PATIENCE = 6.0, 1.0
"""Evidence from which the noise is not learnt, and for how long at most [s]."""

ACQUAINTED = 1_000_000_000
"""Time for which a flight that begins in mid-air, or after `reset`, only shows what is usual
[ns]."""

RECENT = 1.0  # time over which the greatest thrust of a rotor is forgotten [s]
KEPT = 2_000_000_000  # gap of the states after which what was learnt in a flight is kept [ns]

ALL, ONE, NOBODY = np.ones(6), np.eye(6), np.zeros(())


class MotionTest:
    """Finds the failures that explain the motion of a vehicle; see `FailureDetector`.

    - `vehicle` and `settings`: as of `FailureDetector`
    - `beliefs`: what is believed of each rotor; it changes with what is found

    - `rotors`: that follow the commands
    - `observer`: of the momentum
    - `settling`: time from the first command after which the speeds of the motors are known [ns]
    - `probabilities` (n + 1,): that each rotor has failed, and of a disturbance, in the last test;
      () without a suspicion
    - `suspect` and `margin`: see `FailureDetector`
    """

    def __init__(
        self, vehicle: Vehicle, settings: DetectorSettings, beliefs: RotorBeliefs
    ) -> None:
        s = self._settings = settings
        self._n, self.beliefs = vehicle.n, beliefs
        self._mass, self._gravity = vehicle.mass, vehicle.gravity
        self.rotors = CommandedRotors(vehicle, s)
        self.observer = MomentumObserver(vehicle, 0.0)
        self.hypotheses = HypothesisTest(vehicle, self.rotors.wrenches)
        self.usual = UsualMotion(vehicle, s)
        noises = np.repeat([s.velocity_noise, s.angular_velocity_noise], 3)
        self.moving = (MOVING * noises).tolist()
        self.imu, self._measured = triple(s.imu_position), False
        self._turn, self._motion = ONE, np.zeros(6)
        # Time until failures are tested; above ACQUAINTED, the speeds of the motors are unknown.
        self.settling = self.rotors.settling
        self._blind, self._commanded = ACQUAINTED + self.settling, False
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt of the noise."""
        self.follow_servos()
        self.margin = 0.0
        self.usual.reset()
        self._blind = max(self._blind, ACQUAINTED)
        self._begin()

    def follow_servos(self) -> None:
        """Let the servos that are announced, or found, to stick do so."""
        vehicle = self.beliefs.vehicle.intact
        for rotor, angle in self.beliefs.angles.items():
            vehicle = vehicle.with_stuck_servo(rotor + 1, angle)
        self.rotors.vehicle = vehicle

    def _begin(self) -> None:
        """Begin a flight: the windows reach back to now."""
        self.usual.begin()
        self._learnt = self._motion
        self._windows, self._peaks = Windows(self.rotors.columns), np.zeros(self._n)
        self._clear_suspicion()

    def _clear_suspicion(self) -> None:
        """Suspect nothing."""
        self._waited, self._count = 0.0, 0
        self._named: tuple[tuple[int, ...], tuple[tuple[int, int], ...]] = (), ()
        self._leads, self.probabilities = np.zeros(self._n), NOBODY
        self.suspect: int | None = None

    def forget(self, before: int | None = None) -> None:
        """Forget the motion, or that before a window, and what rotors have gathered."""
        self._windows.forget(before)
        self._leads = np.zeros(self._n)

    def command(self, time: int, followed: Array) -> None:
        """Take a command, within its bounds; see `FailureDetector.command`."""
        self._commanded = True
        self.rotors.command(time, followed)

    def observe(self, time: int, attitude: Array, motion: Array, force: Array | None) -> bool:
        """Take a state; return whether the health has changed; see `FailureDetector.observe`."""
        turn = ONE.copy()
        turn[:3, :3] = rotation_matrix(attitude)
        observer, usual = self.observer, self.usual
        last, impulse, own = observer.time, None, np.zeros((6, self._n))
        self._measured = force is not None
        if last is not None and 0 < time - last < GAP:
            given = self.rotors.given(last, time)
            own = given[:, : self._n]
            turned, mean = 0.5 * (self._turn + turn), 0.5 * (self._motion + motion)
            drag = usual.drag(mean)
            wrench = own.dot(self.beliefs.delivered) + drag
            observer.expect(turned.dot(wrench), mean[3:])
            # What holds a vehicle that does not move may be the ground, which is not learnt.
            moving = any(map(gt, abs(mean).tolist(), self.moving))
            if self._commanded:
                self._blind = max(self._blind - (time - last), 0)
            learnt = (
                moving and self._blind <= ACQUAINTED and self.rotors.known
                and not self._suspicious and not self._grounded)
            observer.gain = usual.gain() if learnt else 0.0
            if force is not None:
                impulse = self._impulse((time - last) / 1e9, turned, motion, mean[3:], force)
        observer.observe(time, turn.dot(motion), impulse)
        if observer.time != time or last == time:
            return False
        if last is not None and time < last:
            self.rotors = CommandedRotors(self.rotors.vehicle, self._settings)
        if last is not None and not 0 < time - last < GAP:
            self.rotors.lose()
            # The trim is known if it was, not long ago.
            if not (0 < time - last < KEPT and usual.flown > LEARNING[0]):
                self._blind = ACQUAINTED + self.settling
        self._turn, self._motion = turn, motion
        step = observer.step
        if observer.standing or self._blind > ACQUAINTED or self._grounded:
            if observer.standing and self._blind <= ACQUAINTED:
                self._blind = 0
            self._begin()
            if last is not None and 0 < time - last < GAP:
                usual.rest((time - last) / 1e9, own)
            return False
        if not self.rotors.known:
            # The motion explains nothing, nor that before: commands were missing already.
            self.forget()
            return False
        if not step:
            return False
        usual.flown += step
        lacked = observer.lacked.dot(turned)
        lateral = (observer.estimate.dot(turned) + drag)[:2]
        added = self._windows.add(step, lacked, lateral, given)
        return added and self._test(time, moving, own)

    def _impulse(
        self, step: float, turned: Array, motion: Array, omega: Array, force: Array
    ) -> Array:
        """Return the momentum (3,) that a step gained by the accelerometer [N s].

        An accelerometer that is off the centre of mass also measures how the vehicle turns.
        """
        place = self.imu
        change = cross((motion - self._motion)[3:], place)
        centripetal = omega * omega.dot(place) - place * omega.dot(omega)
        own = step * (force - centripetal) - change
        gained = self._mass * turned[:3, :3].dot(own)
        gained[2] -= self._mass * self._gravity * step
        return np.asarray(gained)

    @property
    def testing(self) -> bool:
        """Whether losses are tested: see `FailureDetector`."""
        in_air = self.usual.flown > 0.0 and not self.observer.standing
        return in_air and self.rotors.known and not self._blind

    @property
    def _suspicious(self) -> bool:
        return 0.0 < self._waited < PATIENCE

    @property
    def _grounded(self) -> bool:
        """Whether a flight has not begun, since the rotors carry too little of the weight."""
        return not self.usual.flown and not self.observer.carried

    def _test(self, time: int, moving: bool, given: Array) -> bool:
        """Test all windows that end now; return whether the health has changed."""
        windows, block, usual = self._windows, self._windows.block, self.usual
        beliefs = self.beliefs
        thrusts = np.linalg.norm(given[:3], axis=0)
        # A stuck rotor is commanded less and less, so a suspicion keeps the greatest thrusts.
        forgotten = 0.0 if self._waited > 0.0 else -expm1(-block / RECENT)
        self._peaks = np.maximum(thrusts, self._peaks - forgotten * (self._peaks - thrusts))
        if usual.flown < 2.0 * block:
            self.forget()
            return False
        spread = usual.spread(windows.ages, self._measured)
        failed, recent = (beliefs.failed(within) for within in (REFINED, LEARNING[0]))
        beliefs.age(block)
        seen = 0.5 * max((windows.lacked**2 / spread).dot(ALL).tolist())
        # While an arm may be told, what it lacks is not learnt.
        settled = not failed and not beliefs.new_arms(time)
        quiet = settled and seen <= SUSPICION
        if quiet or self._blind:
            # No evidence exceeds what is seen.
            self._clear_suspicion()
            self._learn(spread, moving, given)
            return False
        impulses, changes = windows.rotors()
        own = slice(self._n)
        variance = spread + usual.model_errors(
            windows.ages, impulses[..., own], changes[..., own])
        if self._waited >= PATIENCE:
            # A disturbance that lasts is no push.
            self._leads = np.maximum(self._leads, -LASTING)
        found = self.hypotheses(
            windows.ages, windows.lacked, impulses, windows.lateral, variance, beliefs.health,
            self._peaks, usual.thrusts, self._leads, block, tuple(beliefs.arms),
            beliefs.lost_by_arms(), usual.flown > LEARNING[0], recent)
        self._leads = found.leads
        if found.greatest > SUSPICION and not moving:
            # A lost rotor turns the vehicle over; this one stands, and the ground carries it.
            self.forget()
            return False
        suspected = found.greatest > SUSPICION or not settled
        changed = self._refine(found, failed)
        changed = self._tell_arms(time, impulses, variance) or changed
        self._waited = self._waited + block if suspected else 0.0
        self.margin = found.margin
        self.suspect = found.rotor if found.evidence[found.rotor] > LIMIT else None
        self._learn(spread, moving, given)
        self.probabilities = found.probabilities
        if self._confirm(found) or found.lasting:
            return self._name(time, found) or changed
        return changed

    def _confirm(self, found: Finding) -> bool:
        """Return whether the same rotors, and no others, are named in enough tests."""
        if not found.named:
            return False
        named = found.named, found.arms
        self._count = self._count + 1 if named == self._named else 1
        self._named = named
        if self._count < CONFIRMATIONS:
            return False
        self._count = 0
        return True

    def _name(self, time: int, found: Finding) -> bool:
        """Let the rotors that a test names have failed; return whether the health changes."""
        beliefs, block = self.beliefs, self._windows.block
        self.forget(before=found.window)
        # The window may have begun a block before the failure.
        age = self._windows.ages[found.window]
        longer = age / max(age - block, block)
        before, probabilities = beliefs.health, found.probabilities
        if len(found.named) - len(found.arms) == 2:
            self._give_back_between(found)
        arms = [rotor for arm in found.arms for rotor in arm]
        for rotor in set(found.named) - set(arms):
            self._give_back_partner(time, rotor, found)
        for rotor, share in zip(found.named, found.lost.tolist(), strict=True):
            half = rotor in arms and rotor not in beliefs.held
            whole = beliefs.health[rotor] * (0.5 if half else 1.0)
            if share * longer >= TOTAL * whole:
                share = whole
            certainty = beliefs.found[rotor] or probabilities[rotor]
            beliefs.found[rotor] = 0.5 if rotor in arms else max(certainty, CERTAIN)
            if found.angle is None:
                self.fail(rotor, share, time, 'motion')
            else:
                self._stick(rotor, found.angle, time)
        for arm in found.arms:
            beliefs.name_arm(*arm)
        beliefs.close_arms()
        return not np.array_equal(beliefs.health, before)

    def _give_back_between(self, found: Finding) -> None:
        """Give back the rotors whose failure has just explained what two others lack."""
        beliefs = self.beliefs
        for rotor in set(beliefs.failed(REFINED)) - {*found.named, *beliefs.held}:
            if beliefs.evidence[rotor] == 'motion':
                self._give_back(rotor)

    def _give_back_partner(self, time: int, rotor: int, found: Finding) -> None:
        """Give back the partner of a coaxial rotor: it may just have been named for this one.

        If both have failed, the motion names it again, and the arm gives nothing meanwhile, too.
        """
        beliefs, partner = self.beliefs, self.hypotheses.partners[rotor]
        if partner is None or partner in {*found.named, *beliefs.held}:
            return
        lately = time - (beliefs.since[partner] or 0) < TOLD
        if lately and beliefs.evidence[partner] == 'motion':
            self._give_back(partner)

    def _give_back(self, rotor: int) -> None:
        """Let a rotor be sound, as if from the start of the windows on."""
        lost = self.beliefs.lost(rotor)
        self.beliefs.give_back(rotor)
        self.probabilities = np.where(np.arange(self._n + 1) == rotor, 0.0, self.probabilities)
        self._reduce(rotor, -lost)

    def fail(self, rotor: int, share: float, time: int, evidence: str) -> None:
        """Take a share of a rotor's health, which failed by some evidence."""
        self.beliefs.find(rotor, time, evidence)
        self.beliefs.refined[rotor] = 0.0
        self._reduce(rotor, share)

    def _reduce(self, rotor: int, share: float) -> None:
        """Take a share of a rotor's health, as if from the start of the windows on."""
        less = self.beliefs.reduce(rotor, share)
        given = self._windows.blocks[:, :, : self._n]
        signature = given + self.hypotheses.drags(given, self._windows.laterals)
        self._windows.explain(less * signature[:, :, rotor])

    def _stick(self, rotor: int, angle: float, time: int) -> None:
        """Let a rotor's servo stick."""
        self.beliefs.find(rotor, time, f'servo sticks at {angle:.2f} rad')
        # What it gives until it stops is known.
        planar = self.rotors.planar
        for column, share in (
            (rotor, 1.0), (self._n + planar.index(rotor), -cos(angle)),
            (self._n + len(planar) + planar.index(rotor), -sin(angle)),
        ):
            lost = share * self.beliefs.delivered[rotor]
            self._windows.explain(lost * self._windows.blocks[:, :, column])
        self.beliefs.stick(rotor, angle)
        self.follow_servos()

    def _tell_arms(self, time: int, impulses: Array, variance: Array) -> bool:
        """Tell which rotors of new arms have failed, where it shows; return whether it does."""
        windows, arms, told = self._windows, self.beliefs.arms, []
        new = self.beliefs.new_arms(time)
        if not new:
            return False
        evidences = self.hypotheses.of_arms(
            windows.lacked, impulses, windows.lateral, variance, list(arms),
            self.beliefs.lost_by_arms())
        for (pair, count), evidence in zip(arms.items(), evidences.tolist(), strict=True):
            if pair not in new:
                continue
            sign = int(evidence > TELLING) - int(evidence < -TELLING)
            arms[pair] = sign + count if sign * count > 0 else sign
            if abs(arms[pair]) >= IN_A_ROW:
                told.append(pair if sign > 0 else pair[::-1])
        for failed, sound in told:
            self.tell_arm(failed, sound)
        return bool(told)

    def tell_arm(self, failed: int, sound: int) -> None:
        """Let one rotor of a named arm have failed, and the other one be sound."""
        lost = self.beliefs.lost(failed)
        self.beliefs.tell_arm(failed, sound)
        self._reduce(failed, lost)
        self._give_back(sound)

    def _learn(self, spread: Array, moving: bool, given: Array) -> None:
        """Learn what is usual, unless a failure is suspected."""
        if not self.usual.due(self._windows.block):
            return
        before, self._learnt = self._learnt, self._motion
        if not self._suspicious:
            steady = self.observer.estimate.dot(self._turn)
            motion = 0.5 * (before + self._learnt) if moving else None
            self.usual.learn(self._windows, spread, motion, steady, given)

    def _refine(self, found: Finding, recent: list[int]) -> bool:
        """Estimate the health of rotors that have just failed; return whether it changes."""
        clear = np.abs(found.shares) > np.maximum(0.05, 3.0 * found.errors)
        rotors = [i for i in recent if clear[i] and self.beliefs.health[i] > 0.0]
        held = self.beliefs.held
        for rotor in rotors:
            share = float(found.shares[rotor])
            self._reduce(rotor, 0.5 * share if rotor in held else share)
        self.beliefs.close_arms()
        return bool(rotors)
