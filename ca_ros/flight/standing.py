"""Whether a vehicle stands: on the ground, or held, or with its motors off."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.vehicle import Vehicle

MOTION = 0.05
"""Velocity [m/s] and angular velocity [rad/s] of a vehicle that moves, averaged over
`AVERAGING` s."""

AVERAGING = 0.2

REST = 0.5  # a vehicle that stands has not moved for this time [s]

FORCE, TORQUE = 0.3, 0.1
"""Without balance of this vertical force, over m g, or of this torque, over m g and the mean
distance of the rotors, a vehicle in flight moves."""


class Standing:
    """Tells from motion and wrench whether a vehicle stands.

    A vehicle stands until it moves.  It stands again if it does not move for a while and the
    wrench of its rotors is far from balance: thrust below its weight on the ground, or above it
    with motors that are off.

    `still`: time for which the vehicle has not moved [s]; 0 if it moves.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.standing, self.still = True, 0.0
        arm = np.linalg.norm(vehicle.arms, axis=1).mean()
        limits = np.array([FORCE, *3 * [TORQUE * arm]])
        self.limits = vehicle.mass * vehicle.gravity * limits
        self._motion = [0.0] * 6

    def observe(self, step: float, motion: Array, wrench: Array) -> bool:
        """Return whether the vehicle stands after a step.

        - `step`: [s]
        - `motion` (6,): velocity before angular velocity [m/s, rad/s]
        - `wrench` (6,): of rotors and weight during the step: force in the world frame before
          torque [N, N m]
        """
        share, now = min(1.0, step / AVERAGING), motion.tolist()
        self._motion = [m + share * (x - m) for m, x in zip(self._motion, now, strict=True)]
        if max(map(abs, self._motion)) > MOTION:
            self.standing, self.still = False, 0.0
        else:
            self.still += step
            unbalanced = bool((abs(wrench[2:]) > self.limits).any())
            self.standing = self.standing or (unbalanced and self.still > REST)
        return self.standing
