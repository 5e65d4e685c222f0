"""The ground: a plane on which the vehicle lands and stands."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import ANGULAR_VELOCITY, POSITION, VELOCITY


def stopped_by_ground(state: Array) -> Array:
    """Return a state (13,) after contact with the plane z = 0, where the ground is.

    The contact is an inelastic stop of the centre of mass with full friction: a vehicle that is
    below the plane, or on it and not rising, is put at rest on the plane, and its attitude stays.
    It leaves the plane as soon as the thrust exceeds the weight.
    """
    if state[POSITION][2] > 0.0 or (state[POSITION][2] == 0.0 and state[VELOCITY][2] > 0.0):
        return state
    stopped = np.array(state)
    stopped[POSITION][2] = 0.0
    stopped[VELOCITY] = stopped[ANGULAR_VELOCITY] = 0.0
    return stopped
