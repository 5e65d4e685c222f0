"""Rotor failures that nobody announces, detected from the motion of a vehicle."""

from collections.abc import Mapping
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import RESTART
from ca_ros.detection.detector_inputs import force_of, moment_of, numbers_of, state_of
from ca_ros.detection.detector_settings import DetectorSettings, no_lag
from ca_ros.detection.motion_test import MotionTest
from ca_ros.detection.rotor_beliefs import RotorBeliefs
from ca_ros.detection.speed_residual import SlowRotors
from ca_ros.problem.vehicle_problem import problem_of, vehicle_of
from ca_ros.settings import settings_of
from ca_ros.vehicle.state import GAP
from ca_ros.vehicle.validation import ABSURD
from ca_ros.vehicle.vehicle import Vehicle, inertia_of


def settings_with_lag(
    settings: DetectorSettings | None, given: Mapping[str, Any]
) -> DetectorSettings:
    """Return the settings of a detector; warn the caller of the caller if they have no lag."""
    found = settings_of(FailureDetector, DetectorSettings, settings, given)
    if not settings and (text := no_lag(given, '')):
        warn(text, RuntimeWarning, stacklevel=3)
    return found


def described(detector: Any) -> str:
    """Return the vehicle of a detector, the lag of its motors and what was found, in one line."""
    found = [f'{i} by {word}' for i, word in enumerate(detector.evidence, 1) if word]
    return (f'{type(detector).__name__}: {detector.vehicle.described}, motors with a lag of '
            f'{detector.settings.motor_time_constant:g} s, found: {", ".join(found) or "none"}')


class FailureDetector:
    """Names the rotors whose lost thrust explains the motion, or that do not turn as commanded.

    From each state and from the commands, the momentum observer gives the impulse that the sound
    rotors, the weight, the mean disturbance and the drag do not explain.  Every hundredth of a
    second, `HypothesisTest` compares the sums over several windows of time with what each rotor
    should have given, and with disturbances; rotors that three tests in a row name have failed.

    While nothing is suspected, the mean disturbance, the drag and the noise are learnt.  Nothing
    is tested until the motors have settled after the first command, and for 0.3 s more where a
    flight begins in mid-air, or after `reset`; in its first 2 s its trim adds a variance.

    `command`, `measure`, `observe` and `announce` raise a ValueError if there is another number of
    numbers, or one is not finite or absurdly large; it has then entered nothing.  Commands beyond
    the bounds of the vehicle are clipped to them, as motors do.

    Where the speeds of the rotors are measured, `SlowRotors` finds those that do not follow their
    commands.

    Where the rotors of a coaxial pair cannot be told apart, the arm is named, or two arms: each of
    both rotors has then lost half, so the arm gives what is expected if both get the same thrust.
    What one of them keeps comes back when the motion tells which one has failed.

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
        if not isinstance(vehicle, Vehicle):
            vehicle = vehicle_of(problem_of(vehicle))
        s = self.settings = settings_with_lag(settings, given)
        self._slow = SlowRotors(vehicle.n, s)
        self._beliefs = RotorBeliefs(vehicle)
        self._motion = MotionTest(vehicle, s, self._beliefs)

    def __repr__(self) -> str:
        """Return the vehicle, the lag of its motors and what was found, in one line."""
        return described(self)

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the announced health."""
        return self._beliefs.vehicle

    @property
    def standing(self) -> bool:
        """Whether the vehicle stands; then nothing is detected."""
        return self._motion.observer.standing

    @property
    def testing(self) -> bool:
        """Whether losses are tested: in the air, with the speeds of the motors known."""
        return self._motion.testing

    @property
    def since(self) -> list[int | None]:
        """When each rotor was found to have failed [ns]."""
        return self._beliefs.since

    @property
    def order(self) -> list[int]:
        """The number of the name of each rotor, from 1, in the order of naming; 0: not named.

        Rotors that are named in one test share a number.
        """
        return self._beliefs.order

    @property
    def evidence(self) -> list[str]:
        """What each failure was found by: 'motion' or 'rotor speed', or where its servo sticks."""
        return self._beliefs.evidence

    @property
    def suspect(self) -> int | None:
        """The rotor that may be failing now."""
        return self._motion.suspicion.suspect

    @property
    def health(self) -> Array:
        """The announced health, less what was found, (n,).

        What was found holds until `reset`, but for a rotor of a named arm.

        A rotor whose servo sticks has none, if the vehicle can do without it.
        """
        return self._beliefs.health

    @property
    def failed_arms(self) -> tuple[tuple[int, int], ...]:
        """The named arms: rotors, from 1, of which one has failed, and which one is unknown."""
        return tuple(sorted((i + 1, j + 1) for i, j in self._beliefs.arms))

    @property
    def probabilities(self) -> Array:
        """Probabilities (n + 1,): that each rotor has failed, now or before; of a disturbance."""
        found = np.append(self._beliefs.found, 0.0)
        return np.where(found, found, self._motion.suspicion.probabilities)

    def reset(self) -> None:
        """Forget all failures, and what was learnt of the noise."""
        self._beliefs.reset()
        self._slow.reset()
        self._motion.reset()

    def interrupt(self) -> None:
        """Take the next state as one that does not continue those before; what was found holds.

        The motion between the two explains nothing, such as where an estimator was reset, or
        where others have flown the vehicle.
        """
        self._motion.observer.interrupt()

    def announce(self, health: ArrayLike, stuck: Mapping[int, float] | None = None) -> None:
        """Take what is announced, which replaces what was before; what was found holds.

        - `health` (n,)
        - `stuck`: the servos that stick: by rotor, from 1, the angle [rad]
        """
        before, vehicle = self.vehicle.servos, self.vehicle.with_health(health, stuck=stuck or {})
        less, told = vehicle.health < self._beliefs.delivered, False
        for pair in list(self._beliefs.arms):
            # Whoever announces one rotor of an arm tells which one has failed.
            if less[pair[0]] != less[pair[1]]:
                self._motion.changes.tell_arm(*(pair if less[pair[0]] else pair[::-1]))
                told = True
        changed = self._beliefs.announce(vehicle) or told
        after = self.vehicle.servos
        moved = (after.lower != before.lower) | (after.upper != before.upper)
        if moved.any():
            self._motion.follow_servos()
        if moved.any() or changed:
            # When it failed is not known: the motion before shows nothing more.
            self._motion.changes.forget()

    def command(self, time: int, command: ArrayLike) -> None:
        """Take a command with its stamp [ns]: speeds (n,) and then angles (k,) [rad/s, rad].

        Beyond the bounds of the vehicle, motors and servos are at these.  A command that is newer
        than the last state by seconds is ignored.
        """
        size = self.vehicle.n + len(self.vehicle.servos)
        time, numbers = moment_of(time), numbers_of('command', command, size)
        followed = self._motion.rotors.bounds.followed(numbers)
        last = self._motion.observer.time
        if last is not None and time - last >= RESTART:
            return
        self._motion.command(time, followed)
        self._slow.command(time, followed[: self.vehicle.n])

    def measure(self, time: int, speeds: ArrayLike) -> bool:
        """Take measured rotor speeds (n,) [rad/s]; return whether the health has changed.

        Those that are older than the last command by more than `oldest_measurement` are ignored.
        """
        time, measured = moment_of(time), numbers_of('speeds', speeds, self.vehicle.n)
        if not (abs(measured) <= ABSURD).all():
            raise ValueError(f'speeds {speeds!s}: expected {self.vehicle.n} numbers up to 1e100')
        beliefs = self._beliefs
        found = self._slow.measure(time, measured, beliefs.found == 0.0)
        failed = [(i, share) for i, share in found or [] if beliefs.health[i] > 0.0]
        if failed or found is None:
            # When they failed is not known: the motion before shows nothing more.
            self._motion.changes.forget()
        order = beliefs.next_name
        for rotor, share in failed:
            for pair in [pair for pair in beliefs.arms if rotor in pair]:
                self._motion.changes.tell_arm(rotor, sum(pair) - rotor)
            beliefs.found[rotor] = 1.0
            self._motion.changes.fail(
                rotor, share * beliefs.health[rotor], time, order, 'rotor speed')
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
        time = moment_of(time)
        attitude, motion = state_of(attitude, velocity, angular_velocity)
        force, last = force_of(specific_force), self._motion.observer.time
        changed = self._motion.observe(time, attitude, motion, force)
        if last is not None and 0 < time - last < GAP:
            self._slow.expect(time, self._motion.rotors.speeds)
        return changed


def margin_of(detector: FailureDetector) -> float:
    """Return the lead of the evidence for what is named, or the likeliest rotor.

    Over a disturbance, in the last test in which something was suspected; a natural logarithm.
    """
    return detector._motion.suspicion.margin


def model_of(detector: FailureDetector) -> dict[str, Array]:
    """Return the numbers of ca_detector_model (ca_ros/kernel/detector.h) by name."""
    vehicle, settings, motion = detector.vehicle, detector.settings, detector._motion
    find, usual, rotors = motion.hypotheses, motion.usual, motion.rotors
    sound, curve = vehicle.intact, vehicle.curve
    numbers = {
        'rotors': vehicle.n, 'mass': vehicle.mass, 'weight': vehicle.weight,
        'inertia': inertia_of(vehicle), 'wrenches': rotors.wrenches,
        'segments': len(curve.rows), 'curve': curve.rows,
        'least': rotors.bounds.least, 'greatest': rotors.bounds.greatest,
        'thrust': sound.thrust_per_squared_speed / curve.coefficient,
        'reverse_thrust': sound.reverse_thrust_per_squared_speed * curve.square,
        'health': vehicle.health,
        'time_constant': settings.motor_time_constant, 'delay': settings.delay,
        'arms': vehicle.arms.T,
        'partner': [-1 if each is None else each for each in find.partners],
        'unit': find.unit, 'disturbance': find.disturbances.variances,
        'gravity': vehicle.mass * vehicle.gravity, 'imu': motion.imu,
        'lever': find.naming.lever, 'force_noise': usual.force_noise,
        'noise': usual.noise, 'moving': motion.moving,
        'jump': motion.observer.jump_max, 'balance': motion.observer.ground.limits,
    }
    return {name: np.array(value, float) for name, value in numbers.items()}
