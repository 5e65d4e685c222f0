"""The closed loop without ROS: controller, allocator and plant, step by step."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.allocation.slew import PERIOD_MAX, allocate_next
from ca_ros.arrays import Array
from ca_ros.flight.controller import Controller
from ca_ros.flight.detection import Detection
from ca_ros.flight.plant import Plant
from ca_ros.flight.record import Flight, steps
from ca_ros.flight.rigid_body import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    POSITION,
    RigidBody,
    velocity_in_body,
)
from ca_ros.flight.settings import PlantSettings
from ca_ros.flight.waypoint import Waypoint


@dataclass(frozen=True, eq=False)
class Change:
    """The parts of a closed loop that are replaced at a time of flight.

    `time`: [ns].  `controller`, `allocator`, `body` and `waypoint`: the new parts; None for those
    that stay.
    """

    time: int
    controller: Controller | None = None
    allocator: Allocator | None = None
    body: RigidBody | None = None
    waypoint: Waypoint | None = None

    def controller_after(self, before: Controller) -> Controller:
        """Return the controller from then on; a new one continues the integral action."""
        if self.controller is None:
            return before
        self.controller.disturbances = before.disturbances
        return self.controller


def fly(
    controller: Controller, allocator: Allocator, body: RigidBody | Plant, waypoint: Waypoint,
    duration: float, time_step: float | None = None, state: Array | None = None,
    changes: Iterable[Change] = (), detection: Detection | None = None,
) -> Flight:
    """Fly to a waypoint; return one sample at each step up to the `duration` [s].

    The samples have the measured states and the commanded rotor speeds and tilt angles.  Raises a
    FloatingPointError if the flight diverges because the gains or the steps are too large, or a
    ValueError if a time step is given for a plant.

    - `body`: a plant is flown from its initial state, and stays as it is
    - `time_step`: of a rigid body [s], by default 0.01 s, rounded to whole nanoseconds as in the
      stamps of ROS.  A plant has its own
    - `state` (13,): initial state, see `ca_ros.flight.rigid_body`; by default at rest in the
      origin, or that of the plant
    - `changes`: each takes effect at the first sample at or after its time, of several at one time
      the last
    - `detection`: failures that it finds in a sample take effect at that sample
    """
    states: list[Array] = []
    velocities: list[Array] = []
    commands: list[Array] = []
    if isinstance(body, RigidBody):
        given = PlantSettings() if time_step is None else PlantSettings(time_step=time_step)
        body = Plant(body, given)
    elif time_step is not None:
        raise ValueError(f'time_step: the plant has its own, {body.time_step:g} s')
    plant = body.restarted(state)
    step_ns, time_step = plant.time_step_ns, plant.time_step
    pending = sorted(changes, key=lambda change: change.time)[::-1]
    for now in range(0, (steps(duration, time_step) + 1) * step_ns, step_ns):
        state, due = plant.measured, []
        while pending and pending[-1].time <= now:
            due.append(pending.pop())
        if detection and (parts := detection.observe(now, state)):
            due.append(Change(now, *parts))
        for change in due:
            controller = change.controller_after(controller)
            allocator = change.allocator or allocator
            plant.body = change.body or plant.body
            waypoint = change.waypoint or waypoint
        velocity = velocity_in_body(state)
        try:
            pose, omega = (state[POSITION], state[ATTITUDE]), state[ANGULAR_VELOCITY]
            wrench = controller.wrench(*pose, velocity, omega, waypoint, now)
        except ValueError as error:
            what = f'after {now / 1e9:g} s the flight diverges'
            raise FloatingPointError(f'{what}: {error}') from error
        last = commands[-1] if commands else plant.body.vehicle.idle_command
        # Before the first command the rotors have all the time that counts.
        before = now - step_ns if commands else now - round(1e9 * PERIOD_MAX)
        command = allocate_next(allocator, wrench, last, now, before).command
        if detection:
            detection.command(now, command)
        states.append(state)
        velocities.append(velocity)
        commands.append(command)
        plant.step(command)
    flown = np.array(states)
    nanoseconds = np.arange(len(flown)) * step_ns
    return Flight(
        nanoseconds / 1e9, flown[:, POSITION], flown[:, ATTITUDE], np.array(velocities),
        flown[:, ANGULAR_VELOCITY], *np.split(np.array(commands), [plant.body.vehicle.n], axis=1),
    )
