"""Wind: a constant wind with gusts."""

from __future__ import annotations

from math import exp, expm1, sqrt

import numpy as np

from ca_ros.arrays import Array


class Wind:
    """A constant wind plus a first-order Gauss-Markov process in each direction.

    The process is the longitudinal Dryden spectrum (MIL-F-8785C) of a vehicle with the airspeed V
    in turbulence of the scale L, for L / V = `correlation_time`.  It is stationary from the start
    and sampled exactly: the statistics do not depend on the step.

    - `mean` (3,): in the world frame [m/s]
    - `intensity` (3,): standard deviation of the gusts [m/s]
    - `correlation_time`: [s]
    """

    def __init__(
        self, mean: Array, intensity: Array, correlation_time: float, rng: np.random.Generator
    ) -> None:
        self.mean, self.intensity, self.correlation_time = mean, intensity, correlation_time
        self._rng, self._gusty = rng, bool(intensity.any())
        self._gust = intensity * rng.standard_normal(3)

    def __call__(self, step: float) -> Array:
        """Return the wind (3,) [m/s] of the next step [s]."""
        wind = self.mean + self._gust
        if self._gusty:
            ratio = step / self.correlation_time
            spread = self.intensity * sqrt(-expm1(-2.0 * ratio))
            self._gust = exp(-ratio) * self._gust + spread * self._rng.standard_normal(3)
        return wind
