"""The allocation problem of a vehicle: its thrusts, the wrench that they give, and hover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from math import atan2, cos, hypot, pi, sin
from typing import TypeVar

import numpy as np

from ca_ros.arrays import Array, IntArray
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vectored import VectoredProblem, component_names
from ca_ros.solver.convex_sets import ConvexSet, ConvexSets, Interval, Sector
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.servos import FIXED
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle

Part = TypeVar('Part', bound='VehicleProblem')


class VehicleProblem(AllocationProblem):
    """Find thrusts f with u = Gamma f and f_min <= f <= f_max (Problem 1, Eqs. (8) and (10)).

    A problem needs no audit: it may also be made of a vehicle that allocators refuse because it
    cannot control every axis or hover.

    `vehicle`: with its `axes` and the bounds of its thrusts.  The reference is hover.
    """

    effector_kind = 'rotors'
    unit = ' N'
    advice = ' (see ca_ros.audit)'

    def __new__(cls, vehicle: Vehicle | None = None, *_: object) -> VehicleProblem:
        """Make a `TiltingVehicleProblem` of a vehicle with rotors that tilt."""
        tilts = vehicle is not None and len(vehicle.servos)
        made: VehicleProblem = object.__new__(TiltingVehicleProblem if tilts else cls)
        return made

    def __init__(self, vehicle: Vehicle) -> None:
        # A vehicle has sound numbers, in SI units.
        self.vehicle, self.axes = vehicle, vehicle.axes
        self.effector_names = tuple(str(i + 1) for i in range(vehicle.n))
        gamma = control_allocation_matrix(vehicle)
        self._fill(gamma, vehicle.thrust_min, vehicle.thrust_max, self._weight())

    def _weight(self) -> Array:
        """Return the wrench (m,) of hover [N, N m]."""
        return np.array([self.vehicle.weight * (axis == 'thrust') for axis in self.axes])

    def part(self: Part, axes: Sequence[str]) -> Part:
        """Return the problem of some of its axes, with a vehicle that has these alone."""
        made = super().part(axes)
        made.vehicle = replace(self.vehicle, axes=made.axes)
        return made

    @property
    def hover(self) -> Array:
        """The wrench (m,) that carries the vehicle's weight, without torque [N, N m]."""
        return self.reference

    @property
    def impaired(self) -> IntArray:
        """1 for each rotor (n,) whose upper bound is lowered by its health, else 0."""
        return (self.vehicle.health < 1.0).astype(np.int32)

    @property
    def hovers(self) -> bool:
        """Whether hover is inside the admissible set, not on its boundary."""
        return self.reference_inside


class TiltingVehicleProblem(VectoredProblem, VehicleProblem):
    """Find the thrust vectors of rotors that tilt, and with them thrusts and servo angles.

    The components of a vector are its thrust along the middle of its tilt range and across.  From
    a least thrust above zero on, the vectors of a rotor are not a convex set.  Instead, the
    component along the middle is at least the least thrust: at the angle a from the middle, the
    least thrust is 1 / cos a as great.

    `vehicle`: with `servos`.

    `wrenches` (6, n): force and torque per unit of each component [N/N, N m/N].  `wanted` (n, 3):
    directions of rotors without thrust; None: the middles of their sets.  `near` (k,): of
    equivalent servo angles, those nearest to these count [rad].
    """

    wanted: Array | None = None
    near: Array | None = None

    def __init__(
        self, vehicle: Vehicle, windows: Sequence[tuple[ConvexSet, Array]] | None = None,
    ) -> None:
        self.vehicle, self.axes = vehicle, vehicle.axes
        self.windows = list(thrust_sets(vehicle) if windows is None else windows)
        self.sets = ConvexSets([each for each, _ in self.windows])
        names = [str(i + 1) for i in range(vehicle.n)]
        self.effector_names = tuple(component_names(names, self.sets.sets))
        owners = [i for i, (each, _) in enumerate(self.windows) for _ in range(each.size)]
        self.directions = np.concatenate([rows for _, rows in self.windows])
        self.wrenches = vehicle.thrust_wrenches(owners, self.directions)
        gamma = self.wrenches[[AXES.index(axis) for axis in vehicle.axes]]
        self._fill(gamma, self.sets.lower, self.sets.upper, self._weight())

    @property
    def facet_choices(self) -> int:
        """There are no facets; a number above all limits, since their work would be great."""
        return 10**9

    def sizes(self, thrusts: Array) -> Array:
        """Return the thrust (..., n) of each rotor, within its bounds."""
        sizes = super().sizes(thrusts)
        return np.minimum(np.maximum(sizes, self.vehicle.thrust_min), self.vehicle.thrust_max)

    def forces(self, thrusts: Array) -> Array:
        """Return the force (n, 3) of each rotor in the body frame for components (n,) [N]."""
        return np.add.reduceat(thrusts[:, None] * self.directions, self.sets.first)

    def angles(self, thrusts: Array) -> Array:
        """Return the servo angles (k,) for components (n,) within their limits [rad].

        A rotor without thrust points to the direction in its set that is nearest to `wanted`.
        """
        forces = self.forces(thrusts)
        idle = np.einsum('ij,ij->i', forces, forces) <= self._idle
        if idle.any():
            for i in np.flatnonzero(idle).tolist():
                forces[i] = self._nearest(i)
        return self.vehicle.servos.angles(forces, self.near)

    @cached_property
    def _idle(self) -> Array:
        """The squares (n,) of the thrusts below which a rotor's has no direction [N^2]."""
        return np.square(IDLE * np.maximum(1.0, self.vehicle.thrust_max))

    def _nearest(self, rotor: int) -> Array:
        """Return the direction in a rotor's set that is nearest to the wanted one."""
        each, rows = self.windows[rotor]
        if self.wanted is None or each.size == 1 or not self.wanted[rotor].any():
            return rows[0]
        assert isinstance(each, Sector)
        along, *rest = (rows @ self.wanted[rotor]).tolist()
        across = hypot(*rest)
        angle = min(atan2(across, along), each.half_angle)
        side = np.array(rest) / across if across > 0.0 else np.zeros(len(rest))
        return np.asarray(cos(angle) * rows[0] + sin(angle) * (side @ rows[1:]), float)


IDLE = 1e-12  # thrust, as a share of the greatest, below which it has no direction


def thrust_sets(vehicle: Vehicle) -> list[tuple[ConvexSet, Array]]:
    """Return the set of each rotor's thrust vectors, and the directions of its components."""
    servos, found = vehicle.servos, list[tuple[ConvexSet, Array]]()
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
    return found


def problem_of(problem: Vehicle | AllocationProblem) -> AllocationProblem:
    """Return the problem of a vehicle, not audited, or the problem itself.

    Raises a TypeError if the argument is neither.
    """
    if isinstance(problem, Vehicle):
        return VehicleProblem(problem)
    if isinstance(problem, AllocationProblem):
        return problem
    raise TypeError(f'expected a Vehicle or an AllocationProblem, got {problem!r}')


def vehicle_of(problem: AllocationProblem) -> Vehicle:
    """Return the vehicle of a problem; raise a TypeError if it has none."""
    if isinstance(problem, VehicleProblem):
        return problem.vehicle
    raise TypeError('this problem has no vehicle: its effectors have no rotor speeds')
