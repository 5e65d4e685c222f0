"""A recorded flight through the detector: what it would have named, and when."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray
from ca_ros.detection.acted_on import acted_on
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.inertial import InertialMotion, Standby
from ca_ros.detection.kernel_detector import Detector
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.detection.rotor_beliefs import words_of
from ca_ros.settings import ParameterError
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.plausibility import check, clipped, gaps, slow
from ca_ros.vehicle.state import GAP, cross, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

LAUNCH = 2.0  # after the ground [s]
LANDING = 1.0  # before thrust last carries a vehicle that comes to stand [s]
CARRYING = 0.9  # least share of the median thrust in the air that carries the vehicle
WAIT = 2.0  # in which an injected loss is to be named [s]


@dataclass(frozen=True, eq=False)
class Naming:
    """What the detector names.

    - `time`: since the beginning of the recording [s]
    - `rotors`: counted from 0
    - `arms`: see `FailureDetector.failed_arms`
    - `health`: what each is left
    - `margin`: lead of the evidence over that of a disturbance, a natural logarithm
    - `phase`: 'launch', within `LAUNCH` s after the ground, 'landing', see `landings`, or 'flight'
    - `withheld`: whether a part of it is not to be acted on, see `acted_on`
    """

    time: float
    rotors: tuple[int, ...]
    arms: tuple[tuple[int, int], ...]
    health: tuple[float, ...]
    margin: float
    phase: str
    withheld: bool = False

    @property
    def words(self) -> str:
        """The rotors, counted from 1, such as '1 or 2, 5'; see `words_of`."""
        words = words_of([rotor + 1 for rotor in self.rotors], self.arms)
        return ', '.join(words.values())


@dataclass(frozen=True, eq=False)
class Replay:
    """A replayed flight: `times` (K,) [s], `probabilities` (K, n + 1), and what was named.

    - `notes`: what is not recorded, and what took its place
    - `phases` (K,): 'ground', 'launch', 'flight' or 'landing'; see `Naming`
    - `tested` (K,): see `FailureDetector.testing`
    - `carried`: median thrust of the commands in the air, over the weight; nan without flight
    """

    times: Array
    probabilities: Array
    named: list[Naming]
    notes: list[str]
    phases: NDArray[np.str_]
    tested: BoolArray
    carried: float

    @property
    def flying(self) -> BoolArray:
        """Whether the vehicle is off the ground (K,)."""
        return np.asarray(self.phases != 'ground')

    @property
    def in_air(self) -> float:
        """Time off the ground, without gaps [s]."""
        return self._lasting(self.flying)

    @property
    def testing(self) -> float:
        """Time in which losses were tested [s]."""
        return self._lasting(self.tested)

    def _lasting(self, rows: BoolArray) -> float:
        steps = np.diff(self.times, prepend=self.times[0])
        return float(steps[np.logical_and(rows, steps < GAP / 1e9)].sum())


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a recording at the times (K,) of the gyro [s].

    - `attitude` (K, 4), `velocity`, `gyro` (K, 3): as of `Recording`
    - `force` (K, 3): specific force [m/s^2], if it is recorded
    """

    times: Array
    attitude: Array
    velocity: Array
    gyro: Array
    force: Array | None
    notes: list[str]


def motion_of(vehicle: Vehicle, recording: Recording) -> Motion:
    """Return the motion of a recording; what is missing is computed from the rest.

    Times at which a stream has no value for long are left out.  Raises a ParameterError if neither
    velocity nor specific force is recorded, or a stream cannot be true.
    """
    used = [name for name in recording.times if name != 'speed']
    notes = clipped(vehicle, recording) + check(vehicle, recording) + slow(recording, used)
    start, end = recording.span
    times = recording.times['gyro']
    times = times[(times >= start) & (times <= end)]
    state = {'attitude', 'velocity'}
    carried = {*state, 'acc'} <= recording.times.keys()  # where they stop: see `_stood_by`
    for names, begin, until in gaps(recording, [name for name in used if not (
            carried and name in state)]):
        notes.append(f'{names}: nothing from {begin - start:.2f} s on, for {until - begin:.2f} s')
        times = times[(times <= begin) | (times >= until)]
    gyro, force, velocity, attitude = (
        _held(recording, name, times) for name in ('gyro', 'acc', 'velocity', 'attitude'))
    assert gyro is not None
    if force is not None and velocity is not None and attitude is not None:
        return _stood_by(
            vehicle, recording, Motion(times, attitude, velocity, gyro, force, notes))
    if force is None and velocity is None:
        raise ParameterError(f'{recording.name}: expected a velocity, or a specific force')
    if force is None:
        notes.append('no specific force: the change of velocity takes its place')
    if attitude is None:
        if force is None:
            raise ParameterError(f'{recording.name}: expected an attitude, or a specific force')
        notes.append(
            'no attitude: gyro and accelerometer give it')
        attitude = _levelled(times, gyro, force, vehicle.gravity)
    if velocity is None:
        assert force is not None
        notes.append('no velocity: the accelerometer gives its changes')
        velocity = _integrated(times, attitude, force, vehicle.gravity)
    return Motion(times, attitude, velocity, gyro, force, notes)


def _stood_by(vehicle: Vehicle, recording: Recording, motion: Motion) -> Motion:
    """Return a motion that `Standby` carries on where attitude or velocity stop, as the monitor.

    Until it serves, nothing is observed.
    """
    times, force = motion.times, motion.force
    assert force is not None
    last = np.minimum(*(
        recording.times[name][_last(recording, name, times)] for name in ('attitude', 'velocity')))
    if (abs(times - last) < GAP / 1e9).all():
        return motion
    standby, kept, heard = Standby(vehicle.gravity), np.ones(len(times), bool), 0
    fresh = np.logical_and(np.diff(last, prepend=-np.inf) > 0.0, last <= times + 1e-9)
    for i, time in enumerate(np.round(1e9 * (times - times[0])).astype(int).tolist()):
        before = standby.alone
        carried = standby.sense(time, motion.gyro[i], force[i])
        if fresh[i]:
            heard = i
            standby.hear(motion.attitude[i], motion.velocity[i])
        elif standby.alone:
            motion.attitude[i], motion.velocity[i] = carried
            if not before:
                kept[heard + 1:i] = False
                motion.notes.append(
                    f'no state from {times[heard] - times[0]:.2f} s on: gyro and accelerometer '
                    'carry it on')
    return Motion(
        times[kept], motion.attitude[kept], motion.velocity[kept], motion.gyro[kept], force[kept],
        motion.notes)


def _last(recording: Recording, name: str, times: Array) -> NDArray[np.integer]:
    """Return where the last values of a stream at some times are."""
    at = np.searchsorted(recording.times[name], times + 1e-9, side='right') - 1
    return np.maximum(at, 0)


def _held(recording: Recording, name: str, times: Array) -> Array | None:
    """Return the last values of a stream at some times."""
    if name not in recording.values:
        return None
    return np.asarray(recording.values[name][_last(recording, name, times)])


def _levelled(times: Array, gyro: Array, force: Array, gravity: float) -> Array:
    """Return attitudes (K, 4) that follow the gyro, and in the mean the specific force."""
    motion, found = InertialMotion(gravity), np.empty((len(times), 4))
    steps = np.diff(times, prepend=times[0])
    for i, (step, omega, f) in enumerate(zip(steps, gyro, force, strict=True)):
        motion.turn(step, omega, f)
        found[i] = motion.attitude
    return found


def _integrated(times: Array, attitude: Array, force: Array, gravity: float) -> Array:
    """Return velocities (K, 3) in the body frame, of which constant parts are forgotten."""
    motion, found = InertialMotion(gravity), np.empty((len(times), 3))
    steps = np.diff(times, prepend=times[0])
    for i, (step, motion.attitude, f) in enumerate(zip(steps, attitude, force, strict=True)):
        found[i] = motion.move(step, f)
    return found


def replay(
    vehicle: Vehicle, recording: Recording, settings: DetectorSettings,
    motion: Motion | None = None, make: Callable[..., Detector] = FailureDetector,
) -> Replay:
    """Replay a recording, whose commands are rotor speeds [rad/s]; after a name, reset.

    - `motion`: by default `motion_of` the recording
    - `make`: makes the detector; with `make_detector` it is quicker, and margins are not known
    """
    motion = motion_of(vehicle, recording) if motion is None else motion
    detector = make(vehicle, settings)
    sent, commands = recording.times['command'], recording.values['command']
    begin, next_command = motion.times[0], 0
    probabilities = np.zeros((len(motion.times), vehicle.n + 1))
    named: list[Naming] = []
    off_ground = np.zeros(len(motion.times))
    tested = np.zeros(len(motion.times), bool)
    for i, now in enumerate(motion.times):
        time = round(1e9 * (now - begin))
        force = None if motion.force is None else motion.force[i]
        changed = detector.observe(
            time, motion.attitude[i], motion.velocity[i], motion.gyro[i], force)
        while next_command < len(sent) and sent[next_command] <= now:
            detector.command(round(1e9 * (sent[next_command] - begin)), commands[next_command])
            next_command += 1
        step = now - motion.times[i - 1] if i else 0.0
        off_ground[i] = -1.0 if detector.standing else max(off_ground[i - 1], 0.0) + step
        tested[i], probabilities[i] = detector.testing, detector.probabilities
        lost = np.flatnonzero(detector.health < vehicle.health)
        if changed and len(lost):
            named.append(Naming(
                float(now - begin), tuple(lost.tolist()), detector.failed_arms,
                tuple(detector.health[lost].tolist()), getattr(detector, 'margin', np.nan), '',
                bool(acted_on(detector).withheld)))
            detector.reset()
    held = _held(recording, 'command', motion.times)
    assert held is not None
    thrust, flying = vehicle.thrusts(held).sum(axis=1), np.asarray(off_ground >= 0.0)
    phases = np.full(len(flying), 'flight', '<U7')
    phases[off_ground < LAUNCH] = 'launch'
    phases[landings(motion.times, flying, thrust)] = 'landing'
    phases[~flying] = 'ground'
    at = np.searchsorted(motion.times - begin, [each.time for each in named])
    named = [
        replace(each, phase=str(phase)) for each, phase in zip(named, phases[at], strict=True)]
    carried = float(np.median(thrust[flying])) / vehicle.weight if flying.any() else np.nan
    return Replay(
        motion.times - begin, probabilities, named, motion.notes, phases, tested, carried)


def landings(times: Array, flying: BoolArray, thrust: Array) -> BoolArray:
    """Return when a vehicle lands (K,): it comes to stand, and its thrust carries it no more.

    It is found to stand 1 to 3 s after the contact, which is not recorded.  So a landing begins
    `LANDING` s before the last thrust of `CARRYING` times the median of the flight.

    - `flying` (K,): whether it is off the ground, as the detector sees it
    - `thrust` (K,): commanded
    """
    landing = np.zeros(len(times), bool)
    for end in np.flatnonzero(np.diff(flying.astype(int)) < 0) + 1:
        carries = np.flatnonzero(thrust[:end] >= CARRYING * np.median(thrust[flying]))
        if len(carries):
            landing[:end] |= times[:end] > times[carries[-1]] - LANDING
    return np.asarray(landing & flying)


def without_rotor(
    vehicle: Vehicle, recording: Recording, settings: DetectorSettings, motion: Motion,
    rotor: int, time: float,
) -> Motion:
    """Return a motion from which a rotor is taken at a time [s], until `WAIT` s later.

    What the rotor would have given since then, by its commands, is taken from velocity, gyro and
    specific force.  The controller does not react, so this is true for a short time only.
    """
    rotors = CommandedRotors(vehicle, settings)
    begin = motion.times[0]
    sent, commands = recording.times['command'], recording.values['command']
    next_command = 0
    column = rotor_wrenches(vehicle)[:, rotor]
    inertia = inertia_of(vehicle)
    kept = motion.times <= begin + time + WAIT
    velocity, gyro = motion.velocity[kept].copy(), motion.gyro[kept].copy()
    force = None if motion.force is None else motion.force[kept].copy()
    moved, turned = np.zeros(3), np.zeros(3)
    for i, now in enumerate(motion.times[kept]):
        last = motion.times[i - 1] if i else now
        if now <= last:
            continue
        ends = [round(1e9 * (each - begin)) for each in (last, now)]
        # Only so many commands may wait.
        while next_command < len(sent) and sent[next_command] <= now:
            command = rotors.bounds.followed(commands[next_command])
            rotors.command(round(1e9 * (sent[next_command] - begin)), command)
            next_command += 1
        thrust = rotors.thrusts(*ends)[rotor]
        if now - begin < time:
            continue
        turn = rotation_matrix(motion.attitude[i])
        moved = moved + (now - last) * thrust / vehicle.mass * (turn @ column[:3])
        velocity[i] -= turn.T @ moved
        turned = turned + _turned(
            inertia, motion.gyro[i - 1], motion.gyro[i], turned, thrust * column[3:], now - last)
        gyro[i] -= turned
        if force is not None:
            force[i] -= thrust / vehicle.mass * column[:3]
    return Motion(
        motion.times[kept], motion.attitude[kept], velocity, gyro, force, motion.notes)


def _turned(
    inertia: Array, before: Array, after: Array, turned: Array, torque: Array, step: float
) -> Array:
    """Return how a lost torque (3,) changes an angular velocity more in a step (3,): Runge-Kutta.

    - `before`, `after`: the angular velocity with the torque
    - `turned`: what it is less without it, before
    """
    def rate(share: float, turned: Array) -> Array:
        whole = before + share * (after - before)
        less = whole - turned
        gyroscopic = cross(less, inertia @ less) - cross(whole, inertia @ whole)
        return np.asarray(np.linalg.solve(inertia, torque + gyroscopic))

    first = rate(0.0, turned)
    second = rate(0.5, turned + 0.5 * step * first)
    third = rate(0.5, turned + 0.5 * step * second)
    last = rate(1.0, turned + step * third)
    return np.asarray(step / 6.0 * (first + 2.0 * second + 2.0 * third + last))
