"""The allocation problem of a vehicle: its thrusts, the wrench that they give, and hover."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from math import atan2, cos, hypot, pi, sin
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, IntArray
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.convex_sets import Box, ConvexSet, ConvexSets, Interval, Sector
from ca_ros.vehicle.servos import FIXED
from ca_ros.vehicle.settings import AXES, unit
from ca_ros.vehicle.vehicle import Vehicle

Part = TypeVar('Part', bound='VehicleProblem')


class VehicleProblem(AllocationProblem):
    """Find thrusts f with u = Gamma f and f_min <= f <= f_max (Problem 1, Eqs. (8) and (10)).

    The thrust of a rotor that tilts is a vector, whose components are along the middle of its tilt
    range and across.  From a least thrust above zero on, such vectors are not a convex set.
    Instead, the component along the middle is at least the least thrust: at the angle a from the
    middle, the least thrust is 1 / cos a as great.

    A problem needs no audit: it may also be made of a vehicle that allocators refuse because it
    cannot control every axis or hover.

    - `vehicle`: with its `axes`, the bounds of its thrusts, and `servos`.  The reference is hover
    - `thrusts`: the sets of the thrusts, and the directions (n, 3) of their components; by default
      all that the vehicle can do
    - `turned` (k,): the servo angles now, if the sets are what is reached from there: the nearest
      of equivalent angles count, and rotors without thrust turn towards the direction in which
      thrust would cost least [rad]

    - `wrenches` (6, n): force and torque per unit of each component [N/N, N m/N]
    """

    effector_kind = 'rotors'
    unit = ' N'
    advice = ' (see ca_ros.audit)'
    kept_axes = ('thrust',)
    subject, aim = 'vehicle', 'hover'

    def __init__(
        self, vehicle: Vehicle, thrusts: tuple[Box | ConvexSets, Array] | None = None,
        turned: Array | None = None,
    ) -> None:
        # A vehicle has sound numbers, in SI units.
        self.vehicle, self.axes, self.turned = vehicle, vehicle.axes, turned
        self.axis_units = tuple(map(unit, self.axes))
        sets, self.directions = thrust_sets(vehicle) if thrusts is None else thrusts
        self.wrenches = vehicle.wrenches
        if self.directions is not vehicle.rotor_axes:
            self.wrenches = vehicle.thrust_wrenches(sets.owners, self.directions)
        gamma = self.wrenches[[AXES.index(axis) for axis in vehicle.axes]]
        hover = [vehicle.weight * (axis == 'thrust') for axis in vehicle.axes]
        self._fill(gamma, sets, np.array(hover))
        self._name([str(i + 1) for i in range(vehicle.n)])

    def part(self: Part, axes: Sequence[str]) -> Part:
        """Return the problem of some of its axes, with a vehicle that has these alone."""
        made = super().part(axes)
        made.vehicle = replace(self.vehicle, axes=made.axes)
        return made

    def dropping(self) -> VehicleProblem:
        """Return the problem with a vehicle whose `lost_axes` is 'drop'."""
        made = copy(self)
        made.vehicle = replace(self.vehicle, lost_axes='drop')
        return made

    @property
    def left_out(self) -> str:  # type: ignore[override]
        """What becomes of lost axes, if the vehicle drops them."""
        kept = 'fail and with_health of an allocator made before keep them'
        dropped = self.vehicle.lost_axes == 'drop'
        return f"; lost_axes='drop' leaves out lost axes, {kept}" if dropped else ''

    @property
    def hover(self) -> Array:
        """The wrench (m,) that carries the vehicle's weight, without torque [N, N m]."""
        return self.reference

    @property
    def health(self) -> Array:  # type: ignore[override]
        """The health (n,) of the rotors."""
        return self.vehicle.health

    @property
    def failed(self) -> bool:
        """Whether a rotor is lost or weak, an arm has failed, or a servo sticks."""
        vehicle = self.vehicle
        others = vehicle.failed_arms or vehicle.servos.unstuck is not None
        return bool(others or vehicle.health.min() < 1.0)

    @property
    def powerless(self) -> bool:
        """Whether all rotors are lost."""
        return self.vehicle.powerless

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> VehicleProblem:
        """Return the problem of the vehicle with other health; see `Vehicle.with_health`."""
        return VehicleProblem(self.vehicle.with_health(health, failed_arms, stuck))

    def with_matrix(self, matrix: ArrayLike) -> AllocationProblem:
        """Raise a TypeError: the matrix of a vehicle follows from its rotors."""
        raise TypeError(
            'with_matrix: the matrix of a vehicle follows from its rotors; an AllocationProblem '
            'has a matrix of its own'
        )

    @property
    def impaired(self) -> IntArray:
        """1 for each rotor (n,) whose upper bound is lowered by its health, else 0."""
        return (self.vehicle.health < 1.0).astype(np.int32)

    @property
    def rates(self) -> tuple[Array, Array] | None:
        """The greatest accelerations and decelerations (n,) of the rotors [rad/s^2], or None."""
        up, down = self.vehicle.acceleration_max, self.vehicle.deceleration_max
        return None if up is None else (up, up if down is None else down)

    @property
    def turning_rates(self) -> Array:
        """The greatest rates (k,) of the servos, zero where none is given [rad/s]."""
        servos = self.vehicle.servos
        return servos.rate_max[servos.rotors]

    @property
    def command_limits(self) -> tuple[Array, Array]:
        """The least and greatest speeds (n,) of the rotors [rad/s]."""
        return self.vehicle.speed_limits

    def commanded(self, commands: Array) -> Array:
        """Return the thrusts (..., n) that speeds (..., n) give [N]."""
        return self.vehicle.thrusts(commands)

    @property
    def shared(self) -> Array:
        """Thrusts (n,) that share the weight equally [N]."""
        return np.full(self.n, self.vehicle.weight / self.n)

    def forces(self, thrusts: Array) -> Array:
        """Return the force (n, 3) of each rotor in the body frame for components (n,) [N]."""
        return np.add.reduceat(thrusts[:, None] * self.directions, self.sets.first)

    def command(self, thrusts: Array) -> Array:
        """Return speeds (..., n) for components [N], and servo angles behind them (..., n + k)."""
        speeds = self.vehicle.speeds(self.sets.sizes(thrusts))
        return self.vehicle.servos.command(speeds, lambda: self.angles(thrusts))

    def angles(self, thrusts: Array) -> Array:
        """Return the servo angles (..., k) for components (..., n) within their limits [rad]."""
        if thrusts.ndim > 1:
            rows = [self.angles(row) for row in thrusts]
            return np.reshape(rows, (len(thrusts), len(self.vehicle.servos)))
        return self.vehicle.servos.angles(partial(self._pointed, thrusts), self.turned)

    def _pointed(self, thrusts: Array) -> Array:
        """Return forces (n, 3); of a rotor without thrust a direction in its set."""
        forces = self.forces(thrusts)
        idle = np.einsum('ij,ij->i', forces, forces) <= self._idle
        if idle.any():
            cheapest = np.zeros_like(forces)
            if self.turned is not None and self.interior.has_volume:
                slopes, _ = self.program.dual((thrusts @ self.gamma.T)[None])
                cheapest = self.forces(slopes[0] @ self.gamma)
            for i in np.flatnonzero(idle).tolist():
                forces[i] = self._nearest(i, cheapest[i])
        return forces

    @cached_property
    def _idle(self) -> Array:
        """The squares (n,) of the thrusts below which a rotor's has no direction [N^2]."""
        return np.square(IDLE * np.maximum(1.0, self.vehicle.thrust_max))

    def _nearest(self, rotor: int, cheapest: Array) -> Array:
        """Return the direction in a rotor's set that is nearest to the cheapest one (3,)."""
        each, first = self.sets.sets[rotor], self.sets.first[rotor]
        rows = self.directions[first : first + each.size]
        if each.size == 1 or not cheapest.any():
            return rows[0]
        assert isinstance(each, Sector)
        along, *rest = (rows @ cheapest).tolist()
        across = hypot(*rest)
        angle = min(atan2(across, along), each.half_angle)
        side = np.array(rest) / across if across > 0.0 else np.zeros(len(rest))
        return np.asarray(cos(angle) * rows[0] + sin(angle) * (side @ rows[1:]), float)


IDLE = 1e-12  # thrust, as a share of the greatest, below which it has no direction


def thrust_sets(vehicle: Vehicle) -> tuple[Box | ConvexSets, Array]:
    """Return the sets of the thrusts of a vehicle, and the directions (n, 3) of the components."""
    servos, found = vehicle.servos, list[tuple[ConvexSet, Array]]()
    if not len(servos):
        return Box(vehicle.thrust_min, vehicle.thrust_max), vehicle.rotor_axes
    middles, quarters = servos.middles
    limits = zip(vehicle.thrust_min.tolist(), vehicle.thrust_max.tolist(), strict=True)
    for i, (least, most) in enumerate(limits):
        span, cone = float(servos.upper[i] - servos.lower[i]), float(servos.gimbal[i])
        rows = np.array([middles[i], quarters[i], servos.axes[i]])
        if most <= 0.0 or (span <= FIXED and not cone):
            found.append((Interval(least, most), rows[:1]))
        elif cone:
            found.append((Sector(min(cone, pi / 2), most, 3, least), rows))
        else:
            half = pi if span > pi + FIXED else min(span / 2.0, pi / 2)
            found.append((Sector(half, most, 2, least), rows[:2]))
    return joined(vehicle, found)


def joined(
    vehicle: Vehicle, found: Sequence[tuple[ConvexSet, Array]]
) -> tuple[ConvexSets, Array]:
    """Return the product of sets of thrusts, and the directions of all their components."""
    limits = vehicle.thrust_min, vehicle.thrust_max
    return ConvexSets([each for each, _ in found], limits), np.concatenate(
        [rows for _, rows in found])


def problem_of(problem: Vehicle | AllocationProblem) -> AllocationProblem:
    """Return the problem of a vehicle, not audited, or the problem itself.

    Raises a TypeError if the argument is neither.
    """
    if isinstance(problem, Vehicle):
        return VehicleProblem(problem)
    if isinstance(problem, AllocationProblem):
        return problem
    hint, shown = '', ' '.join(repr(problem).split())
    if isinstance(problem, str):
        hint = f': Vehicle.load({problem!r}) reads a file'
    elif isinstance(problem, (np.ndarray, list)):
        hint = ': AllocationProblem(matrix, lower, upper) takes a matrix'
    elif isinstance(getattr(problem, 'problem', None), AllocationProblem):
        hint = ': an allocator has its audit and problem'
    raise TypeError(f'expected a Vehicle or an AllocationProblem, got {shown}{hint}')


def vehicle_problem(problem: AllocationProblem) -> VehicleProblem:
    """Return the problem of a vehicle itself; raise a TypeError if it is another one."""
    if isinstance(problem, VehicleProblem):
        return problem
    raise TypeError('this problem has no vehicle: its effectors have no rotor speeds')


def vehicle_of(problem: AllocationProblem) -> Vehicle:
    """Return the vehicle of a problem; raise a TypeError if it has none."""
    return vehicle_problem(problem).vehicle
