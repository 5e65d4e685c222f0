"""A waypoint: the position and the heading to fly to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.state import heading


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A position (3,) [m] and an attitude (x, y, z, w), of which only the heading counts."""

    position: Array
    attitude: Array

    @classmethod
    def of(cls, x: float, y: float, z: float, heading: float) -> Waypoint:
        """Return the waypoint at a position [m] with a heading [rad]."""
        half = heading / 2.0
        return cls(np.array([x, y, z]), np.array([0.0, 0.0, sin(half), cos(half)]))

    @cached_property
    def heading(self) -> float:
        """Heading of the attitude [rad], see `ca_ros.vehicle.state.heading`."""
        return float(heading(self.attitude))
