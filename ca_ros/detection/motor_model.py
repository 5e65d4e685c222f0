"""The thrusts of rotors that follow stamped commands with a delay and a lag."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.detector_inputs import TIME_MAX
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.vehicle.command_bounds import CommandBounds
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.motor_lag import ServoLag, lagged
from ca_ros.vehicle.state import difference
from ca_ros.vehicle.vehicle import Vehicle

COMMANDS_MAX = 1000  # commands that wait to take effect; of more, the oldest are dropped
SETTLING = 4.0  # time after which the speeds of motors and servos are known, over their lag

HELD = 70_000_000
"""Time for which a command counts [ns].  Later, the next one has been lost, and what the rotors do
is unknown; with commands at 12.5 Hz and less, sound rotors are named in aggressive flight."""


def settling_of(settings: DetectorSettings, lag: float | None = None) -> int:
    """Return the time after which the rotors follow a command [ns].

    `lag`: time constant of the motors instead of that of the settings [s]
    """
    lag = max(settings.motor_time_constant if lag is None else lag, settings.servo_time_constant)
    # It is in whole milliseconds, so that single precision does not change it.
    return 1_000_000 * int(1e3 * (SETTLING * lag + settings.delay) + 0.5)


class CommandedRotors:
    """Predicts what the rotors of a sound vehicle do.

    `settings`: the lags and the delay.  `lags`: C time constants (C, 1) of the motors instead of
    that of the settings [s]; speeds and thrusts then are (C, n).

    - `vehicle`: may be replaced by one with servos that stick
    - `speeds` (n,): [rad/s]; zero before the first command
    - `settling`: time after which the speeds follow a command [ns]
    - `known`: whether they did in the last interval; so it is before the first command
    - `wrenches` (6, n): force and torque per thrust of each rotor, in the last interval
    - `bounds`: of the commands
    - `planar` (s,): the rotors with a single servo
    - `columns`: n + 2 s
    """

    def __init__(
        self, vehicle: Vehicle, settings: DetectorSettings, lags: Array | None = None
    ) -> None:
        s = settings
        self.vehicle = vehicle.intact
        self._lag = s.motor_time_constant if lags is None else lags
        self._servos = ServoLag(s.servo_time_constant, s.servo_rate, vehicle)
        self._delay = round(s.delay * 1e9)
        self.settling = settling_of(s, float(np.max(self._lag)))
        self.known, self._unsettled, self._due = True, 0, TIME_MAX
        self.bounds = CommandBounds(vehicle)
        self._waiting: list[tuple[int, Array, Array]] = []
        self.speeds, self._angles = self._command = self._servos.resting
        self.wrenches = rotor_wrenches(vehicle, self._angles)
        self.planar = vehicle.servos.planar
        self.columns = vehicle.n + 2 * len(self.planar)
        both = vehicle.servos.turned(np.zeros(vehicle.n))
        planes = [vehicle.thrust_wrenches(self.planar, each[self.planar]) for each in both]
        self._planes = np.concatenate(planes, axis=1)

    def command(self, time: int, command: Array) -> None:
        """Take a command that was sent at a time [ns]: speeds (n,) and then angles (k,).

        It is within the bounds: see `CommandBounds.followed`.
        """
        n = self.vehicle.n
        del self._waiting[: 1 - COMMANDS_MAX]
        self._waiting.append((time + self._delay, command[:n], command[n:]))
        if len(self._waiting) > 1 and self._waiting[-2][0] > self._waiting[-1][0]:
            self._waiting.sort(key=lambda waiting: waiting[0])

    def thrusts(self, start: int, end: int) -> Array:
        """Return the mean thrusts (n,) between two times [ns], as of sound rotors [N]."""
        total, now, angles = np.zeros(()), start, self._angles
        self.known = not self._unsettled
        while now < end:
            while self._waiting and self._waiting[0][0] <= now:
                due, speeds, turned = self._waiting.pop(0)
                self._command, self._due = (speeds, turned), due
            until = min(end, self._waiting[0][0]) if self._waiting else end
            self._unsettled = max(self._unsettled - (until - now), 0)
            if until - self._due > HELD:
                self.lose()
            before, step = self.speeds, (until - now) / 1e9
            self.speeds = lagged(self._lag, before, self._command[0], step)
            self._angles = self._servos.move(self._angles, self._command[1], step, self.vehicle)
            thrusts = self.vehicle.thrusts(0.5 * (before + self.speeds))
            share = (until - now) / (end - start)
            total = thrusts if share == 1.0 else total + share * thrusts
            now = until
        middle = angles + 0.5 * difference(self._angles, angles)
        self.wrenches = rotor_wrenches(self.vehicle, middle)
        return total

    def lose(self) -> None:
        """Let the speeds be unknown until they have settled."""
        self.known, self._unsettled = False, self.settling

    def given(self, start: int, end: int) -> Array:
        """Return the mean force and torque of each rotor between two times [ns], (6, n + 2 s).

        Those of the n sound rotors come first.  Then come those that the s rotors with a single
        servo would give at its angle zero, and after a quarter turn [N, N m].
        """
        thrusts = self.thrusts(start, end)
        given = self.wrenches * thrusts
        if self.planar:
            given = np.concatenate([given, self._planes * thrusts[2 * self.planar]], axis=1)
        return given
