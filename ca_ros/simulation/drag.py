"""The air: its drag on a vehicle, and a constant wind with gusts."""

from dataclasses import dataclass, field
from math import exp, expm1, hypot, sqrt

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class Drag:
    """Drag of the body and of its rotors.

    - `linear` (3,): drag force of the body over its airspeed, along the axes of the body [N s/m]
    - `rotor`: drag force of a rotor over its speed and the airspeed of its hub in the plane of the
      rotor [N s^2/(rad m)].  It acts on the hub.  Martin and Salaun, The true role of
      accelerometer feedback in quadrotor control, ICRA 2010
    - `rotational`: drag torque of the body over its squared angular velocity [N m s^2/rad^2]
    """

    linear: Array = field(default_factory=lambda: np.zeros(3))
    rotor: float = 0.0
    rotational: float = 0.0

    @property
    def takes_wind(self) -> bool:
        """Whether the drag depends on the airspeed."""
        return bool(self.linear.any() or self.rotor)

    def wrench(
        self, vehicle: Vehicle, airspeed: Array, omega: Array, speeds: Array
    ) -> tuple[Array, Array]:
        """Return the drag in the body frame: force (3,) [N] and torque (3,) [N m].

        - `airspeed` (3,): velocity relative to the air, in the body frame [m/s]
        - `omega` (3,): angular velocity in the body frame [rad/s]
        - `speeds` (n,): rotor speeds [rad/s]
        """
        force = -self.linear * airspeed
        torque = -self.rotational * hypot(*omega.tolist()) * omega
        if self.rotor:
            # numpy.cross takes longer than all of the rest.
            x, y, z = omega.tolist()
            turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
            hubs = airspeed + vehicle.arms @ turn
            axes = vehicle.rotor_axes
            across = hubs - (hubs * axes).sum(axis=1)[:, None] * axes
            # A rotor without its propeller has no drag, whether it turns or not.
            forces = -self.rotor * (vehicle.health * np.abs(speeds))[:, None] * across
            force = force + forces.sum(axis=0)
            moments = vehicle.arms.T @ forces
            torque = torque + (moments - moments.T)[[1, 2, 0], [2, 0, 1]]
        return force, torque


class Wind:
    """A constant wind plus a first-order Gauss-Markov process in each direction.

    The process is the longitudinal Dryden spectrum (MIL-F-8785C) of a vehicle with the airspeed V
    in turbulence of the scale L, for L / V = `correlation_time`.  It is stationary from the start
    and sampled exactly: the statistics do not depend on the step.

    - `mean` (3,): in the world frame [m/s]
    - `intensity` (3,): standard deviation of the gusts [m/s]
    - `correlation_time`: [s]
    """

    def __init__(
        self, mean: Array, intensity: Array, correlation_time: float, rng: np.random.Generator
    ) -> None:
        self.mean, self.intensity, self.correlation_time = mean, intensity, correlation_time
        self._rng, self._gusty = rng, bool(intensity.any())
        self._gust = intensity * rng.standard_normal(3)

    def __call__(self, step: float) -> Array:
        """Return the wind (3,) [m/s] of the next step [s]."""
        wind = self.mean + self._gust
        if self._gusty:
            ratio = step / self.correlation_time
            spread = self.intensity * sqrt(-expm1(-2.0 * ratio))
            self._gust = exp(-ratio) * self._gust + spread * self._rng.standard_normal(3)
        return wind
