"""The servos of rotors that tilt: angles that follow their commands with a lag and a rate."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.motor_lag import MotorLag
from ca_ros.flight.rigid_body import difference
from ca_ros.vehicle.vehicle import Vehicle


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
