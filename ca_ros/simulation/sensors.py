"""Sensors: state and specific force as they are measured, with noise, bias and a delay."""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from math import hypot

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, VELOCITY, cross, rotation_matrix


class Sensors:
    """White Gaussian noise and a constant bias on a state.

    Errors have twelve components, three each of: position and velocity in the world frame
    [m, m/s], attitude as a rotation vector in the body frame [rad], and angular velocity in the
    body frame [rad/s].

    `noise` (12,): standard deviation of each sample.  `bias` (12,).
    """

    def __init__(self, noise: Array, bias: Array, rng: np.random.Generator) -> None:
        self.noise, self.bias = noise, bias
        self._rng = rng
        self._perfect = not (noise.any() or bias.any())

    def __call__(self, state: Array) -> Array:
        """Return a measurement (13,) of a state (13,)."""
        if self._perfect:
            return state
        error = self.bias + self.noise * self._rng.standard_normal(12)
        turned = turn(state[ATTITUDE], error[6:9])
        return np.concatenate([state[:6] + error[:6], turned, state[10:] + error[9:]])


class Accelerometer:
    """The mean specific force over the last sub-steps, with bias, noise and vibration.

    Each rotor has an unbalance, a force that turns with it, and blades, which pass twice a turn.
    The vibration is taken at one instant, so what is faster than the samples is aliased.

    `place` (3,): from the centre of mass [m].  `noise`: standard deviation of the white Gaussian
    noise [m/s^2].  `bias` (3,) [m/s^2].  `vibration`: on each axis as strong as a sine of this
    amplitude [m/s^2] where all `n` rotors turn at full speed.
    """

    def __init__(
        self, place: Array, noise: float, gravity: float, rng: np.random.Generator,
        bias: Array, vibration: float, n: int,
    ) -> None:
        self._place, self._noise, self._rng = place, noise, rng
        self._gravity, self._bias = np.array([0.0, 0.0, gravity]), bias
        self._amplitude = vibration / np.sqrt(n)  # of each rotor: their phases are random
        self._phases = 2.0 * np.pi * rng.random(n) if vibration else np.zeros(n)

    def __call__(
        self, states: Sequence[Array], step: float, speeds: Array, fastest: Array
    ) -> Array:
        """Return a measurement (3,) of states (13,) that are a sub-step [s] apart.

        - `speeds` (n,): of the rotors since the last measurement [rad/s]
        - `fastest` (n,): full speed [rad/s]
        """
        total = np.zeros(3)
        for before, after in pairwise(states):
            change = (after - before) / step
            omega, place = before[ANGULAR_VELOCITY], self._place
            felt = rotation_matrix(before[ATTITUDE]).T @ (change[VELOCITY] + self._gravity)
            total += felt + cross(change[ANGULAR_VELOCITY], place)
            total += cross(omega, cross(omega, place))
        error = self._bias + self._noise * self._rng.standard_normal(3)
        if self._amplitude:
            self._phases = self._phases + (len(states) - 1) * step * speeds
            x, y, z = np.cos(self._phases), np.sin(self._phases), np.cos(2.0 * self._phases)
            error += self._amplitude * np.array([x, y, z]) @ (speeds / fastest)**2
        return np.asarray(total / (len(states) - 1) + error)


def turn(quaternion: Array, rotation: Array) -> Array:
    """Return a unit quaternion x, y, z, w (4,) turned by a rotation vector (3,) in its body frame.

    The rotation vector is the axis times the angle [rad].
    """
    angle = hypot(*rotation.tolist())
    # sinc(x) = sin(pi x) / (pi x)
    i, j, k = (0.5 * np.sinc(angle / (2.0 * np.pi)) * rotation).tolist()
    real = float(np.cos(angle / 2.0))
    x, y, z, w = quaternion.tolist()
    turned = np.array(
        [
            w * i + x * real + y * k - z * j, w * j - x * k + y * real + z * i,
            w * k + x * j - y * i + z * real, w * real - x * i - y * j - z * k,
        ]
    )
    return turned / hypot(*turned.tolist())


STEPS_MAX = 1_000_000  # greatest delay in steps; each step takes memory


def delay_line(name: str, delay: float, step: float, first: Array) -> deque[Array]:
    """Return a queue with a first value for each step [s] of a delay [s].

    Raises a ParameterError if the delay is no whole number of steps, or over `STEPS_MAX` of them.
    """
    steps = round(delay / step)
    if steps > STEPS_MAX:
        raise ParameterError(f'{name}: expected up to {STEPS_MAX * step:g} s, got {delay:g} s')
    if abs(steps * step - delay) > 1e-6 * step:
        raise ParameterError(
            f'{name}: expected a multiple of simulator.time_step / simulator.sub_steps, '
            f'{step:g} s, got {delay:g} s'
        )
    return deque([first] * steps)
