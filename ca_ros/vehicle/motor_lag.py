"""The lag of motors and servos: speeds and angles that approach their commands."""

from math import expm1

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.state import difference
from ca_ros.vehicle.vehicle import Vehicle


def lagged(time_constant: float | Array, speeds: Array, command: Array, step: float) -> Array:
    """Return the speeds (n,) after a step [s] towards a command (n,) that is held [rad/s].

    The lag is of first order, T dw/dt = command - w.  `time_constant`: T [s]; 0: no lag.  An array
    (C, 1) of positive ones gives speeds (C, n).
    """
    if isinstance(time_constant, np.ndarray):
        return speeds - np.expm1(-step / time_constant) * (command - speeds)
    if not time_constant:
        return command
    return speeds - expm1(-step / time_constant) * (command - speeds)


def mean_speeds(time_constant: float, speeds: Array, command: Array, step: float) -> Array:
    """Return the mean speeds (n,) during a step of `lagged` [rad/s]."""
    if not time_constant:
        return command
    share = -expm1(-step / time_constant) * time_constant / step
    return command + share * (speeds - command)


class ServoLag:
    """Moves the servo angles.

    `time_constant`: of the lag [s]; 0: none.  `rate`: greatest rate [rad/s]; 0: unlimited.

    `resting`: speeds (n,) and angles (k,) at rest: the angles nearest to zero [rad/s, rad].
    """

    def __init__(self, time_constant: float, rate: float, vehicle: Vehicle) -> None:
        self._rate, self._time_constant = rate, time_constant
        self.resting = np.zeros(vehicle.n), vehicle.servos.resting

    def move(self, angles: Array, command: Array, step: float, vehicle: Vehicle) -> Array:
        """Return the angles (k,) after a step [s] towards a command (k,).

        Angles stay within the limits of the vehicle: a servo that sticks has no other angle.  An
        azimuth thruster turns the shorter way.
        """
        if not len(vehicle.servos):
            return angles
        shorter = angles + difference(command, angles)
        command = np.where(vehicle.servos.endless, shorter, command)
        moved = lagged(self._time_constant, angles, command, step)
        if self._rate:
            most = self._rate * step
            moved = angles + np.minimum(np.maximum(moved - angles, -most), most)
        return vehicle.servos.within(moved)
