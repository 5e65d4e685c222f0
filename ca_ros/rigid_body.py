"""Rigid-body dynamics of a multirotor.

The world frame is east-north-up, the body frame forward-left-up (REP 103).  A state is one array
(13,): position [m] and velocity [m/s] in the world frame, attitude as a unit quaternion x, y, z, w
(body to world), and angular velocity in the body frame [rad/s].
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ca_ros.arrays import Array
from ca_ros.control_allocation_matrix import rotor_wrenches
from ca_ros.vehicle import Vehicle

POSITION, VELOCITY, ATTITUDE, ANGULAR_VELOCITY = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 10),
    slice(10, 13),
)

NULL_STATE: Array = np.concatenate([np.zeros(9), [1.0], np.zeros(3)])


def rotation_matrix(quaternion: Array) -> Array:
    """Return the matrix (3, 3) from body to world coordinates for a quaternion x, y, z, w."""
    return Rotation.from_quat(quaternion).as_matrix()


def cross(a: Array, b: Array) -> Array:
    """Return a x b for two (3,) arrays; NumPy's own takes ten times as long on so little."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


class RigidBody:
    """The vehicle's equations of motion; its rotors are as fast as their commands.

    Parameters
    ----------
    vehicle : Vehicle
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self._wrenches = rotor_wrenches(vehicle)
        self._inverse_inertia = np.linalg.inv(vehicle.inertia)

    def derivative(self, state: Array, speeds: Array) -> Array:
        """Return the rate of change (13,) of a state (13,) at rotor speeds (n,) [rad/s]."""
        wrench = self._wrenches @ self.vehicle.thrusts(speeds)
        x, y, z, w = state[ATTITUDE].tolist()
        omega = state[ANGULAR_VELOCITY]
        rate = np.empty(13)
        rate[POSITION] = state[VELOCITY]
        rate[VELOCITY] = rotation_matrix(state[ATTITUDE]) @ wrench[:3] / self.vehicle.mass
        rate[5] -= self.vehicle.gravity
        rate[ATTITUDE] = 0.5 * np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ omega
        rate[ANGULAR_VELOCITY] = self._inverse_inertia @ (
            wrench[3:] - cross(omega, self.vehicle.inertia @ omega)
        )
        return rate

    def step(self, state: Array, speeds: Array, time_step: float) -> Array:
        """Return the state (13,) one explicit Euler step later, its quaternion normalised.

        Raises
        ------
        FloatingPointError
            If the vehicle tumbles so fast that the steps diverge.
        """
        with np.errstate(over='ignore', invalid='ignore'):
            after = state + time_step * self.derivative(state, speeds)
            length = np.linalg.norm(after[ATTITUDE])
            after[ATTITUDE] /= length
        if not (np.isfinite(length) and np.isfinite(after).all()):
            raise FloatingPointError(
                f'the vehicle tumbles so fast that Euler steps of {time_step:g} s diverge'
            )
        return after


def velocity_in_body(state: Array) -> Array:
    """Return the velocity (3,) of a state (13,) in the body frame [m/s]."""
    return state[VELOCITY] @ rotation_matrix(state[ATTITUDE])
