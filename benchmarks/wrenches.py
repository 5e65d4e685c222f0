"""The commands of a flight, and vehicles with other numbers of rotors."""

from itertools import cycle
from typing import Any

import numpy as np

from ca_ros.allocation import make_allocator
from ca_ros.arrays import Array
from ca_ros.control.controller import Controller
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.control.waypoint import Waypoint
from ca_ros.parameter_files import load
from ca_ros.settings import flat
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.vehicle import geometry
from ca_ros.vehicle.settings import AXES, RingSettings
from ca_ros.vehicle.state import NULL_STATE, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

WAYPOINTS = (
    Waypoint.of(1.0, 1.0, 1.0, np.pi / 4.0), Waypoint.of(15.0, -10.0, 6.0, -2.0 * np.pi / 3.0),
    Waypoint.of(-20.0, 15.0, -10.0, np.pi / 3.0), Waypoint.of(20.0, -15.0, 10.0, -np.pi / 2.0),
)
"""The paper's waypoint, and three far away, of the flight of `flown`."""

TIME_STEP = 0.01  # time between two wrenches of `flown` [s]
LEG = 250  # wrenches on the way to a waypoint; fewer if a flight has too few for all waypoints


def flown(vehicle: Vehicle, gains: ControllerSettings, size: int) -> Array:
    """Return the commands (size, m) of a flight to `WAYPOINTS` in turn [N, N m]."""
    allocator, body = make_allocator('exact', vehicle), RigidBody(vehicle)
    controller, state, wrenches = Controller(vehicle, gains), NULL_STATE, []
    legs = max(size // LEG, len(WAYPOINTS))
    ends = np.linspace(0, size, legs + 1).astype(int)
    for waypoint, steps in zip(cycle(WAYPOINTS), np.diff(ends), strict=False):
        goal = waypoint, steps * TIME_STEP, TIME_STEP
        flight = fly(controller, allocator, body, *goal, state)
        states = flight.position, flight.attitude, flight.velocity, flight.angular_velocity
        samples = zip(*states, strict=True)
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
    for name in ('rotors.thrust_coefficient', 'rotors.torque_coefficient'):
        parameters[name] *= len(parameters['rotors.spins']) / n
    del parameters['rotors.positions']
    parameters |= {'rotors.ring.count': n, 'rotors.ring.radius': radius}
    parameters['rotors.spins'] = ['cw', 'ccw'] * (n // 2)
    # The file's weight is for six rotors; the exact allocator does not use it.
    parameters['allocation.conventional.weight'] = 1e-4
    if tilt:
        x, y, _ = geometry.ring(RingSettings(count=n, radius=1.0)).T
        aside = np.sin(tilt * (-1.0) ** np.arange(n))
        axes = np.column_stack([-aside * y, aside * x, np.full(n, np.cos(tilt))])
        parameters |= {'rotors.axes': axes.ravel().tolist(), 'allocation.axes': list(AXES)}
    return parameters
