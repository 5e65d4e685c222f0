"""Position and attitude control: from state and waypoint to an admissible wrench."""

from __future__ import annotations

from math import atan2, hypot, tan
from typing import Any

import numpy as np

from ca_ros.allocation.exact import Exact
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.control.controller_settings import SIDEWAYS, ControllerSettings
from ca_ros.control.momentum_observer import RESTART, MomentumObserver
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.prioritization import PrioritiesSettings
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import ParameterError, table
from ca_ros.vehicle.settings import AXES, triple
from ca_ros.vehicle.state import cross, difference, heading, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

LIFT_MIN = 0.3  # least vertical force over the weight, lest it turns over to descend

UP = np.array([0.0, 0.0, 1.0])

HEADING_ERROR_MAX = 0.5  # limit [rad]: a half turn demands no more torque than this


class Controller:
    """Inverse dynamics with PD actions, saturated into the admissible set (Section 4).

    A PD action on the position error, with a limited speed of approach, gives the wanted force.  A
    PD action on the attitude error gives the torque.  The attitude error has two parts: the
    shortest rotation that takes the body's z axis to the direction of the wanted force (the
    reduced attitude, about x and y), and the heading error (about z), limited to
    `HEADING_ERROR_MAX`.  The tilt is therefore controlled independently of the heading, also while
    the vehicle spins.

    Wrenches that are not admissible are moved into the admissible set by priority, as `Exact`
    does with its policy prioritize.

    With integral action (`integral_gain`), the controller subtracts an estimate of the constant
    disturbances: see `ca_ros.control.momentum_observer`.  With the gains k_p and k_d of the
    position, the integral gain of the position error is then L k_p.  Raises a ValueError if the
    order does not name each of the vehicle's axes once, the vehicle's admissible set has no
    volume, or the vehicle has no inertia.

    `vehicle`: with the announced health of the rotors.  `priorities`: see
    `AdmissibleSet.prioritize`.

    After states have ceased for two seconds, the estimate starts again from zero.

    `unallocated` (m,): the last demand minus the wrench that was served of it [N, N m]; zero if it
    was attainable.  `answer`: what `Exact` answered to it; None if all rotors are lost.
    `disturbances`: the state of the integral action; None without one.  `rows`:
    for each axis its component of force and torque (6,).
    """

    def __init__(
        self, vehicle: Vehicle, settings: ControllerSettings,
        priorities: PrioritiesSettings | None = None,
    ) -> None:
        priorities = PrioritiesSettings() if priorities is None else priorities
        self.vehicle, self.settings, self.priorities = vehicle, settings, priorities
        self._inertia = inertia_of(vehicle)
        self.problem = VehicleProblem(vehicle)
        self._exact = None
        if not vehicle.powerless:
            given = {name: getattr(priorities, name) for name in table(PrioritiesSettings)}
            self._exact = Exact(self.problem, **given)
        self.answer: Allocation | None = None
        self.unallocated = np.zeros(len(vehicle.axes))
        self.rows = [AXES.index(axis) for axis in vehicle.axes]
        sideways = set(SIDEWAYS) <= set(vehicle.axes)
        self._pose = settings.attitude == 'pose' and sideways
        self._level = settings.attitude != 'tilt' and sideways
        gains = settings.position_stiffness, settings.position_damping
        self._position_stiffness, self._position_damping = map(triple, gains)
        gains = settings.attitude_stiffness, settings.attitude_damping
        self._attitude_stiffness, self._attitude_damping = map(triple, gains)
        self.disturbances = self._new_disturbances() if settings.integral_gain > 0.0 else None

    def _new_disturbances(self) -> MomentumObserver:
        return MomentumObserver(self.vehicle, self.settings.integral_gain)

    @classmethod
    def from_settings(
        cls, vehicle: Vehicle, settings: Any, before: Controller | None = None
    ) -> Controller:
        """Make the controller of a vehicle from the settings of a file or node.

        They have the groups `controller` and `allocation`.  In flight the controller continues the
        integral action of the one `before`.  Raises a ParameterError if settings contradict each
        other; they are named.
        """
        try:
            made = cls(vehicle, settings.controller, settings.allocation.exact)
            if before is not None:
                made.disturbances = before.disturbances
            return made
        except ParameterError as error:
            place = 'allocation.exact.' if str(error).startswith('order:') else ''
            raise ParameterError(f'{place}{error}') from None

    def restart(self) -> None:
        """Take the next state as one that does not continue those before."""
        if self.disturbances is not None:
            self.disturbances.interrupt()

    def wrench(
        self, position: Array, attitude: Array, velocity: Array, angular_velocity: Array,
        waypoint: Waypoint, time: int | None = None,
    ) -> Array:
        """Return the wrench (m,) that leads to a waypoint [N, N m]: `demand`, prioritized.

        It is in the admissible set; zero if all rotors are lost.  `time`, that of the state [ns],
        is needed for integral action alone.
        """
        state = position, attitude, velocity, angular_velocity
        if self.disturbances is not None:
            if time is None:
                raise ValueError('time: missing; the integral action needs it')
            _check(*state)
            # As in `demand`.
            with np.errstate(over='ignore', invalid='ignore'):
                rotation = rotation_matrix(attitude)
                motion = np.concatenate([rotation @ velocity, angular_velocity])
                before = self.disturbances.time
                self.disturbances.observe(time, motion)
                after = self.disturbances.time
                if before is not None and after is not None and after - before >= RESTART:
                    # Others may have flown the vehicle, or carried it.
                    self.disturbances = self._new_disturbances()
                    self.disturbances.observe(time, motion)
        demand = self.demand(*state, waypoint)
        served = np.zeros(len(demand))
        if self._exact is not None:
            self.answer = answer = self._exact.allocate(demand)
            served = demand if answer.status is Status.EXACT else answer.wrench
        self.unallocated = demand - served
        if self.disturbances is not None:
            full = np.zeros(len(AXES))
            full[self.rows] = served
            full[:3] = rotation @ full[:3]
            self.disturbances.expect(full, angular_velocity)
        return served

    def demand(
        self, position: Array, attitude: Array, velocity: Array, angular_velocity: Array,
        waypoint: Waypoint,
    ) -> Array:
        """Return the wanted wrench (m,), admissible or not [N, N m].

        Raises a ValueError if the state is not finite, its attitude is zero, or the demand is not
        finite or too large.

        - `position` (3,): in the world frame [m]
        - `attitude` (4,): quaternion x, y, z, w, body to world
        - `velocity` and `angular_velocity` (3,): in the body frame [m/s, rad/s]
        """
        _check(position, attitude, velocity, angular_velocity)
        # Very large numbers may end as infinities in the demand, which is then refused.
        with np.errstate(over='ignore', invalid='ignore'):
            rotation = rotation_matrix(attitude)
            force = self._force(position, rotation @ velocity, waypoint)
            off = difference(waypoint.heading, float(heading(attitude)))
            error = np.array(
                [
                    *_tilt_error(rotation, UP if self._level else force),
                    min(max(off, -HEADING_ERROR_MAX), HEADING_ERROR_MAX),
                ]
            )
            turn_x, turn_y, spin = angular_velocity.tolist()
            if self._pose:
                error, spin = turn_to(rotation, rotation_matrix(waypoint.attitude)), 0.0
            acceleration = (
                self._attitude_stiffness * error
                - self._attitude_damping * angular_velocity
                # The x and y axes rotate with a body that spins about z.  Without this term, the
                # direction of a tilt would rotate with the spin.
                + np.array([spin * turn_y, -spin * turn_x, 0.0])
            )
            torque = self._inertia @ acceleration
            torque += cross(angular_velocity, self._inertia @ angular_velocity)
            if self.disturbances is not None:
                torque -= self.disturbances.estimate[3:]
            wrench = np.concatenate([force @ rotation, torque])[self.rows]
        return self.problem.check(wrench)

    def _force(self, position: Array, velocity: Array, waypoint: Waypoint) -> Array:
        """Return the wanted force in the world frame [N]."""
        ratio = self._position_stiffness / self._position_damping
        approach = ratio * (waypoint.position - position)
        speed_max = self.settings.speed_max
        approach = np.minimum(np.maximum(approach, -speed_max), speed_max)
        force = self.vehicle.mass * self._position_damping * (approach - velocity)
        force[2] += self.vehicle.weight
        if self.disturbances is not None:
            force -= self.disturbances.estimate[:3]
        if self._level:
            return force
        force[2] = max(force[2], LIFT_MIN * self.vehicle.weight)
        sideways, allowed = hypot(*force[:2].tolist()), tan(self.settings.tilt_max) * force[2]
        if sideways > allowed:
            force[:2] *= allowed / sideways
        return force


def turn_to(rotation: Array, goal: Array) -> Array:
    """Return the shortest rotation (3,) in the body frame from one attitude (3, 3) to another.

    It is limited to `HEADING_ERROR_MAX` [rad].
    """
    turn = rotation.T @ goal
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = 0.5 * float(np.linalg.norm(axis)), 0.5 * (float(np.trace(turn)) - 1.0)
    angle = atan2(sine, cosine)
    if sine < 1e-9:
        # No turn, or half a turn, about any axis that it keeps.
        axis = np.array([1.0, 0.0, 0.0]) if cosine > 0.0 else np.diag(turn) + 1.0
    size: Array = axis / np.linalg.norm(axis)
    return min(angle, HEADING_ERROR_MAX) * size


def _check(position: Array, attitude: Array, velocity: Array, angular_velocity: Array) -> None:
    """Raise a ValueError that names the part of a state that is wrong."""
    state = (position, attitude, velocity, angular_velocity)
    if not np.isfinite(np.concatenate(state)).all():
        names = ('position', 'attitude', 'velocity', 'angular_velocity')
        for name, part in zip(names, state, strict=True):
            if not np.isfinite(part).all():
                raise ValueError(f'{name}: expected finite numbers, got {part}')
    if not attitude.any():
        raise ValueError('attitude: expected a quaternion, got zero')


def _tilt_error(rotation: Array, force: Array) -> tuple[float, float]:
    """Return the rotation about x and y that takes the body's z axis to a direction [rad].

    If the direction is opposite to the z axis, the rotation is about x.
    """
    x, y, z = (force @ rotation).tolist()
    sine = hypot(x, y)
    angle = atan2(sine, z)
    return (-y * angle / sine, x * angle / sine) if sine > 0.0 else (angle, 0.0)
