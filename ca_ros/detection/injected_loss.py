"""A rotor that is taken from the motion of a recorded flight."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.detection.recorded_motion import Motion
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.state import cross, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

WAIT = 2.0  # in which an injected loss is to be named [s]


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
