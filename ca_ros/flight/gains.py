"""The gains and limits of the controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ca_ros.arrays import Array
from ca_ros.flight.parameters import CONTROL, triple
from ca_ros.schema import complete


@dataclass(frozen=True)
class Gains:
    """Gains and limits of the controller; arrays are (3,), along x, y, z.

    With `level` the vehicle stays level, as long as its rotors can command the sideways force.
    `integral` is the gain of the integral action [1/s], 0 without one.
    """

    position_stiffness: Array
    position_damping: Array
    attitude_stiffness: Array
    attitude_damping: Array
    speed_max: float
    tilt_max: float
    level: bool = False
    integral: float = 0.0

    @classmethod
    def from_parameters(cls, given: Mapping[str, Any]) -> Gains:
        """Read the gains from parameters by name; raise a `ParameterError` that names a fault."""
        p: dict[str, Any] = complete(given, CONTROL)
        return cls(
            **{
                name: triple(p, f'controller.{name}')
                for name in (
                    'position_stiffness',
                    'position_damping',
                    'attitude_stiffness',
                    'attitude_damping',
                )
            },
            speed_max=p['controller.speed_max'],
            tilt_max=p['controller.tilt_max'],
            level=p['controller.attitude'] == 'level',
            integral=p['controller.integral_gain'],
        )
