"""The lag of motors and servos: speeds and angles that approach their commands."""

from __future__ import annotations

from math import expm1

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import difference
from ca_ros.vehicle.vehicle import Vehicle


class MotorLag:
    """A first-order lag, T dw/dt = command - w, solved exactly for a command that is held.

    `time_constant`: T [s]; 0: the rotors have the commanded speeds at once.  An array
    (C, 1) of positive ones gives speeds (C, n).
    """

    def __init__(self, time_constant: float | Array) -> None:
        self.time_constant = time_constant

    def __call__(self, speeds: Array, command: Array, step: float) -> Array:
        """Return the speeds (n,) after a step [s] from the speeds (n,) before it [rad/s]."""
        if isinstance(self.time_constant, np.ndarray):
            return speeds - np.expm1(-step / self.time_constant) * (command - speeds)
        if not self.time_constant:
            return command
        return speeds - expm1(-step / self.time_constant) * (command - speeds)


class Servos:
    """Moves the servo angles.

    `time_constant`: of the lag [s]; 0: none.  `rate`: greatest rate [rad/s]; 0: unlimited.

    `resting`: speeds (n,) and angles (k,) at rest: the angles nearest to zero [rad/s, rad].
    """

    def __init__(self, time_constant: float, rate: float, vehicle: Vehicle) -> None:
        angles = np.zeros(0) if vehicle.tilts is None else vehicle.tilts.resting
        self._rate, self._lag = rate, MotorLag(time_constant)
        self.resting = np.zeros(vehicle.n), angles

    def move(self, angles: Array, command: Array, step: float, vehicle: Vehicle) -> Array:
        """Return the angles (k,) after a step [s] towards a command (k,).

        Angles stay within the limits of the vehicle: a servo that sticks has no other angle.  An
        azimuth thruster turns the shorter way.
        """
        if vehicle.tilts is None:
            return angles
        shorter = angles + difference(command, angles)
        command = np.where(vehicle.tilts.endless, shorter, command)
        moved = self._lag(angles, command, step)
        if self._rate:
            most = self._rate * step
            moved = angles + np.minimum(np.maximum(moved - angles, -most), most)
        return vehicle.tilts.within(moved)
