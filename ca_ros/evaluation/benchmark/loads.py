"""The loads of a benchmark: the wrenches that are allocated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from ca_ros.allocation import make_allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.sampling import gauge
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller
from ca_ros.flight.gains import Gains
from ca_ros.flight.rigid_body import NULL_STATE, RigidBody, rotation_matrix
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.parameters import load
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem, vehicle_of
from ca_ros.vehicle.parameters import AXES
from ca_ros.vehicle.vehicle import Vehicle

DEPTHS = (1e-3, 1e-6, 1e-9)
"""Distances of wrenches from the boundary, relative to the distance from the centre."""

WAYPOINTS = (
    Waypoint.of(1.0, 1.0, 1.0, np.pi / 4.0),
    Waypoint.of(15.0, -10.0, 6.0, -2.0 * np.pi / 3.0),
    Waypoint.of(-20.0, 15.0, -10.0, np.pi / 3.0),
    Waypoint.of(20.0, -15.0, 10.0, -np.pi / 2.0),
)
"""The paper's waypoint, and three far away."""

TIME_STEP = 0.01
"""Time between two wrenches of a flight [s]."""

LEG = 250
"""Wrenches on the way to a waypoint; fewer if a flight has too few for all waypoints."""

TILT = np.radians(25.0)
"""Tilt of rotors about their arms, alternately left and right, as of hexarotor_tilted [rad]."""

PAPER = 6
"""Number of rotors of the paper's vehicle."""


def boundary(admissible: AdmissibleSet, rng: np.random.Generator, size: int) -> Array:
    """Draw wrenches (size, m) inside, on and outside the boundary, in turn [N, N m]."""
    center = admissible.center
    offsets = admissible.sample(rng, size) - center
    offsets /= gauge(admissible, center + offsets)[:, None]
    side = np.arange(size) % 3 - 1
    return center + offsets * (1.0 + side * rng.choice(DEPTHS, size))[:, None]


def flight(vehicle: Vehicle, gains: Gains, size: int) -> Array:
    """Return the wrenches (size, m) of a flight to `WAYPOINTS` in turn [N, N m]."""
    allocator, body = make_allocator('exact', vehicle), RigidBody(vehicle)
    controller, state, wrenches = Controller(vehicle, gains), NULL_STATE, []
    legs = max(size // LEG, len(WAYPOINTS))
    ends = np.linspace(0, size, legs + 1).astype(int)
    for waypoint, steps in zip(cycle(WAYPOINTS), np.diff(ends), strict=False):
        goal = waypoint, steps * TIME_STEP, TIME_STEP
        flown = fly(controller, allocator, body, *goal, state)
        samples = zip(
            flown.position, flown.attitude, flown.velocity, flown.angular_velocity, strict=True
        )
        # The last sample of a leg is the first of the next.
        *earlier, (position, attitude, velocity, rates) = samples
        wrenches += [controller.wrench(*each, waypoint) for each in earlier]
        state = np.concatenate([position, rotation_matrix(attitude) @ velocity, attitude, rates])
    return np.array(wrenches).reshape(size, len(vehicle.axes))


class Load(NamedTuple):
    """A load: what it is, and the function that draws it; see `drawn`."""

    about: str
    draw: Callable[[AdmissibleSet, Gains, np.random.Generator, Plan], Array]


LOADS = {
    'uniform': Load(
        'uniform by volume in the admissible set',
        lambda admissible, gains, rng, plan: admissible.sample(rng, plan.wrenches),
    ),
    'boundary': Load(
        'where random rays from the centre of the admissible set leave it: a third of the '
        'wrenches on the boundary, to rounding, a third inside and a third outside, by 1e-3, 1e-6 '
        'or 1e-9 of the distance from the centre',
        lambda admissible, gains, rng, plan: boundary(admissible, rng, plan.wrenches),
    ),
    'flight': Load(
        'the successive commands of the controller in a flight to four waypoints in turn, three '
        'of which are so far away that rotors saturate',
        lambda admissible, gains, rng, plan: flight(
            vehicle_of(admissible.problem), gains, plan.flight
        ),
    ),
}
"""The loads by name."""


def drawn(
    parameters: Mapping[str, Any], problem: AllocationProblem, plan: Plan, seed: int
) -> dict[str, Array]:
    """Return the wrenches (W, m) of each load for a vehicle and its gains [N, N m].

    A problem without a vehicle has no load ``flight``.
    """
    admissible, gains = AdmissibleSet(problem), Gains.from_parameters(parameters)
    return {
        name: load.draw(admissible, gains, np.random.default_rng(seed), plan)
        for name, load in LOADS.items()
        if name != 'flight' or isinstance(problem, VehicleProblem)
    }


def ring(n: int) -> dict[str, Any]:
    """Return the parameters of the paper's hexarotor with n rotors on its circle.

    All n together give the same thrust as the six, so the admissible sets are similar.
    """
    parameters: dict[str, Any] = dict(load('hexarotor'))
    radius = float(np.linalg.norm(parameters['rotors.positions'][:2]))
    angles = 2.0 * np.pi * np.arange(n) / n
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
    parameters['rotors.positions'] = circle.ravel().tolist()
    parameters['rotors.spins'] = ['cw', 'ccw'] * (n // 2)
    for name in ('rotors.thrust_coefficient', 'rotors.torque_coefficient'):
        parameters[name] *= PAPER / n
    # The file's weight is for six rotors; the exact allocator does not use it.
    parameters['allocation.conventional.weight'] = 1e-4
    return parameters


def tilted_ring(n: int) -> dict[str, Any]:
    """Return the parameters of `ring` with tilted rotors, which command all six axes."""
    angles, tilts = 2.0 * np.pi * np.arange(n) / n, TILT * (-1.0) ** np.arange(n)
    sides = np.sin(tilts)
    axes = np.column_stack([-sides * np.sin(angles), sides * np.cos(angles), np.cos(tilts)])
    changes = {'rotors.axes': axes.ravel().tolist(), 'allocation.axes': list(AXES)}
    return ring(n) | changes
