"""What answers wrenches in an allocator node: a method on the rotors of a vehicle."""

from typing import Any

import numpy as np

from ca_ros.allocation import Allocation, Allocator
from ca_ros.allocation.rates import WithinRates
from ca_ros.allocation.settings import allocator_of
from ca_ros.arrays import Array, IntArray
from ca_ros.nodes.watchdog import fallback
from ca_ros.problem.audit import Audit
from ca_ros.problem.vehicle_problem import vehicle_problem
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.settings import AXES


class Rotors:
    """A method for the axes that the rotors of a vehicle can control.

    A command is the rotor speeds, and after them the tilt angles, if rotors tilt [rad/s, rad].

    - `method`: the allocator
    - `n`: number of rotors
    - `rows`: for each of its axes the component of the wrench (6,) that it is
    - `idle` (n + k,): the command of rotors that have not been commanded yet
    - `lost` (n,): which rotors are lost
    """

    label = 'rotor speed [rad/s]'

    def __init__(self, settings: Any, report: Audit) -> None:
        self.vehicle, self.n = report.vehicle, report.vehicle.n
        self.method: Allocator = allocator_of(settings.allocation, report)
        self.within_rates = WithinRates(self.method)
        self.rows = [AXES.index(axis) for axis in self.vehicle.axes]
        self.idle: Array = self.vehicle.idle_command
        self.lost: Any = self.vehicle.lost

    def at_rest(self, action: str, last: Array) -> Array:
        """Return the command of a timeout action after the last one.

        The action hold keeps the last speeds within the bounds that health and voltage leave.
        """
        speeds, angles = np.split(last, [self.n])
        low, high = self.vehicle.speed_limits
        speeds = np.minimum(np.maximum(speeds, np.minimum(low, 0.0)), high)
        held = np.concatenate([speeds, self.vehicle.servos.within(angles)])
        return fallback(action, self.vehicle, held)

    def produced(self, answer: Allocation) -> Array:
        """Return force and torque (6,) of an answer [N, N m]."""
        # With rates, the directions of vectors are those of this answer.
        return vehicle_problem(answer.problem).wrenches @ answer.thrusts

    def held(self, command: Array) -> tuple[Array, IntArray]:
        """Return force and torque (6,) of a command [N, N m], and which rotors are at a bound."""
        speeds, angles = np.split(command, [self.n])
        wrench = rotor_wrenches(self.vehicle, angles) @ self.vehicle.thrusts(speeds)
        return wrench, at_bounds(speeds, *self.vehicle.speed_limits)


def at_bounds(values: Array, low: Array, high: Array) -> IntArray:
    """Return -1 where values (n,) are at their lower bounds, +1 at their upper, else 0."""
    return (values >= high).astype(np.int8) - (values <= low).astype(np.int8)
