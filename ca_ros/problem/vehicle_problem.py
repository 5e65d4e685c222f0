"""The allocation problem of a vehicle: its thrusts, the wrench that they give, and hover."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.vehicle import Vehicle


class VehicleProblem(AllocationProblem):
    """Find thrusts f with u = Gamma f and f_min <= f <= f_max (Problem 1, Eqs. (8) and (10)).

    A problem needs no audit: it may also be made of a vehicle that allocators refuse because it
    cannot control every axis or hover.

    Parameters
    ----------
    vehicle : Vehicle
        With its `axes` and the bounds of its thrusts.  The reference is hover.

    Attributes
    ----------
    vehicle : Vehicle
    """

    effector_kind = 'rotors'
    unit = ' N'
    advice = ' (see ca_ros.audit)'

    def __init__(self, vehicle: Vehicle) -> None:
        # A vehicle has sound numbers, in SI units.
        self.vehicle, self.axes = vehicle, vehicle.axes
        self.effector_names = tuple(str(i + 1) for i in range(vehicle.n))
        self._fill(
            control_allocation_matrix(vehicle),
            vehicle.thrust_min,
            vehicle.thrust_max,
            np.array([vehicle.weight * (axis == 'thrust') for axis in vehicle.axes]),
        )

    @property
    def hover(self) -> Array:
        """The wrench (m,) that carries the vehicle's weight, without torque [N, N m]."""
        return self.reference

    @property
    def hovers(self) -> bool:
        """Whether hover is inside the admissible set, not on its boundary."""
        return self.reference_inside


def problem_of(problem: Vehicle | AllocationProblem) -> AllocationProblem:
    """Return the problem of a vehicle, not audited, or the problem itself.

    Raises
    ------
    TypeError
        If the argument is neither.
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
