"""Sets of wrenches: samples of the admissible set and around it, and the commands of a flight."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np

from ca_ros.allocation import make_allocator
from ca_ros.arrays import Array
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import NULL_STATE, RigidBody, rotation_matrix
from ca_ros.flight.settings import ControllerSettings
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.settings import load
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.settings import flat
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle

BLOCK = 1000
"""Samples are drawn in blocks, each with its own seed: sample i depends on seed and i alone."""

SAMPLINGS = {
    'volume': 'drawn uniformly by volume in the admissible set',
    'thrusts': 'given by thrusts that are drawn uniformly in their bounds',
    'boundary': 'drawn by volume and projected from the centre onto the boundary of the set',
    'outside': 'drawn by volume and moved away from the centre of the set, to between one and two '
    'times the distance of its boundary; none is attainable',
}

DEPTHS = (1e-3, 1e-6, 1e-9)
"""Distances from the boundary in `near_boundary`, relative to the distance from the centre."""

WAYPOINTS = (
    Waypoint.of(1.0, 1.0, 1.0, np.pi / 4.0),
    Waypoint.of(15.0, -10.0, 6.0, -2.0 * np.pi / 3.0),
    Waypoint.of(-20.0, 15.0, -10.0, np.pi / 3.0),
    Waypoint.of(20.0, -15.0, 10.0, -np.pi / 2.0),
)
"""The paper's waypoint, and three far away, of the flight of `flown`."""

TIME_STEP = 0.01
"""Time between two wrenches of `flown` [s]."""

LEG = 250
"""Wrenches on the way to a waypoint; fewer if a flight has too few for all waypoints."""


def gauge(admissible: AdmissibleSet, wrenches: Array) -> Array:
    """Return how far out wrenches (..., m) are: 0 at the centre, 1 on the boundary."""
    zonotope = admissible.zonotope
    heights = np.abs((wrenches - zonotope.center) @ zonotope.normals.T)
    return (heights / zonotope.widths).max(axis=-1)


def samples(admissible: AdmissibleSet, sampling: str, seed: int, start: int, stop: int) -> Array:
    """Return samples `start` to `stop`, excluding the last, (stop - start, m) [N, N m]."""
    first, end = start // BLOCK, -(-stop // BLOCK)
    rngs = [np.random.default_rng([seed, k]) for k in range(first, end)]
    blocks = np.concatenate([_block(admissible, sampling, rng) for rng in rngs])
    return blocks[start - first * BLOCK : stop - first * BLOCK]


def _block(admissible: AdmissibleSet, sampling: str, rng: np.random.Generator) -> Array:
    problem, center = admissible.problem, admissible.center
    if sampling == 'thrusts':
        return rng.uniform(problem.lower, problem.upper, (BLOCK, problem.n)) @ problem.gamma.T
    wrenches = admissible.sample(rng, BLOCK)
    if sampling in ('boundary', 'outside'):
        offsets = wrenches - center
        wrenches = center + offsets / gauge(admissible, center + offsets)[:, None]
        if sampling == 'outside':
            wrenches = center + (wrenches - center) * (2.0 - rng.random((BLOCK, 1)))
    return wrenches


def near_boundary(admissible: AdmissibleSet, rng: np.random.Generator, size: int) -> Array:
    """Draw wrenches (size, m) inside, on and outside the boundary, in turn [N, N m]."""
    center = admissible.center
    offsets = admissible.sample(rng, size) - center
    offsets /= gauge(admissible, center + offsets)[:, None]
    side = np.arange(size) % 3 - 1
    return center + offsets * (1.0 + side * rng.choice(DEPTHS, size))[:, None]


def flown(vehicle: Vehicle, gains: ControllerSettings, size: int) -> Array:
    """Return the commands (size, m) of a flight to `WAYPOINTS` in turn [N, N m]."""
    allocator, body = make_allocator('exact', vehicle), RigidBody(vehicle)
    controller, state, wrenches = Controller(vehicle, gains), NULL_STATE, []
    legs = max(size // LEG, len(WAYPOINTS))
    ends = np.linspace(0, size, legs + 1).astype(int)
    for waypoint, steps in zip(cycle(WAYPOINTS), np.diff(ends), strict=False):
        goal = waypoint, steps * TIME_STEP, TIME_STEP
        flight = fly(controller, allocator, body, *goal, state)
        samples = zip(
            flight.position, flight.attitude, flight.velocity, flight.angular_velocity, strict=True
        )
        # The last sample of a leg is the first of the next.
        *earlier, (position, attitude, velocity, rates) = samples
        wrenches += [controller.wrench(*each, waypoint) for each in earlier]
        state = np.concatenate([position, rotation_matrix(attitude) @ velocity, attitude, rates])
    return np.array(wrenches).reshape(size, len(vehicle.axes))


def ring(n: int, tilt: float = 0.0) -> dict[str, Any]:
    """Return the parameters of the paper's hexarotor with n rotors on its circle.

    All n together give the same thrust as the six, so the admissible sets are similar.  Rotors
    with a tilt about their arms, alternately left and right [rad], control all six axes.
    """
    parameters = flat(load('hexarotor'))
    radius = float(np.linalg.norm(parameters['rotors.positions'][:2]))
    angles = 2.0 * np.pi * np.arange(n) / n
    cos, sin, zero = np.cos(angles), np.sin(angles), np.zeros(n)
    circle = radius * np.column_stack([cos, sin, zero])
    for name in ('rotors.thrust_coefficient', 'rotors.torque_coefficient'):
        parameters[name] *= len(parameters['rotors.spins']) / n
    parameters['rotors.positions'] = circle.ravel().tolist()
    parameters['rotors.spins'] = ['cw', 'ccw'] * (n // 2)
    # The file's weight is for six rotors; the exact allocator does not use it.
    parameters['allocation.conventional.weight'] = 1e-4
    if tilt:
        aside = np.sin(tilt * (-1.0) ** np.arange(n))
        axes = np.column_stack([-aside * sin, aside * cos, zero + np.cos(tilt)])
        parameters |= {'rotors.axes': axes.ravel().tolist(), 'allocation.axes': list(AXES)}
    return parameters
