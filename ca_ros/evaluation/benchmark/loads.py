"""The wrenches that a benchmark has allocated: its loads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation import Allocation
from ca_ros.allocation.exact import Exact
from ca_ros.arrays import Array
from ca_ros.evaluation.sampling import gauge
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller, Gains
from ca_ros.flight.rigid_body import NULL_STATE, RigidBody, rotation_matrix
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.parameters import load
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.vehicle.vehicle import Vehicle

LOADS = {
    'uniform': 'uniform by volume in the admissible set',
    'boundary': 'where random rays from the centre of the admissible set leave it: a third of the '
    'wrenches on the boundary, to rounding, a third inside and a third outside, by 1e-3, 1e-6 or '
    '1e-9 of the distance from the centre',
    'flight': 'as the controller asks for them, one after the other, in a flight to four '
    'waypoints of which three are so far away that rotors saturate',
}
"""The loads, and what they are."""

DEPTHS = (1e-3, 1e-6, 1e-9)
"""Of wrenches near the boundary, relative to the distance from the centre."""

WAYPOINTS = (
    Waypoint.of(1.0, 1.0, 1.0, np.pi / 4.0),
    Waypoint.of(15.0, -10.0, 6.0, -2.0 * np.pi / 3.0),
    Waypoint.of(-20.0, 15.0, -10.0, np.pi / 3.0),
    Waypoint.of(20.0, -15.0, 10.0, -np.pi / 2.0),
)
"""The paper's, and three far away in turn."""

TIME_STEP = 0.01
"""Between two wrenches of a flight [s]."""

PAPER = 6
"""Rotors of the paper's vehicle."""


def boundary(admissible: AdmissibleSet, rng: np.random.Generator, size: int) -> Array:
    """Draw wrenches (size, m) on the boundary, inside and outside of it, in turn [N, N m]."""
    center = admissible.center
    offsets = admissible.sample(rng, size) - center
    offsets /= gauge(admissible, center + offsets)[:, None]
    side = np.arange(size) % 3 - 1
    return center + offsets * (1.0 + side * rng.choice(DEPTHS, size))[:, None]


def flight(vehicle: Vehicle, gains: Gains, size: int) -> Array:
    """Return the wrenches (size, m) of a flight to `WAYPOINTS`, as long to each [N, N m]."""
    allocator, body = _Recorder(vehicle), RigidBody(vehicle)
    controller, state = Controller(vehicle, gains), NULL_STATE
    ends = np.linspace(0, size, len(WAYPOINTS) + 1).astype(int)
    for waypoint, steps in zip(WAYPOINTS, np.diff(ends), strict=True):
        # The last sample of a leg is the first of the next.
        flown = fly(controller, allocator, body, waypoint, steps * TIME_STEP, TIME_STEP, state)
        allocator.wrenches.pop()
        velocity = rotation_matrix(flown.attitude[-1]) @ flown.velocity[-1]
        state = np.concatenate(
            [flown.position[-1], velocity, flown.attitude[-1], flown.angular_velocity[-1]]
        )
    return np.array(allocator.wrenches).reshape(size, len(vehicle.axes))


class _Recorder(Exact):
    """The exact allocator, with a record of the wrenches that it was asked for."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.wrenches: list[Array] = []

    def allocate(self, u: ArrayLike) -> Allocation:
        self.wrenches.append(np.array(u, dtype=float))
        return super().allocate(u)


def ring(n: int) -> dict[str, Any]:
    """Return the parameters of the paper's hexarotor with n rotors on its circle instead of six.

    All n together give the thrust that the six give, so the admissible sets are much alike.
    """
    parameters: dict[str, Any] = dict(load('hexarotor'))
    radius = float(np.linalg.norm(parameters['rotors.positions'][:2]))
    angles = 2.0 * np.pi * np.arange(n) / n
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
    parameters['rotors.positions'] = circle.ravel().tolist()
    parameters['rotors.spins'] = ['cw', 'ccw'] * (n // 2)
    for name in ('rotors.thrust_coefficient', 'rotors.torque_coefficient'):
        parameters[name] *= PAPER / n
    # The weight of the file is for six rotors; the exact allocator does not use it.
    parameters['allocation.conventional.weight'] = 1e-4
    return parameters
