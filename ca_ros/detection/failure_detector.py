"""Rotor failures that nobody announces, detected from the motion of a vehicle."""

from collections.abc import Mapping
from math import cos, hypot, sin
from operator import gt, index
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import GAP, RESTART, MomentumObserver
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.hypothesis_test import LIMIT, TELLING, Finding, HypothesisTest
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.detection.noise_estimator import UsualMotion
from ca_ros.detection.speed_residual import SlowRotors
from ca_ros.detection.windows import Windows
from ca_ros.problem.audit import audit
from ca_ros.settings import settings_of
from ca_ros.vehicle.settings import triple
from ca_ros.vehicle.state import STATE_MAX, cross, rotation_matrix
from ca_ros.vehicle.validation import ABSURD
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

CONFIRMATIONS = 3  # tests in a row that name the same rotors before these count as failed
REFINED = 0.5  # time after a failure in which its health is estimated further [s]
USELESS = 0.2  # a rotor with less health is lost
MOVING = 5.0  # motion of a vehicle that moves, over the noise in the settings

TOTAL = 0.8
"""Greatest loss of a rotor that is not lost when it is named: one that keeps less would be given
commands so low that its health cannot be estimated further."""

CERTAIN = 0.995  # least probability of a failure that was named

SUSPICION, PATIENCE = 6.0, 1.0
"""Evidence from which the noise is not learnt, and for how long at most [s]."""

ACQUAINTED = 1_000_000_000
"""Time for which a flight that begins in mid-air, or after `reset`, only shows what is usual
[ns]."""

SETTLING = 4.0  # time after which the speeds of motors and servos are known, over their lag

TIME_MAX = 2**62
"""Times are less [ns], before and after zero, so that their differences have 64 bits."""

ALL, ONE, NOBODY = np.ones(6), np.eye(6), np.zeros(())


def moment_of(time: int) -> int:
    """Return a time [ns]; raise a ValueError if it is out of bounds, a TypeError if not whole."""
    try:
        moment = index(time)
    except TypeError:
        raise TypeError(
            f'time {time}: expected whole nanoseconds, such as int(1e9 * seconds)') from None
    if not -TIME_MAX < moment < TIME_MAX:
        raise ValueError(f'time {time}: expected a number of nanoseconds below 2**62')
    return moment


def numbers_of(name: str, given: ArrayLike, count: int) -> Array:
    """Return numbers (count,); raise a ValueError if there is another number of them."""
    try:
        found = np.asarray(given, float)
    except (TypeError, ValueError):
        found = np.zeros(())
    if found.shape != (count,):
        raise ValueError(f'{name} {given!s}: expected {count} numbers')
    return found


class FailureDetector:
    """Names the rotors whose lost thrust explains the motion, or that do not turn as commanded.

    From each state and from the commands, the momentum observer gives the impulse that the sound
    rotors, the weight, the mean disturbance and the drag do not explain.  Every hundredth of a
    second, `HypothesisTest` compares the sums over several windows of time with what each rotor
    should have given, and with disturbances; rotors that three tests in a row name have failed.

    While nothing is suspected, the mean disturbance, the drag and the noise are learnt.

    `command`, `measure`, `observe` and `announce` raise a ValueError if there is another number of
    numbers, or one is not finite or out of bounds; it has then entered nothing.

    Where the speeds of the rotors are measured, `SlowRotors` finds those that do not follow their
    commands.

    Where the rotors of a coaxial pair cannot be told apart, the arm is named: each of both has
    then lost half, so the arm gives what is expected if both get the same thrust.  What one of
    them keeps comes back when the motion tells which one has failed.

    `make_detector` returns this detector, or the same in C.

    Parameters
    ----------
    vehicle : Vehicle
        With its inertia, and the announced health.
    settings : DetectorSettings, optional
    motor_time_constant, delay : float, by keyword
        Lag of the motors, and time from a command to its effect [s].  A warning says that the lag
        is taken as 0 if it is not given.
    **others
        The other settings ``detector.*`` of a vehicle's file, by keyword.

    Attributes
    ----------
    health : (n,) array
        The announced health, less what was found.
    since : list
        When each rotor was found to have failed [ns].
    evidence : list of str
        What each failure was found by: 'motion' or 'rotor speed', or at which angle its servo
        sticks.
    suspect : int or None
        The rotor that may be failing now.
    settling : int
        Time from the first command after which the speeds of the motors are known [ns].
    margin : float
        Lead of the evidence for the likeliest rotor over that for a disturbance, in the last test
        in which something was suspected; a natural logarithm.

    Examples
    --------
    A hexarotor hovers by constant rotor speeds, and loses rotor 2 after a second:

    >>> from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
    >>> vehicle = Vehicle.load('hexarotor')
    >>> detector = make_detector(vehicle, motor_time_constant=0.0)
    >>> hover = Exact(vehicle).allocate([9.81, 0.0, 0.0, 0.0]).speeds
    >>> body, state = RigidBody(vehicle), np.zeros(13)
    >>> state[9] = 1.0  # position, velocity, quaternion x, y, z, w, angular velocity
    >>> for k in range(600):
    ...     if k == 500:
    ...         body = body.with_vehicle(vehicle.fail(2))
    ...     time = 2_000_000 * k  # [ns]
    ...     detector.command(time, hover)
    ...     if detector.observe(time, state[6:10], velocity_in_body(state), state[10:]):
    ...         print(f'{time / 1e9} s: {detector.health}')
    ...         break
    ...     state = body.step(state, hover, 0.002)
    1.064 s: [1. 0. 1. 1. 1. 1.]
    """

    def __init__(
        self, vehicle: Vehicle, settings: DetectorSettings | None = None, /, **given: Any
    ) -> None:
        s = self.settings = settings_of(type(self), DetectorSettings, settings, given)
        if not (settings or 'motor_time_constant' in given):
            warn('motor_time_constant: taken as 0; motors with a lag make false alarms. Give the '
                 'lag [s], or 0 if there is none', RuntimeWarning, stacklevel=2)
        self.vehicle = vehicle
        self._slow = SlowRotors(vehicle.n, s)
        self._rotors = CommandedRotors(vehicle, s)
        self._observer = MomentumObserver(vehicle, 0.0)
        self._find = HypothesisTest(vehicle, self._rotors.wrenches)
        self._usual = UsualMotion(vehicle, s)
        noises = np.repeat([s.velocity_noise, s.angular_velocity_noise], 3)
        self._moving = (MOVING * noises).tolist()
        self._turn, self._motion = ONE, np.zeros(6)
        self._imu, self._measured = triple(s.imu_position), False
        lag = max(s.motor_time_constant, s.servo_time_constant)
        # Time until failures are tested; above ACQUAINTED, the speeds of the motors are unknown.
        # It is in whole milliseconds, so that single precision does not change it.
        self.settling = 1_000_000 * round(1e3 * (SETTLING * lag + s.delay))
        self._blind = ACQUAINTED + self.settling
        self._commanded = False
        self.reset()

    @property
    def standing(self) -> bool:
        """Whether the vehicle stands; then nothing is detected."""
        return self._observer.standing

    @property
    def health(self) -> Array:
        """The announced health, less what was found, (n,).

        What was found holds until `reset`, but for a rotor of a named arm.

        A rotor whose servo sticks has none, if the vehicle can do without it.
        """
        return np.where(self._stuck, 0.0, self._delivered)

    @property
    def failed_arms(self) -> tuple[tuple[int, int], ...]:
        """The named arms: rotors, from 1, of which one has failed, and which one is unknown."""
        return tuple(sorted((i + 1, j + 1) for i, j in self._arms))

    @property
    def probabilities(self) -> Array:
        """Probabilities (n + 1,): that each rotor has failed, now or before; of a disturbance."""
        found = np.append(self._found, 0.0)
        return np.where(found, found, self._probabilities)

    def reset(self) -> None:
        """Forget all failures, and what was learnt of the noise."""
        n = self.vehicle.n
        self._delivered, self._stuck = np.array(self.vehicle.health), np.zeros(n, bool)
        self._angles: dict[int, float] = {}
        self._follow_servos()
        self._found: Array = np.zeros(n)
        self._probabilities: Array = NOBODY
        self.since: list[int | None] = [None] * n
        self.evidence = [''] * n
        self.suspect: int | None = None
        self.margin = 0.0
        self._slow.reset()
        self._refined: dict[int, float] = {}
        self._arms: dict[tuple[int, int], int] = {}
        self._usual.reset()
        self._blind = max(self._blind, ACQUAINTED)
        self._begin()

    def interrupt(self) -> None:
        """Take the next state as one that does not continue those before; what was found holds.

        The motion between the two explains nothing, such as where an estimator was reset, or
        where others have flown the vehicle.
        """
        self._observer.interrupt()

    def model(self) -> dict[str, Array]:
        """Return the numbers of ca_detector_model (ca_ros/kernel/detector.h) by name."""
        vehicle, settings, find = self.vehicle, self.settings, self._find
        sound, curve = vehicle.intact, vehicle.curve
        numbers = {
            'rotors': vehicle.n, 'mass': vehicle.mass, 'weight': vehicle.weight,
            'inertia': inertia_of(vehicle), 'wrenches': self._rotors.wrenches,
            'segments': len(curve.rows), 'curve': curve.rows,
            'least': self._rotors.bounds.least, 'greatest': self._rotors.bounds.greatest,
            'thrust': sound.thrust_per_squared_speed / curve.coefficient,
            'reverse_thrust': sound.reverse_thrust_per_squared_speed * curve.square,
            'health': vehicle.health,
            'time_constant': settings.motor_time_constant, 'delay': settings.delay,
            'arms': vehicle.arms.T,
            'partner': [-1 if each is None else each for each in find.partners],
            'unit': find.unit, 'disturbance': find.disturbances,
            'gravity': vehicle.mass * vehicle.gravity, 'imu': self._imu,
            'lever': find.lever, 'force_noise': self._usual.force_noise,
            'noise': self._usual.noise, 'moving': self._moving,
            'jump': self._observer.jump_max, 'balance': self._observer.ground.limits,
        }
        return {name: np.array(value, float) for name, value in numbers.items()}

    def announce(self, health: ArrayLike, stuck: Mapping[int, float] | None = None) -> None:
        """Take what is announced, which replaces what was before; what was found holds.

        - `health` (n,)
        - `stuck`: the servos that stick: by rotor, from 1, the angle [rad]
        """
        before, servos = self._delivered, self.vehicle.servos
        self.vehicle = vehicle = self.vehicle.with_health(health, stuck=stuck or {})
        unfound = [since is None for since in self.since]
        self._delivered = np.where(unfound, vehicle.health, np.minimum(before, vehicle.health))
        moved = (vehicle.servos.lower != servos.lower) | (vehicle.servos.upper != servos.upper)
        if moved.any():
            self._follow_servos()
        if moved.any() or not np.array_equal(self._delivered, before):
            # When it failed is not known: the motion before shows nothing more.
            self._forget()

    def _follow_servos(self) -> None:
        """Let the servos that are announced, or found, to stick do so."""
        vehicle = self.vehicle.intact
        for rotor, angle in self._angles.items():
            vehicle = vehicle.with_stuck_servo(rotor + 1, angle)
        self._rotors.vehicle = vehicle

    def _begin(self) -> None:
        """Begin a flight: the windows reach back to now."""
        self._usual.begin()
        self._learnt = self._motion
        self._waited = 0.0
        self._named: tuple[int, ...] = ()
        self._count, self._windows = 0, Windows(self._rotors.columns)
        self._leads = np.zeros(self.vehicle.n)

    def _forget(self, before: int | None = None) -> None:
        """Forget the motion, or that before a window, and what rotors have gathered."""
        self._windows.forget(before)
        self._leads = np.zeros(self.vehicle.n)

    def command(self, time: int, command: ArrayLike) -> None:
        """Take a command with its stamp [ns]: speeds (n,) and then angles (k,) [rad/s, rad].

        Beyond the bounds of the vehicle, motors and servos are at these.  A command that is newer
        than the last state by seconds is ignored.
        """
        size = self.vehicle.n + len(self.vehicle.servos)
        time, numbers = moment_of(time), numbers_of('command', command, size)
        followed = self._rotors.bounds.followed(numbers)
        last = self._observer.time
        if last is not None and time - last >= RESTART:
            return
        self._commanded = True
        self._rotors.command(time, followed)
        self._slow.command(time, followed[: self.vehicle.n])

    def measure(self, time: int, speeds: ArrayLike) -> bool:
        """Take measured rotor speeds (n,) [rad/s]; return whether the health has changed.

        Those that are older than the last command by more than `oldest_measurement` are ignored.
        """
        time, measured = moment_of(time), numbers_of('speeds', speeds, self.vehicle.n)
        if not (abs(measured) <= ABSURD).all():
            raise ValueError(f'speeds {speeds!s}: expected {len(self._found)} numbers up to 1e100')
        found = self._slow.measure(time, measured, self._found == 0.0)
        failed = [(i, share) for i, share in found or [] if self.health[i] > 0.0]
        if failed or found is None:
            # When they failed is not known: the motion before shows nothing more.
            self._forget()
        for rotor, share in failed:
            for pair in [pair for pair in self._arms if rotor in pair]:
                self._tell(rotor, sum(pair) - rotor)
            self._found[rotor] = 1.0
            self._fail(rotor, share * self.health[rotor], time, 'rotor speed')
        return bool(failed)

    def observe(
        self, time: int, attitude: ArrayLike, velocity: ArrayLike, angular_velocity: ArrayLike,
        specific_force: ArrayLike | None = None,
    ) -> bool:
        """Take a state; return whether the health has changed.

        - `time`: [ns]
        - `attitude` (4,): quaternion x, y, z, w, body to world; its length counts for nothing, but
          is at least 1e-9
        - `velocity` and `angular_velocity` (3,): in the body frame, up to 1e9 [m/s, rad/s]
        - `specific_force` (3,): what the accelerometer measures, in the body frame, in the mean
          since the last state [m/s^2].  It then takes the place of the change of velocity
        """
        time, attitude = moment_of(time), numbers_of('attitude', attitude, 4)
        motion = np.concatenate([
            numbers_of('velocity', velocity, 3),
            numbers_of('angular velocity', angular_velocity, 3)])
        force = None
        if specific_force is not None:
            force = numbers_of('specific force', specific_force, 3)
            if not (abs(force) <= STATE_MAX).all():
                raise ValueError(f'specific force {force}: expected three numbers up to 1e9')
        numbers = attitude.tolist(), motion.tolist()
        sound = hypot(*numbers[0]) >= 1.0 / STATE_MAX
        if not (sound and all(abs(x) <= STATE_MAX for part in numbers for x in part)):
            raise ValueError(
                f'attitude {attitude}, velocities {velocity!s} and {angular_velocity!s}: expected '
                'a quaternion that is not zero, and numbers up to 1e9'
            )
        turn = ONE.copy()
        turn[:3, :3] = rotation_matrix(attitude)
        observer, usual = self._observer, self._usual
        last, impulse = observer.time, None
        self._measured = force is not None
        if last is not None and 0 < time - last < GAP:
            given = self._rotors.given(last, time)
            own = given[:, : self.vehicle.n]
            self._slow.expect(time, self._rotors.speeds)
            turned, mean = 0.5 * (self._turn + turn), 0.5 * (self._motion + motion)
            drag = usual.drag(mean)
            wrench = own.dot(self._delivered) + drag
            observer.expect(turned.dot(wrench), mean[3:])
            # What holds a vehicle that does not move may be the ground, which is not learnt.
            moving = any(map(gt, abs(mean).tolist(), self._moving))
            if self._commanded:
                self._blind = max(self._blind - (time - last), 0)
            learnt = moving and self._blind <= ACQUAINTED and not self._suspicious
            observer.gain = usual.gain() if learnt else 0.0
            if force is not None:
                impulse = self._impulse((time - last) / 1e9, turned, motion, mean[3:], force)
        observer.observe(time, turn.dot(motion), impulse)
        if observer.time != time or last == time:
            return False
        if last is not None and time < last:
            self._rotors = CommandedRotors(self._rotors.vehicle, self.settings)
        if last is not None and not 0 < time - last < GAP:
            self._blind = ACQUAINTED + self.settling
        self._turn, self._motion = turn, motion
        step = observer.step
        if observer.standing or self._blind > ACQUAINTED:
            self._blind = self._blind if self._blind > ACQUAINTED else 0
            self._begin()
            return False
        if not step:
            return False
        usual.fly(step, own)
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
        vehicle, place = self.vehicle, self._imu
        change = cross((motion - self._motion)[3:], place)
        centripetal = omega * omega.dot(place) - place * omega.dot(omega)
        own = step * (force - centripetal) - change
        gained = vehicle.mass * turned[:3, :3].dot(own)
        gained[2] -= vehicle.mass * vehicle.gravity * step
        return np.asarray(gained)

    @property
    def _suspicious(self) -> bool:
        return 0.0 < self._waited < PATIENCE

    def _test(self, time: int, moving: bool, given: Array) -> bool:
        """Test all windows that end now; return whether the health has changed."""
        windows, block, usual = self._windows, self._windows.block, self._usual
        if usual.flown < 2.0 * block:
            self._forget()
            return False
        spread = usual.spread(windows.ages, self._measured)
        recent = list(self._refined)
        if recent:
            ages = {i: age + block for i, age in self._refined.items()}
            self._refined = {i: age for i, age in ages.items() if age < REFINED}
        seen = 0.5 * max((windows.lacked**2 / spread).dot(ALL).tolist())
        quiet = not recent and not self._arms and seen <= SUSPICION
        if quiet or self._blind:
            # No evidence exceeds what is seen.
            self._waited, self._count, self._named, self.suspect = 0.0, 0, (), None
            self._leads = np.zeros(self.vehicle.n)
            self._probabilities = NOBODY
            self._learn(spread, moving, given)
            return False
        impulses, changes = windows.rotors()
        own = slice(self.vehicle.n)
        errors = usual.model_errors(windows.ages, impulses[..., own], changes[..., own])
        found = self._find(
            windows.ages, windows.lacked, impulses, windows.lateral, spread + errors, self.health,
            self._leads, block, [i for pair in self._arms for i in pair])
        self._leads = found.leads
        if found.greatest > SUSPICION and not moving:
            # A lost rotor turns the vehicle over; this one stands, and the ground carries it.
            self._forget()
            return False
        suspected = found.greatest > SUSPICION or bool(recent or self._arms)
        changed = self._refine(found, recent)
        changed = self._tell_arms(impulses, spread + errors) or changed
        self._waited = self._waited + block if suspected else 0.0
        self.margin = float(found.evidence[found.rotor]) - found.disturbance
        self.suspect = found.rotor if found.evidence[found.rotor] > LIMIT else None
        self._learn(spread, moving, given)
        self._probabilities = found.probabilities
        named = (*found.named, -1) if found.arm else found.named
        repeated = bool(named) and named == self._named
        self._count = self._count + 1 if repeated else int(bool(found.named))
        self._named = named
        if self._count >= CONFIRMATIONS:
            self._count = 0
        elif not found.lasting:
            return changed
        self._forget(before=found.window)
        # The window may have begun a block before the failure.
        age = windows.ages[found.window]
        longer = age / max(age - block, block)
        before = self.health
        for rotor, share in zip(found.named, found.lost.tolist(), strict=True):
            whole = 0.5 * self.health[rotor] if found.arm else self.health[rotor]
            if share * longer >= TOTAL * whole:
                share = whole
            self._found[rotor] = 0.5 if found.arm else max(self.probabilities[rotor], CERTAIN)
            if found.angle is None:
                self._fail(rotor, share, time, 'motion')
            else:
                self._stick(rotor, found.angle, time)
        if found.arm:
            self._arms[found.named[0], found.named[1]] = 0
            for rotor in found.named:
                del self._refined[rotor]
        return changed or not np.array_equal(self.health, before)

    def _tell_arms(self, impulses: Array, variance: Array) -> bool:
        """Tell which rotors of named arms have failed, where it shows; return whether it does."""
        windows, told = self._windows, []
        for pair, count in self._arms.items():
            lost = self.vehicle.health[pair[0]] - self._delivered[pair[0]]
            evidence = self._find.of_arm(
                windows.lacked, impulses, windows.lateral, variance, *pair, lost)
            sign = int(evidence > TELLING) - int(evidence < -TELLING)
            self._arms[pair] = sign + count if sign * count > 0 else sign
            if abs(self._arms[pair]) >= CONFIRMATIONS:
                told.append(pair if sign > 0 else pair[::-1])
        for failed, sound in told:
            self._tell(failed, sound)
        return bool(told)

    def _tell(self, failed: int, sound: int) -> None:
        """Let one rotor of a named arm have failed, and the other one be sound."""
        lost = self.vehicle.health[failed] - self._delivered[failed]
        del self._arms[min(failed, sound), max(failed, sound)]
        self._reduce(failed, lost)
        self._reduce(sound, -lost)
        self._found[failed], self._found[sound] = CERTAIN, 0.0
        self.since[sound], self.evidence[sound] = None, ''

    def _learn(self, spread: Array, moving: bool, given: Array) -> None:
        """Learn what is usual, unless a failure is suspected."""
        if not self._usual.due(self._windows.block):
            return
        before, self._learnt = self._learnt, self._motion
        if not self._suspicious:
            steady = self._observer.estimate.dot(self._turn)
            motion = 0.5 * (before + self._learnt) if moving else None
            self._usual.learn(self._windows, spread, motion, steady, given)

    def _fail(self, rotor: int, share: float, time: int, evidence: str) -> None:
        self.since[rotor], self.evidence[rotor] = time, evidence
        self._refined[rotor] = 0.0
        self._reduce(rotor, share)

    def _stick(self, rotor: int, angle: float, time: int) -> None:
        """Take a rotor whose servo sticks out of use, if the vehicle can do without it."""
        self.since[rotor], self.evidence[rotor] = time, f'servo sticks at {angle:.2f} rad'
        # What it gives until it stops is known.
        planar, first = self._rotors.planar, self.vehicle.n
        for column, share in (
            (rotor, 1.0), (first + planar.index(rotor), -cos(angle)),
            (first + len(planar) + planar.index(rotor), -sin(angle)),
        ):
            lost = share * self._delivered[rotor]
            self._windows.explain(lost * self._windows.blocks[:, :, column])
        self._angles[rotor] = angle
        self._follow_servos()
        without = np.where(np.arange(first) == rotor, 0.0, self.health)
        self._stuck[rotor] = audit(self.vehicle.with_health(without)).sound

    def _reduce(self, rotor: int, share: float) -> None:
        """Take a share of a rotor's health, as if from the start of the windows on."""
        whole = self.vehicle.health[rotor]
        left = min(max(self._delivered[rotor] - share, 0.0), whole)
        left = 0.0 if left < USELESS * whole else left
        given = self._windows.blocks[:, :, : self.vehicle.n]
        signature = given + self._find.drags(given, self._windows.laterals)
        self._windows.explain((self._delivered[rotor] - left) * signature[:, :, rotor])
        self._delivered[rotor] = left

    def _refine(self, found: Finding, recent: list[int]) -> bool:
        """Estimate the health of rotors that have just failed; return whether it changes."""
        clear = np.abs(found.shares) > np.maximum(0.05, 3.0 * found.errors)
        rotors = [i for i in recent if clear[i] and self.health[i] > 0.0]
        for rotor in rotors:
            self._reduce(rotor, float(found.shares[rotor]))
        return bool(rotors)
