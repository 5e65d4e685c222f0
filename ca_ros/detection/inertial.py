"""What an inertial unit says of the motion: the mean force between states, and the rest alone."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.state import GAP, cross, rotation_matrix

LEVELLING = 0.1  # rate at which the specific force levels the attitude [1/s]
LEAK = 0.5  # rate at which the velocity is forgotten [1/s]
HELD = 50_000_000  # how far from its stamp a sample counts at most [ns]
AHEAD = 100_000_000  # how much older than the newest sample a state is at most [ns]
LATE = 30_000_000  # the same from which names take longer [ns]
RISE = 20  # the time in which the least lead of the samples rises, over the rise
SAMPLES_MAX = 1000  # samples that may wait for a state

NONE = 'none has come'
STOPPED = 'it has stopped, or its clock is behind that of the states'
BEHIND = f'it is behind the states by more than {HELD // 10**6} ms: its clock is, or it comes late'


def ahead_by(limit: int) -> str:
    """Return the words for samples that are newer than a state that comes by more than this [ns].

    Whether their clock is ahead or the states come late cannot be told.
    """
    cause = 'its clock is, or they come late'
    return f'is ahead of the states by more than {limit // 10**6} ms: {cause}'


class SpecificForces:
    """Samples of the specific force, from which the mean between two states is taken.

    A sample holds from the one before it until its stamp, the newest also after it.  A step back
    of the stamps forgets what was before.

    - `time`: stamp of the newest sample [ns]; None before the first
    - `fault`: why samples far from the last state are not used, in words; empty if they are.
      That they have stopped holds until one is newer than that state.
    - `ahead`: by how much the newest sample is newer than a state that comes, the least of late
      [ns]
    """

    def __init__(self) -> None:
        self.time: int | None = None
        self.fault, self.ahead = '', 0
        self._samples: list[tuple[int, Array]] = []
        self._end, self._came = 0, False

    def add(self, time: int, force: Array) -> None:
        """Add a sample (3,) [m/s^2] with its stamp [ns]; one for the second time replaces it."""
        if self.time is not None and time <= self.time:
            self._samples = self._samples[:-1] if time == self.time else []
        self.time, self._came = time, True
        if self.fault in (NONE, STOPPED) and time > self._end:
            self.fault = ''
        self._samples.append((time, force))
        del self._samples[:-SAMPLES_MAX]

    def mean(self, start: int, end: int) -> Array | None:
        """Return the mean (3,) between two times [ns]; None without a sample at the end.

        The end is the stamp of the newest state: by samples far from it `fault` tells that the
        clocks differ.
        """
        lead = None if self.time is None else self.time - end
        # Samples that come, and are still too old, have another clock.
        behind = self.fault == BEHIND or (self.fault == STOPPED and self._came)
        if lead is not None:
            rise = min(max(end - self._end, 0), AHEAD) // RISE
            self.ahead = max(min(lead, self.ahead + rise), 0)
        self._end, self._came = end, False
        self.fault = (
            NONE if lead is None else
            f'it {ahead_by(AHEAD)}' if lead > AHEAD else
            '' if lead >= -HELD else BEHIND if behind else STOPPED)
        if self.fault:
            del self._samples[:-1]
        if self.fault or not start < end:
            return None
        total, now = np.zeros(3), start
        for time, force in [*self._samples, (end, self._samples[-1][1])]:
            if (until := min(time, end)) > now:
                if time - end > HELD:
                    return None
                total, now = total + (until - now) / (end - start) * force, until
        # What is older than the next interval counts no longer; the newest sample may hold on.
        self._samples = [each for each in self._samples[:-1] if each[0] > end] + self._samples[-1:]
        return total


class InertialMotion:
    """Attitude and velocity from gyro and accelerometer alone.

    The heading begins at zero, and constant parts of the velocity are forgotten.  Both serve the
    detector alone, which needs the changes of the velocity, and the direction of the weight.

    - `attitude` (4,): quaternion x, y, z, w, body to world
    - `velocity` (3,): in the world frame [m/s]
    """

    def __init__(self, gravity: float) -> None:
        self._gravity = gravity
        self.attitude, self.velocity = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)

    def begin(self, attitude: Array, velocity: Array) -> None:
        """Begin anew with an attitude (4,) and a velocity (3,) in the body frame [m/s]."""
        self.attitude, self.velocity = attitude, rotation_matrix(attitude).dot(velocity)

    def turn(self, step: float, angular_velocity: Array, force: Array) -> None:
        """Turn by an angular velocity (3,) [rad/s] for a step [s], and a little to the force."""
        q, up = self.attitude, rotation_matrix(self.attitude)[2]
        direction = force / max(float(np.linalg.norm(force)), 1e-9)
        x, y, z = 0.5 * step * (angular_velocity + LEVELLING * cross(direction, up))
        turned = q + np.array([
            q[3] * x + q[1] * z - q[2] * y, q[3] * y + q[2] * x - q[0] * z,
            q[3] * z + q[0] * y - q[1] * x, -q[0] * x - q[1] * y - q[2] * z])
        self.attitude = turned / np.linalg.norm(turned)

    def move(self, step: float, force: Array) -> Array:
        """Move by a specific force (3,) [m/s^2]; return the velocity (3,) in the body frame."""
        turn = rotation_matrix(self.attitude)
        acceleration = turn @ force - [0.0, 0.0, self._gravity]
        self.velocity = self.velocity + step * (acceleration - LEAK * self.velocity)
        return np.asarray(turn.T @ self.velocity)


class Standby:
    """An inertial unit that serves alone where no state comes, or none any more.

    It carries attitude and velocity on from the last state.  It serves after `GAP`, which the
    detector takes as a gap of the states: the motion in it explains nothing.

    - `alone`: whether it serves
    """

    def __init__(self, gravity: float) -> None:
        self.alone, self._gravity = False, gravity
        self._motion = InertialMotion(gravity)
        self._time: int | None = None
        self._silence = GAP

    def hear(self, attitude: Array, velocity: Array) -> None:
        """Take a state: attitude (4,), velocity (3,) in the body frame [m/s]."""
        self.alone, self._silence = False, 0
        self._motion.begin(attitude, velocity)

    def sense(self, time: int, angular_velocity: Array, force: Array) -> tuple[Array, Array]:
        """Take a sample with its stamp [ns]; return attitude (4,) and velocity (3,) in the body.

        After a gap of `GAP` or a step back of the stamps attitude and velocity begin at zero.
        """
        step = 0 if self._time is None else time - self._time
        self._time = time
        if not 0 <= step < GAP:
            self._motion, step = InertialMotion(self._gravity), 0
        self._silence += step
        self.alone = self._silence >= GAP
        self._motion.turn(step / 1e9, angular_velocity, force)
        return self._motion.attitude, self._motion.move(step / 1e9, force)
