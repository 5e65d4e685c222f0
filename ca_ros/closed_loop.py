"""The closed loop without ROS: controller, allocator and rigid body, step by step."""

from __future__ import annotations

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.controller import Controller, Waypoint
from ca_ros.flight import Flight
from ca_ros.rigid_body import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    NULL_STATE,
    POSITION,
    RigidBody,
    velocity_in_body,
)


def fly(
    controller: Controller,
    allocator: Allocator,
    body: RigidBody,
    waypoint: Waypoint,
    duration: float,
    time_step: float = 0.01,
    state: Array = NULL_STATE,
) -> Flight:
    """Fly to a waypoint.

    Parameters
    ----------
    controller : Controller
    allocator : Allocator
    body : RigidBody
    waypoint : Waypoint
    duration, time_step : float
        [s]
    state : (13,) array
        Initial state, see `ca_ros.rigid_body`.

    Returns
    -------
    Flight
        One sample at each step, the one at `duration` included.
    """
    states, velocities, commands = [], [], []
    for _ in range(round(duration / time_step) + 1):
        velocity = velocity_in_body(state)
        wrench = controller.wrench(
            state[POSITION], state[ATTITUDE], velocity, state[ANGULAR_VELOCITY], waypoint
        )
        speeds = allocator.allocate(wrench).speeds
        states.append(state)
        velocities.append(velocity)
        commands.append(speeds)
        state = body.step(state, speeds, time_step)
    flown = np.array(states)
    nanoseconds = np.arange(len(flown)) * round(time_step * 1e9)
    return Flight(
        nanoseconds / 1e9,
        flown[:, POSITION],
        flown[:, ATTITUDE],
        np.array(velocities),
        flown[:, ANGULAR_VELOCITY],
        np.array(commands),
    )
