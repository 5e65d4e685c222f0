"""Manoeuvres that saturate the rotors, and a controller that does not limit its wrench."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
from scipy.spatial.transform import Rotation

from ca_ros.arrays import Array
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import ANGULAR_VELOCITY, ATTITUDE, NULL_STATE, VELOCITY
from ca_ros.flight.waypoint import Waypoint
from ca_ros.vehicle.vehicle import Vehicle

HEAVY = 1.35
"""Ratio of greatest thrust to weight of the heavy vehicles."""


def heavy(vehicle: Vehicle) -> float:
    """Return the mass of the heavy version of a vehicle [kg]."""
    return float(vehicle.thrust_max.sum()) / vehicle.gravity / HEAVY


def upset(
    tilt: float = 0.0,
    towards: float = 0.0,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Array:
    """Return a state: tilted [degrees] towards an azimuth [degrees], rotating and moving."""
    state = NULL_STATE.copy()
    axis = np.array([-sin(radians(towards)), cos(radians(towards)), 0.0])
    state[ATTITUDE] = Rotation.from_rotvec(radians(tilt) * axis).as_quat()
    state[ANGULAR_VELOCITY], state[VELOCITY] = turn, velocity
    return state


def goal(x: float, y: float, z: float, heading: float) -> Waypoint:
    """Return a waypoint at a position [m] with a heading [degrees]."""
    return Waypoint.of(x, y, z, radians(heading))


MANOEUVRES = {
    'upset, 150° forward': (upset(150.0, 0.0), goal(0.0, 0.0, 0.0, 60.0)),
    'upset, 150° to 45°': (upset(150.0, 45.0), goal(0.0, 0.0, 0.0, 60.0)),
    'upset, 150° to the left': (upset(150.0, 90.0), goal(0.0, 0.0, 0.0, 60.0)),
    'upset, 120°, and a turn': (upset(120.0, -45.0), goal(0.0, 0.0, 0.0, -120.0)),
    'spin about x': (upset(turn=(12.0, 0.0, 0.0)), goal(0.0, 0.0, 0.0, 0.0)),
    'spin about y and z': (upset(turn=(0.0, 10.0, -8.0)), goal(0.0, 0.0, 0.0, 0.0)),
    'spin about all axes': (upset(60.0, 45.0, (-9.0, 7.0, 10.0)), goal(0.0, 0.0, 0.0, 0.0)),
    'gust from the side': (upset(30.0, 0.0, (4.0, 4.0, 0.0), (12.0, -6.0, 0.0)), goal(0, 0, 0, 0)),
    'gust from above': (upset(40.0, 90.0, (6.0, -3.0, 4.0), (4.0, 4.0, -10.0)), goal(0, 0, 0, 0)),
    'dive with a turn': (NULL_STATE, goal(20.0, 0.0, -6.0, 143.0)),
    'climb with a turn': (NULL_STATE, goal(8.0, -6.0, 4.0, 170.0)),
    'turning back in a climb': (
        upset(turn=(0.0, 0.0, 8.0), velocity=(0.0, 0.0, 6.0)),
        goal(5.0, 5.0, -3.0, -170.0),
    ),
    'fast attitude commands': (upset(turn=(8.0, -8.0, 0.0)), goal(3.0, 0.0, 3.0, 90.0)),
}


class Unlimited(Controller):
    """The controller without the limit of its wrench."""

    wrench = Controller.demand


SLALOM = [
    (0.0, goal(1.5, 1.5, 0.0, 90.0)),
    (1.2, goal(3.0, -1.5, 1.0, -90.0)),
    (2.4, goal(4.5, 1.5, 0.0, 90.0)),
    (3.6, goal(6.0, -1.5, 1.0, -90.0)),
    (4.8, goal(7.5, 0.0, 0.0, 0.0)),
]
"""Times [s] and waypoints of a slalom; each waypoint is left before it is reached."""
