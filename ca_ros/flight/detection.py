"""The detector of rotor failures in the closed loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.flight.controller import Controller
from ca_ros.flight.kernel_detector import Detector
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import ANGULAR_VELOCITY, ATTITUDE, velocity_in_body

Found = list[tuple[int, Array]]
"""The times [ns] at which the health changed, each with the new health (n,)."""

Rebuild = Callable[[Array], tuple[Controller, Allocator]]


class Detection:
    """A detector, and what a closed loop does when it finds a failure.

    `rebuild`: takes the health of the rotors (n,); returns the controller and the allocator for
    it.
    """

    def __init__(self, detector: Detector, rebuild: Rebuild) -> None:
        self.detector, self._rebuild = detector, rebuild
        self.found: Found = []

    def observe(self, time: int, state: Array) -> tuple[Controller, Allocator] | None:
        """Take a measured state (13,) at a time [ns]; return new parts if there is a failure."""
        motion = velocity_in_body(state), state[ANGULAR_VELOCITY]
        if not self.detector.observe(time, state[ATTITUDE], *motion):
            return None
        self.found.append((time, self.detector.health))
        return self._rebuild(self.detector.health)

    def command(self, time: int, command: Array) -> None:
        """Take the command (n + k,) [rad/s, rad] that answers the state of a time [ns]."""
        self.detector.command(time, command)


def replay(detector: Detector, flight: Flight) -> Found:
    """Return what a detector finds in a recorded flight, as it did in the flight itself."""
    found: Found = []
    angles = np.reshape(flight.angles, (len(flight.time), -1))
    samples = zip(
        np.round(flight.time * 1e9).astype(int).tolist(), flight.attitude, flight.velocity,
        flight.angular_velocity, np.column_stack([flight.speeds, angles]), strict=True,
    )
    for time, attitude, velocity, angular_velocity, command in samples:
        if detector.observe(time, attitude, velocity, angular_velocity):
            found.append((time, detector.health))
        detector.command(time, command)
    return found
