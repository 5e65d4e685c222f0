"""The servos of rotors that tilt: angles that follow their commands with a lag and a rate."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.motor_lag import MotorLag
from ca_ros.flight.rigid_body import difference
from ca_ros.vehicle.vehicle import Vehicle


class Servos:
    """Moves the servo angles that follow the rotor speeds in an array.

    `time_constant`: of the lag [s]; 0: none.  `rate`: greatest rate [rad/s]; 0: unlimited.

    `initial` (n + k,): speeds and angles at rest: the angles nearest to zero [rad/s, rad].
    """

    def __init__(self, time_constant: float, rate: float, vehicle: Vehicle) -> None:
        angles = np.zeros(0) if vehicle.tilts is None else vehicle.tilts.resting
        self._n, self._rate, self._lag = vehicle.n, rate, MotorLag(time_constant)
        self.initial = np.concatenate([np.zeros(vehicle.n), angles])

    def __call__(
        self, before: Array, command: Array, after: Array, step: float, vehicle: Vehicle
    ) -> Array:
        """Return speeds and angles (n + k,) after a step [s]; `after` has the speeds already.

        Angles stay within the limits of the vehicle: a servo that sticks has no other angle.  An
        azimuth thruster turns the shorter way.
        """
        if vehicle.tilts is None:
            return after
        angles, command = before[self._n :], command[self._n :]
        shorter = angles + difference(command, angles)
        command = np.where(vehicle.tilts.endless, shorter, command)
        moved = self._lag(angles, command, step)
        if self._rate:
            most = self._rate * step
            moved = angles + np.minimum(np.maximum(moved - angles, -most), most)
        return np.concatenate([after[: self._n], vehicle.tilts.within(moved)])
