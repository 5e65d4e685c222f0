"""The motion of a recorded flight, as its detector observes it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array
from ca_ros.detection.inertial import InertialMotion, Standby
from ca_ros.settings import ParameterError
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.plausibility import check, clipped, frozen, gaps, slow
from ca_ros.vehicle.state import GAP
from ca_ros.vehicle.vehicle import Vehicle


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
    notes += frozen(vehicle, recording, [name for name in used if name != 'command'])
    if 'speed' in recording.times:
        notes.append('measured speeds are not used: losses are tested by commands')
    start, end = recording.span
    times = recording.times['gyro']
    times = times[(times >= start) & (times <= end)]
    state = {'attitude', 'velocity'}
    carried = {*state, 'acc'} <= recording.times.keys()  # where they stop: see `_stood_by`
    for names, begin, until in gaps(recording, [name for name in used if not (
            carried and name in state)]):
        notes.append(f'{names}: nothing from {begin - start:.2f} s on, for {until - begin:.2f} s')
        times = times[(times <= begin) | (times >= until)]
    gyro = held(recording, 'gyro', times)
    force, velocity, attitude = (
        held(recording, name, times) if name in used else None
        for name in ('acc', 'velocity', 'attitude'))
    if force is not None and velocity is not None and attitude is not None:
        return _stood_by(
            vehicle, recording, Motion(times, attitude, velocity, gyro, force, notes))
    if force is None and velocity is None:
        raise ParameterError(f'{recording.name}: expected a velocity (vx, vy, vz), or a '
                             'specific force (acc_x, acc_y, acc_z)')
    if force is None:
        notes.append('no specific force: the change of velocity takes its place')
    if attitude is None:
        if force is None:
            raise ParameterError(f'{recording.name}: expected an attitude (qx, qy, qz, qw), or a '
                                 'specific force (acc_x, acc_y, acc_z)')
        notes.append('no attitude: gyro and accelerometer give it')
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


def held(recording: Recording, name: str, times: Array) -> Array:
    """Return the last values of a stream at some times."""
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
