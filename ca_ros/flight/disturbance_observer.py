"""Integral action: an estimate of the constant force and torque that the model lacks."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import cross, inertia_of
from ca_ros.vehicle.vehicle import Vehicle

JUMP_MAX = np.repeat([1.0, 10.0], 3)
"""Greatest changes of velocity [m/s] and angular velocity [rad/s] between two states that the
estimate uses: greater ones, as of a corrupted state, leave it as it is."""

START = np.repeat(0.2, 6)
"""Changes of velocity [m/s] and angular velocity [rad/s] with which a vehicle at rest starts."""


class DisturbanceObserver:
    """Estimates the disturbance d of the momentum p of a vehicle, dp/dt = w + d.

    w is the known wrench: that of the rotors, the weight and the gyroscopic torque.  The estimate
    is L (p - integral of (w + estimate)), so it approaches a constant disturbance as
    1 - exp(-L t) (De Luca and Mattone, Actuator failure detection and isolation using generalized
    momenta, ICRA 2003).  A controller that subtracts the estimate from its demand has integral
    action.  The wrench of the rotors is the attainable one, not the demand, so the estimate does
    not wind up while the demand is unattainable.  It stays zero until the vehicle has started, so
    it does not wind up while the motors do not run yet.

    Parameters
    ----------
    vehicle : Vehicle
    gain : float
        L [1/s].

    Attributes
    ----------
    estimate : (6,) array
        Force in the world frame before torque in the body frame [N, N m].
    """

    def __init__(self, vehicle: Vehicle, gain: float) -> None:
        self.gain = gain
        self.estimate: Array = np.zeros(6)
        self._mass, self._weight = vehicle.mass, vehicle.weight
        self._inertia = inertia_of(vehicle)
        self._jump_max = JUMP_MAX * np.repeat([vehicle.mass, np.linalg.norm(self._inertia, 2)], 3)
        self._time: int | None = None
        self._at_rest: Array | None = None
        self._expected = self._rate = np.zeros(6)

    def observe(self, time: int, velocity: Array, angular_velocity: Array) -> None:
        """Update the estimate with a new state.

        A time for the second time changes nothing.  With an earlier time the estimate starts
        again from zero.

        Parameters
        ----------
        time : int
            [ns]
        velocity : (3,) array
            In the world frame [m/s].
        angular_velocity : (3,) array
            In the body frame [rad/s].
        """
        if time == self._time:
            return
        motion = np.concatenate([velocity, angular_velocity])
        momentum = np.concatenate([self._mass * velocity, self._inertia @ angular_velocity])
        if self._time is None or time < self._time:
            self._at_rest = motion
        if self._time is None or self._at_rest is not None:
            self.estimate, self._expected = np.zeros(6), momentum
            if self._at_rest is not None and (abs(motion - self._at_rest) > START).any():
                self._at_rest = None
        else:
            expected = self._expected + (time - self._time) / 1e9 * self._rate
            offset = self.estimate / self.gain
            if (abs(momentum - expected - offset) <= self._jump_max).all():
                self._expected, self.estimate = expected, self.gain * (momentum - expected)
            else:
                self._expected = momentum - offset
        self._time = time

    def expect(self, force: Array, torque: Array, angular_velocity: Array) -> None:
        """Set what the rotors do from this state on.

        Parameters
        ----------
        force : (3,) array
            In the world frame [N].
        torque, angular_velocity : (3,) arrays
            In the body frame [N m, rad/s].
        """
        gyroscopic = cross(angular_velocity, self._inertia @ angular_velocity)
        self._rate = np.concatenate([force, torque - gyroscopic]) + self.estimate
        self._rate[2] -= self._weight
