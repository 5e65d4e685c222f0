"""The thrusts of rotors that follow stamped commands with a delay and a lag."""

from __future__ import annotations

import numpy as np

from ca_ros.arrays import Array
from ca_ros.flight.motor_lag import MotorLag
from ca_ros.vehicle.vehicle import Vehicle

COMMANDS_MAX = 1000  # commands that wait to take effect; of more, the oldest are dropped


class CommandedRotors:
    """Predicts what the rotors of a sound vehicle do.

    `time_constant` and `delay`: of the motors [s].  With C time constants (C, 1), speeds and
    thrusts are (C, n).

    `speeds` (n,): [rad/s]; zero before the first command.
    """

    def __init__(self, vehicle: Vehicle, time_constant: float | Array, delay: float) -> None:
        self._vehicle, self._lag = vehicle.with_health(1.0), MotorLag(time_constant)
        self._delay = round(delay * 1e9)
        self._waiting: list[tuple[int, Array]] = []
        self._command = self.speeds = np.zeros(vehicle.n)

    def command(self, time: int, speeds: Array) -> None:
        """Take a command (n,) [rad/s] that was sent at a time [ns]."""
        self._waiting.append((time + self._delay, speeds))
        if len(self._waiting) > 1 and self._waiting[-2][0] > self._waiting[-1][0]:
            self._waiting.sort(key=lambda waiting: waiting[0])
        del self._waiting[:-COMMANDS_MAX]

    def thrusts(self, start: int, end: int) -> Array:
        """Return the mean thrusts (n,) between two times [ns], as of sound rotors [N]."""
        total, now = np.zeros_like(self.speeds), start
        while now < end:
            while self._waiting and self._waiting[0][0] <= now:
                self._command = self._waiting.pop(0)[1]
            until = min(end, self._waiting[0][0]) if self._waiting else end
            before, step = self.speeds, until - now
            self.speeds = self._lag(before, self._command, step / 1e9)
            share = step / (end - start)
            total = total + share * self._vehicle.thrusts(0.5 * (before + self.speeds))
            now = until
        return total
