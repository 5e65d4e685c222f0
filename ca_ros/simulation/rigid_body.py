"""Rigid-body dynamics of a multirotor.

The world frame is east-north-up, the body frame forward-left-up (REP 103).  A state is one array
(13,): position [m] and velocity [m/s] in the world frame, attitude as a unit quaternion x, y, z, w
(body to world), and angular velocity in the body frame [rad/s].
"""

from collections.abc import Callable
from math import hypot
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.simulation.drag import Drag
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

Derivative = Callable[[Array], Array]


def euler(derivative: Derivative, state: Array, step: float) -> Array:
    """Return the state after an explicit Euler step, of order 1."""
    return state + step * derivative(state)


def rk4(derivative: Derivative, state: Array, step: float) -> Array:
    """Return the state after a step of the classical Runge-Kutta method, of order 4."""
    k1 = derivative(state)
    k2 = derivative(state + 0.5 * step * k1)
    k3 = derivative(state + 0.5 * step * k2)
    k4 = derivative(state + step * k3)
    return state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


INTEGRATORS = {'euler': euler, 'rk4': rk4}  # by the value of `simulator.integrator`


POSITION, VELOCITY, ATTITUDE, ANGULAR_VELOCITY = (
    slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
)

NULL_STATE: Array = np.concatenate([np.zeros(9), [1.0], np.zeros(3)])

CALM: Array = np.zeros(3)

STATE_MAX = 1e9  # in each unit of the state; what exceeds it is no motion of a vehicle


def rotation_matrix(quaternion: Array) -> Array:
    """Return the matrix (3, 3) from body to world coordinates for a quaternion x, y, z, w.

    The quaternion is normalized first.  SciPy's function takes ten times as long for one.
    """
    numbers = quaternion.tolist()
    length = hypot(*numbers)
    x, y, z, w = (number / length for number in numbers)
    # A flat list takes half the time of a nested one.
    return np.array([
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    ]).reshape(3, 3)


def heading(attitude: Array) -> Array:
    """Return the heading (...) of quaternions x, y, z, w (..., 4), in [-pi, pi] [rad].

    The heading is the rotation about the body's z axis after the shortest rotation that makes this
    axis vertical, so a tilt does not change the heading.  Upside down, the shortest rotation is
    not unique, and the heading is 0.
    """
    z, w = attitude[..., 2], attitude[..., 3]
    return 2.0 * np.arctan2(np.where(w < 0.0, -z, z), np.abs(w))


def difference(angle: Any, other: Any) -> Any:
    """Return `angle` minus `other`, wrapped to [-pi, pi) [rad]."""
    return (angle - other + np.pi) % (2.0 * np.pi) - np.pi


def euler_angles(attitude: Array) -> Array:
    """Return roll, pitch, yaw (..., 3) of quaternions x, y, z, w (..., 4) [rad].

    Euler angles 123, about x, the new y and the new z; roll and yaw are equal where only their sum
    or difference is defined, at a pitch of 90 degrees.
    """
    x, y, z, w = np.moveaxis(attitude, -1, 0)
    mean = np.arctan2(x + z, w + y)
    half = np.arctan2(x - z, w - y)
    pitch = 2.0 * np.arctan2(np.hypot(x + z, w + y), np.hypot(x - z, w - y)) - np.pi / 2.0
    turns = np.stack([mean + half, mean - half], axis=-1)
    roll, yaw = np.moveaxis(turns - 2.0 * np.pi * np.round(turns / (2.0 * np.pi)), -1, 0)
    return np.stack([roll, pitch, yaw], axis=-1)


def tilt(attitude: Array) -> Array:
    """Return the angle (...) between the body's z axis and the vertical [rad]."""
    x, y, z, w = np.moveaxis(attitude, -1, 0)
    return 2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w))


def cross(a: Array, b: Array) -> Array:
    """Return a x b for two (3,) arrays, in a tenth of the time of `numpy.cross`."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


class RigidBody:
    """The vehicle's equations of motion for given rotor speeds and wind.

    Raises a ParameterError if the vehicle has no inertia.

    `vehicle`: with the actual health of the rotors.  `drag`: the drag of the air; None: no drag.
    """

    def __init__(self, vehicle: Vehicle, drag: Drag | None = None) -> None:
        self.vehicle = vehicle
        self.drag = drag
        self._wrenches = rotor_wrenches(vehicle)
        self._inertia = inertia_of(vehicle)
        self._inverse_inertia = np.linalg.inv(self._inertia)
        # The buoyancy acts at the centre of mass.
        self._gravity = np.array([0.0, 0.0, vehicle.gravity - vehicle.buoyancy / vehicle.mass])

    def derivative(self, state: Array, speeds: Array, wind: Array = CALM) -> Array:
        """Return the rate of change (13,) of a state (13,).

        - `state` (13,)
        - `speeds` (n,): rotor speeds [rad/s]; of a vehicle whose rotors tilt, the servo angles
          [rad] follow
        - `wind` (3,): in the world frame [m/s]; it acts through the drag
        """
        vehicle = self.vehicle
        if vehicle.tilts is None:
            wrench = self._wrenches @ vehicle.thrusts(speeds)
        else:
            speeds, angles = np.split(speeds, [vehicle.n])
            wrench = rotor_wrenches(vehicle, angles) @ vehicle.thrusts(speeds)
        x, y, z, w = state[ATTITUDE].tolist()
        omega = state[ANGULAR_VELOCITY]
        rotation = rotation_matrix(state[ATTITUDE])
        force, torque = wrench[:3], wrench[3:] - cross(omega, self._inertia @ omega)
        if self.drag is not None:
            airspeed = (state[VELOCITY] - wind) @ rotation
            drag_force, drag_torque = self.drag.wrench(self.vehicle, airspeed, omega, speeds)
            force, torque = force + drag_force, torque + drag_torque
        turning = np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ omega
        return np.concatenate(
            [
                state[VELOCITY], rotation @ force / self.vehicle.mass - self._gravity,
                0.5 * turning, self._inverse_inertia @ torque,
            ]
        )

    def step(
        self, state: Array, speeds: Array, time_step: float, wind: Array = CALM,
        integrate: Callable[[Derivative, Array, float], Array] = euler,
    ) -> Array:
        """Return the state (13,) after one step, with a unit quaternion.

        Rotor speeds and wind are held during the step.  Raises a FloatingPointError if the vehicle
        tumbles so fast that the steps diverge.
        """
        with np.errstate(over='ignore', invalid='ignore'):
            after = integrate(lambda x: self.derivative(x, speeds, wind), state, time_step)
            after[ATTITUDE] /= hypot(*after[ATTITUDE].tolist())
        if not (abs(after) < STATE_MAX).all():
            raise FloatingPointError(f'the vehicle tumbles: steps of {time_step:g} s diverge')
        return after


def velocity_in_body(state: Array) -> Array:
    """Return the velocity (3,) of a state (13,) in the body frame [m/s]."""
    return state[VELOCITY] @ rotation_matrix(state[ATTITUDE])
