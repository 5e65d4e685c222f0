"""Position and attitude control: from state and waypoint to an admissible wrench."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import atan2, cos, hypot, sin, tan
from typing import Any

import numpy as np

from ca_ros.admissible_set import AdmissibleSet
from ca_ros.arrays import Array
from ca_ros.parameters import AXES, ParameterError, complete
from ca_ros.rigid_body import cross, rotation_matrix
from ca_ros.vehicle import Vehicle

LIFT_MIN = 0.3
"""Share of the weight that is always held up, lest the vehicle turn over to descend faster."""


@dataclass(frozen=True)
class Gains:
    """Gains and limits of the controller; arrays are (3,), along x, y, z."""

    position_stiffness: Array
    position_damping: Array
    attitude_stiffness: Array
    attitude_damping: Array
    speed_max: float
    tilt_max: float

    @classmethod
    def from_parameters(cls, given: Mapping[str, Any]) -> Gains:
        """Take them from parameters by name; raise a ParameterError that names a fault."""
        p: dict[str, Any] = complete(given)
        return cls(
            **{
                name: _three(f'controller.{name}', p[f'controller.{name}'])
                for name in (
                    'position_stiffness',
                    'position_damping',
                    'attitude_stiffness',
                    'attitude_damping',
                )
            },
            speed_max=p['controller.speed_max'],
            tilt_max=p['controller.tilt_max'],
        )


def _three(name: str, value: Any) -> Array:
    array = np.asarray(value, dtype=float)
    if array.size not in (1, 3):
        raise ParameterError(f'{name}: expected 1 or 3 numbers, got {array.size}')
    return np.broadcast_to(array, (3,)).copy()


@dataclass(frozen=True, eq=False)
class Waypoint:
    """Where to go: a position (3,) [m] and the heading of an attitude (x, y, z, w)."""

    position: Array
    attitude: Array

    @classmethod
    def of(cls, x: float, y: float, z: float, heading: float) -> Waypoint:
        """Return the waypoint at a position [m] with a heading [rad]."""
        return cls(
            np.array([x, y, z]), np.array([0.0, 0.0, sin(heading / 2.0), cos(heading / 2.0)])
        )

    @cached_property
    def heading(self) -> float:
        """Direction of the body's x axis seen from above [rad]."""
        forward = rotation_matrix(self.attitude)[:, 0]
        return atan2(forward[1], forward[0])


class Controller:
    """Inverse dynamics with PD actions, saturated into the admissible set (Section 4).

    The wanted acceleration is PD in the position error, with the speed of the approach limited; it
    gives the wanted force, whose direction and the heading give the wanted attitude; PD in the
    attitude error gives the torque.  Where the wrench is not admissible, it is made so by
    priority: roll and pitch, thrust, yaw.

    Parameters
    ----------
    vehicle : Vehicle
    gains : Gains
    """

    def __init__(self, vehicle: Vehicle, gains: Gains) -> None:
        self.vehicle, self.gains = vehicle, gains
        self.admissible = AdmissibleSet(vehicle)
        self._rows = [AXES.index(axis) for axis in vehicle.axes]

    def wrench(
        self,
        position: Array,
        attitude: Array,
        velocity: Array,
        angular_velocity: Array,
        waypoint: Waypoint,
    ) -> Array:
        """Return the wrench that leads to a waypoint.

        Parameters
        ----------
        position : (3,) array
            In the world frame [m].
        attitude : (4,) array
            Quaternion x, y, z, w, body to world.
        velocity, angular_velocity : (3,) arrays
            In the body frame [m/s, rad/s].
        waypoint : Waypoint

        Returns
        -------
        (m,) array
            In the admissible set [N, N m], one component for each of the vehicle's axes.

        Raises
        ------
        ValueError
            If the state is not finite, or so absurd that the demand is not.
        """
        state = {
            'position': position,
            'attitude': attitude,
            'velocity': velocity,
            'angular_velocity': angular_velocity,
        }
        if not np.isfinite(np.concatenate(list(state.values()))).all():
            name, part = next(item for item in state.items() if not np.isfinite(item[1]).all())
            raise ValueError(f'{name}: expected finite numbers, got {part}')
        if not attitude.any():
            raise ValueError('attitude: expected a quaternion, got zero')
        # Absurd numbers may end as infinities in the demand, which is then refused.
        with np.errstate(over='ignore', invalid='ignore'):
            rotation = rotation_matrix(attitude)
            force = self._force(position, rotation @ velocity, waypoint)
            wanted = _attitude(force, waypoint.heading)
            error = _rotation_vector(rotation.T @ wanted)
            inertia = self.vehicle.inertia
            torque = inertia @ (
                self.gains.attitude_stiffness * error
                - self.gains.attitude_damping * angular_velocity
            )
            torque += cross(angular_velocity, inertia @ angular_velocity)
            demand = np.concatenate([force @ rotation, torque])[self._rows]
        return self.admissible.prioritize(demand)

    def _force(self, position: Array, velocity: Array, waypoint: Waypoint) -> Array:
        """Return the wanted force in the world frame [N]."""
        gains = self.gains
        approach = (
            gains.position_stiffness / gains.position_damping * (waypoint.position - position)
        )
        approach = np.minimum(np.maximum(approach, -gains.speed_max), gains.speed_max)
        force = self.vehicle.mass * gains.position_damping * (approach - velocity)
        force[2] = max(force[2] + self.vehicle.weight, LIFT_MIN * self.vehicle.weight)
        sideways, allowed = hypot(*force[:2].tolist()), tan(gains.tilt_max) * force[2]
        if sideways > allowed:
            force[:2] *= allowed / sideways
        return force


def _attitude(force: Array, heading: float) -> Array:
    """Return the rotation matrix whose z axis is along a force and whose x axis has a heading."""
    up = force / hypot(*force.tolist())
    left = cross(up, np.array([cos(heading), sin(heading), 0.0]))
    left /= hypot(*left.tolist())
    return np.array([cross(left, up), left, up]).T


def _rotation_vector(rotation: Array) -> Array:
    """Return axis times angle of a rotation matrix; zero for half a turn, which has two axes."""
    r = rotation.tolist()
    vector = 0.5 * np.array([r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]])
    sine = hypot(*vector.tolist())
    angle = atan2(sine, 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0))
    return vector * (angle / sine) if sine > 0.0 else vector
