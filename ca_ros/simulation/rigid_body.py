"""Rigid-body dynamics of a multirotor.  Frames and state: `ca_ros.vehicle.state`."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import numpy as np

from ca_ros.arrays import Array
from ca_ros.simulation.drag import Drag
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.state import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    STATE_MAX,
    VELOCITY,
    cross,
    rotation_matrix,
)
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

Derivative = Callable[[Array], Array]
Integrator = Callable[[Derivative, Array, float], Array]


def euler(derivative: Derivative, state: Array, step: float) -> Array:
    """Return the state after an explicit Euler step, of order 1."""
    return state + step * derivative(state)


CALM: Array = np.zeros(3)  # no wind [m/s]


class RigidBody:
    """The vehicle's equations of motion for given rotor speeds and wind.

    Raises a ParameterError if the vehicle has no inertia.

    `vehicle`: with the actual health of the rotors.  `drag`: the drag of the air; None: no drag.
    """

    def __init__(self, vehicle: Vehicle, drag: Drag | None = None) -> None:
        self.vehicle = vehicle
        self.drag = drag
        self._inertia = inertia_of(vehicle)
        self._inverse_inertia = np.linalg.inv(self._inertia)
        # The buoyancy acts at the centre of mass.
        self._gravity = np.array([0.0, 0.0, vehicle.gravity - vehicle.buoyancy / vehicle.mass])

    def __repr__(self) -> str:
        """Return the vehicle in one line, and whether there is drag."""
        air = '' if self.drag is None else ', with drag'
        return f'{type(self).__name__}: {self.vehicle.described}{air}'

    def with_vehicle(self, vehicle: Vehicle) -> RigidBody:
        """Return the body of another vehicle in the same air."""
        return RigidBody(vehicle, self.drag)

    def derivative(self, state: Array, speeds: Array, wind: Array = CALM) -> Array:
        """Return the rate of change (13,) of a state (13,).

        - `state` (13,)
        - `speeds` (n,): rotor speeds [rad/s]; of a vehicle whose rotors tilt, the servo angles
          [rad] follow
        - `wind` (3,): in the world frame [m/s]; it acts through the drag
        """
        vehicle = self.vehicle
        speeds, angles = speeds[: vehicle.n], speeds[vehicle.n :]
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
        integrate: Integrator = euler,
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
