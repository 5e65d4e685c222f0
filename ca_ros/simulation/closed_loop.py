"""The closed loop without ROS: controller, allocator, plant and detector, step by step."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ca_ros.allocation import Allocation, Allocator
from ca_ros.allocation.rates import PERIOD_MAX, WithinRates
from ca_ros.allocation.reconfiguration import Reconfiguration
from ca_ros.arrays import Array
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.acted_on import ActedOn, acted_on
from ca_ros.detection.kernel_detector import Detector
from ca_ros.settings import ParameterError
from ca_ros.simulation.plant import Plant
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.record import Flight, steps
from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, POSITION

Found = list[tuple[int, Array, ActedOn]]
"""The times [ns] at which the health changed, each with the new health (n,), and what of it is
acted on."""

Believed = Reconfiguration[tuple[Controller, Allocator]]

Reconfigure = Callable[..., Believed]
"""Takes controller and allocator that fly; returns what makes both for failures of the flight."""


@dataclass(frozen=True, eq=False)
class Change:
    """What changes at a time of flight.

    - `time`: [ns]
    - `body`, `waypoint`: the new ones; None for those that stay
    - `announced`: the health (n,) that is announced from then on, and the servos that stick: by
      rotor, from 1, the angle [rad]
    - `detected`: what of a detector's names is acted on from then on
    - `reconfigure`: what these two need
    """

    time: int
    body: RigidBody | None = None
    waypoint: Waypoint | None = None
    announced: tuple[Array, Mapping[int, float]] | None = None
    detected: ActedOn | None = None
    reconfigure: Reconfigure | None = None


def waypoint_changes(trajectory: Trajectory) -> list[Change]:
    """Return the changes of a closed loop that begins with the first waypoint."""
    pairs = zip(trajectory.times[1:], trajectory.waypoints[1:], strict=True)
    return [Change(time, waypoint=waypoint) for time, waypoint in pairs]


class Pilot:
    """The controller and the allocator of a flight, as they are in force."""

    def __init__(self, controller: Controller, allocator: Allocator | WithinRates) -> None:
        self._within = allocator if isinstance(allocator, WithinRates) else None
        self.controller = controller
        self.allocator = allocator.allocator if isinstance(allocator, WithinRates) else allocator
        self._believed: Believed | None = None

    def allocate(self, u: Array, last: Array, time: int, before: int) -> Allocation:
        """Allocate a wrench after the last command; see `WithinRates`."""
        if self._within is None or self._within.allocator is not self.allocator:
            self._within = WithinRates(self.allocator)
        return self._within.allocate(u, last, time, before)

    def take(self, change: Change) -> None:
        """Take what a change says of the rotors."""
        if change.reconfigure is None:
            return
        if self._believed is None:
            self._believed = change.reconfigure(self.controller, self.allocator)
        believed = self._believed
        if change.announced is not None:
            believed.report('announced', *change.announced)
        if change.detected is not None:
            believed.report('detector', change.detected.health, arms=change.detected.arms)
        if believed.fault:
            raise ParameterError(believed.fault)
        self.controller, self.allocator = believed.in_force.built


class Detection:
    """A detector in a closed loop; `found` has what it has found.

    `reconfigure`: see `Change`.
    """

    def __init__(self, detector: Detector, reconfigure: Reconfigure) -> None:
        self.detector, self._reconfigure = detector, reconfigure
        self._health = detector.vehicle.health
        self.found: Found = []

    def observe(self, time: int, state: Array, specific_force: Array | None) -> list[Change]:
        """Take a measured state (13,) at a time [ns]; return what failures change, if any.

        `specific_force` (3,): of an accelerometer, if there is one [m/s^2].
        """
        motion = velocity_in_body(state), state[ANGULAR_VELOCITY]
        if not self.detector.observe(time, state[ATTITUDE], *motion, specific_force):
            return []
        acted = acted_on(self.detector)
        self.found.append((time, self.detector.health, acted))
        return [Change(time, detected=acted, reconfigure=self._reconfigure)]

    def announce(self, health: Array, stuck: Mapping[int, float]) -> None:
        """Take what is announced: see `Change.announced`."""
        self.detector.announce(np.minimum(self._health, health), stuck)

    def command(self, time: int, command: Array) -> None:
        """Take the command (n + k,) [rad/s, rad] that answers the state of a time [ns]."""
        self.detector.command(time, command)


def fly(
    controller: Controller, allocator: Allocator, body: RigidBody | Plant, waypoint: Waypoint,
    duration: float, time_step: float | None = None, state: Array | None = None,
    changes: Iterable[Change] = (), detection: Detection | None = None,
    failures: RotorFailures | None = None,
) -> Flight:
    """Fly to a waypoint; return one sample at each step up to the `duration` [s].

    The samples have the measured states and the commanded rotor speeds and tilt angles; with a
    detection, the measured speeds, too, from the first step on, and what an accelerometer
    measures, as bringup records them.  Raises a FloatingPointError if the flight diverges because
    the gains or the steps are too large, or a ValueError if a time step is given for a plant.

    - `body`: a plant is flown from its initial state, and stays as it is
    - `time_step`: of a rigid body [s], by default 0.01 s, rounded to whole nanoseconds as in the
      stamps of ROS.  A plant has its own
    - `state` (13,): initial state, see `ca_ros.simulation.rigid_body`; by default at rest in the
      origin, or that of the plant
    - `changes`: each takes effect at the first sample at or after its time, of several at one time
      the last
    - `failures`: of the rotors; by default those of the plant.  Only `changes` announce them
    - `detection`: failures that it finds in a sample take effect at that sample
    """
    samples: list[tuple[Array, ...]] = []
    measured, forces = list[Array](), list[Array]()
    plant = _plant_of(body, time_step).restarted(state)
    if failures is not None:
        plant.failures = failures
    pilot, step_ns = Pilot(controller, allocator), plant.time_step_ns
    pending = sorted(changes, key=lambda change: change.time)[::-1]
    for now in range(0, (steps(duration, plant.time_step) + 1) * step_ns, step_ns):
        state, due = plant.measured, []
        while pending and pending[-1].time <= now:
            due.append(pending.pop())
        if detection:
            due += detection.observe(now, state, plant.specific_force)
        for change in due:
            pilot.take(change)
            if detection and change.announced is not None:
                detection.announce(*change.announced)
            plant.body = change.body or plant.body
            waypoint = change.waypoint or waypoint
        velocity, omega = velocity_in_body(state), state[ANGULAR_VELOCITY]
        motion = state[POSITION], state[ATTITUDE], velocity, omega
        try:
            wrench = pilot.controller.wrench(*motion, waypoint, now)
        except ValueError as error:
            raise FloatingPointError(
                f'after {now / 1e9:g} s the flight diverges: {error}') from error
        last = samples[-1][2] if samples else plant.body.vehicle.idle_command
        # Before the first command the rotors have all the time that counts.
        before = now - step_ns if samples else now - round(1e9 * PERIOD_MAX)
        command = pilot.allocate(wrench, last, now, before).command
        if detection:
            detection.command(now, command)
            measured.append(plant.speeds if samples else np.full_like(plant.speeds, np.nan))
            if plant.specific_force is not None:
                forces.append(plant.specific_force)
        samples.append((state, velocity, command))
        plant.step(command)
    flown, velocities, given = map(np.array, zip(*samples, strict=True))
    n = plant.body.vehicle.n
    return Flight(
        np.arange(len(flown)) * step_ns / 1e9, flown[:, POSITION], flown[:, ATTITUDE], velocities,
        flown[:, ANGULAR_VELOCITY], given[:, :n], given[:, n:],
        np.array(measured)[:, :n] if measured else np.zeros((0, 0)), np.array(forces),
    )


def _plant_of(body: RigidBody | Plant, time_step: float | None) -> Plant:
    """Return the plant of a rigid body, or the plant itself; `time_step` as for `fly`."""
    if isinstance(body, RigidBody):
        given = PlantSettings() if time_step is None else PlantSettings(time_step=time_step)
        return Plant(body, given)
    if time_step is not None:
        raise ValueError(f'time_step: the plant has its own, {body.time_step:g} s')
    return body
