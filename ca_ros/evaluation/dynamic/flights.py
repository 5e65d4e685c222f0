"""The flights of a dynamic study, of which the plots and the animation are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import pandas as pd

from ca_ros.flight.record import Flight
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.flight.trajectory import Trajectory
from ca_ros.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class Flights:
    """Flights by method, with samples from `sample_errors` and the times of detections [s].

    The vehicle is that of the start.
    """

    flights: Mapping[str, Flight]
    samples: Mapping[str, pd.DataFrame]
    vehicle: Vehicle
    trajectory: Trajectory
    failures: RotorFailures
    detected: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def end(self) -> float:
        """The end of the longest flight [s]."""
        return max(float(flight.time[-1]) for flight in self.flights.values())

    def marks(self, method: str) -> dict[str, list[float]]:
        """Return the times [s] for `ca_ros.figures.mark`."""
        return self.failures.moments(self.detected.get(method, ()))

    @property
    def moments(self) -> list[float]:
        """The times of the failures [s]."""
        return [time / 1e9 for time in self.failures.times()]
