"""The test of motion: which failures explain what a vehicle does."""

from math import expm1
from operator import gt

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import MomentumObserver
from ca_ros.detection.belief_changes import BeliefChanges
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.hypothesis_test import HypothesisTest
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.detection.noise_estimator import LEARNING, UsualMotion
from ca_ros.detection.rotor_beliefs import REFINED, TOLD, RotorBeliefs
from ca_ros.detection.suspicion import SUSPICION, Suspicion
from ca_ros.detection.windows import Windows
from ca_ros.vehicle.settings import triple
from ca_ros.vehicle.state import GAP, cross, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

MOVING = 5.0  # motion of a vehicle that moves, over the noise in the settings

RECENT = 1.0  # time over which the greatest thrust of a rotor is forgotten [s]
KEPT = 2_000_000_000  # gap of the states after which what was learnt in a flight is kept [ns]

ALL, ONE = np.ones(6), np.eye(6)


class MotionTest:
    """Finds the failures that explain the motion of a vehicle; see `FailureDetector`.

    - `vehicle` and `settings`: as of `FailureDetector`
    - `beliefs`: what is believed of each rotor; it changes with what is found

    - `rotors`: that follow the commands
    - `observer`: of the momentum
    - `settling`: time from the first command after which the speeds of the motors are known [ns]
    - `suspicion`: what the motion makes suspect
    - `changes`: of the beliefs
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
        self.suspicion = Suspicion(vehicle.n)
        self._windows = Windows(self.rotors.columns)
        self.changes = BeliefChanges(beliefs, self.hypotheses, self.suspicion, self._windows)
        self.usual = UsualMotion(vehicle, s)
        noises = np.repeat([s.velocity_noise, s.angular_velocity_noise], 3)
        self.moving = (MOVING * noises).tolist()
        self.imu, self._measured = triple(s.imu_position), False
        self._turn, self._motion = ONE, np.zeros(6)
        self.settling = self.rotors.settling
        self._blind, self._commanded = self.settling, False
        self.reset()

    def reset(self) -> None:
        """Forget what was learnt of the noise."""
        self.follow_servos()
        self.suspicion.margin = 0.0
        self.usual.reset()
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
        self._windows = self.changes.windows = Windows(self.rotors.columns)
        self._peaks = np.zeros(self._n)
        self.suspicion.clear()

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
                moving and not self._blind and self.rotors.known
                and not self.suspicion.lately and not self._grounded)
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
                self._blind, usual.rested = self.settling, False
                # What rotors lack is learnt as trim.
                self.beliefs.age(TOLD)
        self._turn, self._motion = turn, motion
        step = observer.step
        if observer.standing or self._blind or self._grounded:
            usual.rested = usual.rested or (observer.standing and not self._blind)
            self._begin()
            if last is not None and 0 < time - last < GAP:
                usual.rest((time - last) / 1e9, own)
            return False
        if not self.rotors.known:
            # The motion explains nothing, nor that before: commands were missing already.
            self.changes.forget()
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
        return in_air and self.rotors.known and self.usual.tested

    @property
    def _grounded(self) -> bool:
        """Whether a flight has not begun, since the rotors carry too little of the weight."""
        return not self.usual.flown and not self.observer.carried

    def _test(self, time: int, moving: bool, given: Array) -> bool:
        """Test all windows that end now; return whether the health has changed."""
        windows, block, usual = self._windows, self._windows.block, self.usual
        beliefs, suspicion = self.beliefs, self.suspicion
        thrusts = np.linalg.norm(given[:3], axis=0)
        # A stuck rotor is commanded less and less, so a suspicion keeps the greatest thrusts.
        forgotten = 0.0 if suspicion.waited > 0.0 else -expm1(-block / RECENT)
        self._peaks = np.maximum(thrusts, self._peaks - forgotten * (self._peaks - thrusts))
        if usual.flown < 2.0 * block:
            self.changes.forget()
            return False
        spread = usual.spread(windows.ages, self._measured)
        failed, recent = (beliefs.failed(within) for within in (REFINED, LEARNING[0]))
        beliefs.age(block)
        seen = 0.5 * max((windows.lacked**2 / spread).dot(ALL).tolist())
        # While an arm may be told, what it lacks is not learnt.
        settled = not failed and not beliefs.new_arms
        quiet = settled and seen <= SUSPICION
        if quiet or not usual.tested:
            # No evidence exceeds what is seen.
            suspicion.clear()
            self._learn(spread, moving, given)
            return False
        impulses, changes = windows.rotors()
        own = slice(self._n)
        variance = spread + usual.model_errors(
            windows.ages, impulses[..., own], changes[..., own])
        variance += usual.trim(windows.ages, self.hypotheses.disturbances.variances[0])
        found = self.hypotheses(
            windows.ages, windows.lacked, impulses, windows.lateral, variance, beliefs.health,
            self._peaks, usual.thrusts, suspicion.patient_leads, block, tuple(beliefs.arms),
            beliefs.lost_by_arms(), usual.flown > LEARNING[0], recent)
        suspicion.leads = found.leads
        if found.greatest > SUSPICION and not moving:
            # A lost rotor turns the vehicle over; this one stands, and the ground carries it.
            self.changes.forget()
            return False
        suspected = found.greatest > SUSPICION or not settled
        changed = self.changes.refine(found, failed)
        changed = self.changes.tell_arms(impulses, variance) or changed
        suspicion.go_on(found, block, suspected)
        self._learn(spread, moving, given)
        if suspicion.confirms(found) or found.lasting:
            changed = self.changes.name(time, found, self.rotors.planar) or changed
            if found.angle is not None:
                self.follow_servos()
        return changed

    def _learn(self, spread: Array, moving: bool, given: Array) -> None:
        """Learn what is usual, unless a failure is suspected."""
        if not self.usual.due(self._windows.block):
            return
        before, self._learnt = self._learnt, self._motion
        if not self.suspicion.lately:
            steady = self.observer.estimate.dot(self._turn)
            motion = 0.5 * (before + self._learnt) if moving else None
            self.usual.learn(self._windows, spread, motion, steady, given)
