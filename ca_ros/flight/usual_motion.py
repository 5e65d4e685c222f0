"""What is usual in a flight without failures: thrusts, drag and noise."""

from __future__ import annotations

from math import expm1

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import inertia_of
from ca_ros.flight.settings import DetectorSettings
from ca_ros.flight.windows import WINDOWS, Windows
from ca_ros.vehicle.vehicle import Vehicle

FLOOR = 0.3  # least noise over that of the settings


class UsualMotion:
    """Learns the mean thrusts, the drag along and about each axis, and the noise of windows.

    - `wrenches` (6, n): force and torque per thrust of each rotor
    - `noise` (6,): variance of an impulse by the noise of the settings
    - `flown`: time since the flight began [s]
    """

    def __init__(self, vehicle: Vehicle, settings: DetectorSettings, wrenches: Array) -> None:
        self._settings, self._squares = settings, wrenches**2
        inertia, s = np.diag(inertia_of(vehicle)), settings
        force = np.full(3, vehicle.mass * s.velocity_noise)
        self.noise = 2.0 * np.concatenate([force, inertia * s.angular_velocity_noise]) ** 2
        self._floor = FLOOR**2 * self.noise
        self.reset()
        self.begin()

    def reset(self) -> None:
        """Forget the drag and the noise."""
        self._variance = np.tile(self.noise, (len(WINDOWS), 1))
        self._drag = np.zeros(6)
        self._means, self._products = np.zeros((2, 6)), np.zeros((2, 6))

    def begin(self) -> None:
        """Begin a flight."""
        self.flown, self._thrusts = 0.0, np.zeros(self._squares.shape[1])

    @property
    def gain(self) -> float:
        """The rate of learning [1/s]: greater in the beginning of a flight."""
        return 1.0 / min(self._settings.learning_time, self.flown + 0.05)

    def drag(self, motion: Array) -> Array:
        """Return the drag (6,) [N, N m] of a motion (6,), beyond that of the mean motion."""
        return self._drag * (motion - self._means[1])

    def fly(self, step: float, thrusts: Array) -> None:
        """Take a step [s] of the flight, with its thrusts (n,)."""
        if not self.flown:
            self._thrusts = thrusts
        self.flown += step

    def learn(self, step: float, lacked: Array, motion: Array, thrusts: Array) -> None:
        """Learn from the wrench (6,) that was lacked in a step, without drag."""
        self._thrusts = self._thrusts - expm1(-step * self.gain) * (thrusts - self._thrusts)
        share = -expm1(-step / min(2.5 * self._settings.learning_time, self.flown))
        moved = np.array([lacked, motion]) - self._means
        self._means = self._means + share * moved
        self._products = self._products + share * (moved * moved[1] - self._products)
        self._drag = np.minimum(self._products[0] / (self._products[1] + 0.05**2), 0.0)

    def spread(self) -> Array:
        """Return the variance (T, 6) of what windows lack, by noise."""
        return np.maximum(self._variance, self._floor)

    def learn_noise(self, windows: Windows, spread: Array) -> None:
        """Learn from what windows lack that show no failure."""
        share = -expm1(-windows.block * self.gain)
        squares = np.minimum(windows.lacked**2, 9.0 * spread)
        self._variance = spread + share * (squares - spread)

    def model_errors(self, windows: Windows) -> Array:
        """Return the variance (T, 6) by errors of the thrusts, the lag and the delay."""
        s = self._settings
        unusual = windows.given - windows.ages[:, None] * self._thrusts
        error = (s.thrust_error * unusual) ** 2 + (s.time_error * windows.change) ** 2
        return np.asarray(error @ self._squares.T)
