"""Position and attitude control: from state and waypoint to an admissible wrench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import atan2, cos, hypot, sin, tan
from typing import Any

import numpy as np

from ca_ros.allocation.options import order_from_parameters
from ca_ros.allocation.parameters import PRIORITIES
from ca_ros.arrays import Array
from ca_ros.flight.parameters import CONTROLLER
from ca_ros.flight.rigid_body import cross, difference, heading, rotation_matrix
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.prioritization import REVERSAL
from ca_ros.problem.problem import AllocationProblem
from ca_ros.schema import ParameterError, complete
from ca_ros.vehicle.parameters import AXES
from ca_ros.vehicle.vehicle import Vehicle

LIFT_MIN = 0.3
"""Share of the weight that is always held up, lest the vehicle turn over to descend faster."""

HEADING_ERROR_MAX = 0.5
"""Greatest heading error that the controller acts on [rad]: a half turn asks for no more."""


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
        p: dict[str, Any] = complete(given, CONTROLLER)
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
        """Heading of the attitude [rad], see `ca_ros.flight.rigid_body.heading`."""
        return float(heading(self.attitude))


class Controller:
    """Inverse dynamics with PD actions, saturated into the admissible set (Section 4).

    PD in the position error, with the speed of the approach limited, gives the wanted force.  PD
    in the attitude error gives the torque.  The attitude error has two parts: the rotation that
    takes the body's z axis to the direction of the wanted force by the shortest way (the reduced
    attitude, about x and y), and the error of the heading (about z), limited to
    `HEADING_ERROR_MAX`.  So the tilt does not depend on the heading, and is controlled in the same
    way while the vehicle spins.

    A wrench that is not admissible is brought into the admissible set by priority.

    Parameters
    ----------
    vehicle : Vehicle
        With the rotors' health as far as it is known.
    gains : Gains
    order : sequence of groups of axes, optional
        Priorities, see `AdmissibleSet.prioritize`.
    reversal : 'prevent', 'avoid' or 'allow'
        See `AdmissibleSet.prioritize`.

    Raises
    ------
    ValueError
        If `order` does not name each of the vehicle's axes once, there is no such `reversal`, or
        the vehicle's admissible set has no volume.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        gains: Gains,
        order: Sequence[Sequence[str]] | None = None,
        reversal: str = REVERSAL,
    ) -> None:
        self.vehicle, self.gains, self.order, self.reversal = vehicle, gains, order, reversal
        self.problem = AllocationProblem(vehicle)
        self.admissible = None if vehicle.powerless else AdmissibleSet(self.problem)
        if self.admissible is not None:
            # A wrong order is an error now, not at the first wrench that needs it.
            self.admissible.check_order(order, reversal)
        self._rows = [AXES.index(axis) for axis in vehicle.axes]

    @classmethod
    def from_parameters(cls, vehicle: Vehicle, given: Mapping[str, Any]) -> Controller:
        """Make a vehicle's controller with the gains and the priorities of its parameters.

        Raises
        ------
        ParameterError
            If a parameter is wrong; it is named.
        """
        p: dict[str, Any] = complete(given, {**PRIORITIES, **CONTROLLER})
        return cls(
            vehicle,
            Gains.from_parameters(p),
            order_from_parameters(p, vehicle.axes),
            p['allocation.exact.reversal'],
        )

    def wrench(
        self,
        position: Array,
        attitude: Array,
        velocity: Array,
        angular_velocity: Array,
        waypoint: Waypoint,
    ) -> Array:
        """Return the wrench that leads to a waypoint: `demand`, prioritized.

        Parameters
        ----------
        position, attitude, velocity, angular_velocity, waypoint
            As in `demand`.

        Returns
        -------
        (m,) array
            In the admissible set [N, N m], one component for each of the vehicle's axes; zero if
            all rotors are lost.

        Raises
        ------
        ValueError
            As in `demand`.
        """
        demand = self.demand(position, attitude, velocity, angular_velocity, waypoint)
        if self.admissible is None:
            return np.zeros(len(demand))
        return self.admissible.prioritize(demand, self.order, self.reversal)

    def demand(
        self,
        position: Array,
        attitude: Array,
        velocity: Array,
        angular_velocity: Array,
        waypoint: Waypoint,
    ) -> Array:
        """Return the wrench that is wanted, before it is brought into the admissible set.

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
            One component for each of the vehicle's axes [N, N m].

        Raises
        ------
        ValueError
            If the state is not finite, its attitude is zero, or the demand is not finite or too
            large.
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
        # Very large numbers may end as infinities in the demand, which is then refused.
        with np.errstate(over='ignore', invalid='ignore'):
            rotation = rotation_matrix(attitude)
            force = self._force(position, rotation @ velocity, waypoint)
            off = difference(waypoint.heading, float(heading(attitude)))
            error = np.array(
                [
                    *_tilt_error(rotation, force),
                    min(max(off, -HEADING_ERROR_MAX), HEADING_ERROR_MAX),
                ]
            )
            inertia = self.vehicle.inertia
            turn_x, turn_y, spin = angular_velocity.tolist()
            acceleration = (
                self.gains.attitude_stiffness * error
                - self.gains.attitude_damping * angular_velocity
                # While the body spins about z, its x and y axes take the turns about them along.
                # Without this term a tilt would be led round with the spin.
                + np.array([spin * turn_y, -spin * turn_x, 0.0])
            )
            torque = inertia @ acceleration
            torque += cross(angular_velocity, inertia @ angular_velocity)
            wrench = np.concatenate([force @ rotation, torque])[self._rows]
        return self.problem.check(wrench)

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


def _tilt_error(rotation: Array, force: Array) -> tuple[float, float]:
    """Return the rotation vector about x and y that takes the body's z axis to a force [rad].

    Where the force is opposite to the z axis every axis is as good: x is taken.
    """
    x, y, z = (force @ rotation).tolist()
    sine = hypot(x, y)
    angle = atan2(sine, z)
    return (-y * angle / sine, x * angle / sine) if sine > 0.0 else (angle, 0.0)
