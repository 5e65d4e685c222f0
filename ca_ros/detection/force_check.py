"""Whether the specific force of an inertial unit can be that of the states, or the rotors."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.recording import FRD, G
from ca_ros.vehicle.plausibility import CLEARLY, FORCE_OFF, FORCE_WINDOW, IN_AIR
from ca_ros.vehicle.state import rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

SURE = 4.0  # least ratio of what is off to what another reading leaves; eighth turns have 2.4
WINDOWS = 2  # in a row with the same verdict, from which it counts
READINGS = {'in g': G * np.eye(3), 'forward-right-down': np.diag(FRD)} | {
    f'in axes turned about z by {angle} degrees': np.array(
        [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    for angle, cosine, sine in ((90, 0.0, 1.0), (180, -1.0, 0.0), (270, 0.0, -1.0))
}
"""Matrices that give what is meant; axes are turned counter-clockwise, seen from above."""


class ForceCheck:
    """Finds an inertial unit that gives its specific force in g, or in other axes.

    In windows the mean specific force is compared with what attitude and velocity of the states
    give, by the laws of motion, or, where no states come, with that of the commanded rotors in the
    air; with the tolerances of `ca_ros.vehicle.plausibility`.  It is wrong if it is off by more,
    and another reading leaves less than 1 / `SURE` of that; it is right again if that reading
    leaves more than `CLEARLY` times as much.  Axes that are turned about z show in wind or fast
    flight alone, never in hover.  Turns, falls and inverted flight are no faults.
    Without states, a crash may look like one: rotors are commanded to carry a vehicle that lies on
    its back, or falls.

    `fault`: what is wrong, in words; empty if nothing is.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.fault = ''
        self._vehicle = vehicle.intact
        self._verdict, self._found, self._times = '', '', 0
        self._state: tuple[int, Array] | None = None  # stamp, velocity in the world frame
        self._moved: Array = np.zeros(3)
        self._force: Array = np.zeros(3)
        self._expected: Array = np.zeros(3)
        self._start = self._samples = self._commands = self._lasted = 0

    def command(self, command: Array) -> None:
        """Take rotor speeds (n,) and then servo angles (k,) [rad/s, rad]."""
        n, vehicle = self._vehicle.n, self._vehicle
        given = rotor_wrenches(vehicle, command[n:])[:3] @ vehicle.thrusts(command[:n])
        self._expected = self._expected + given / vehicle.mass
        self._commands += 1

    def state(self, time: int, attitude: Array, velocity: Array) -> None:
        """Take a state: its stamp [ns], attitude (4,) and velocity (3,) in the body [m/s]."""
        turn, before = rotation_matrix(attitude), self._state
        self._state = time, turn @ velocity
        if before is not None and 0 < (step := time - before[0]) < 1e9 * FORCE_WINDOW:
            gained = self._state[1] - before[1]
            gained[2] += step / 1e9 * self._vehicle.gravity
            self._moved = self._moved + turn.T @ gained
            self._lasted += step

    def add(self, time: int, force: Array) -> None:
        """Take a specific force (3,) [m/s^2] with its stamp [ns]."""
        if not 0 <= time - self._start < 2e9 * FORCE_WINDOW:
            self._begin(time)
        elif time - self._start >= 1e9 * FORCE_WINDOW:
            force = self._force / self._samples
            if self._lasted:
                self._judge(force, 1e9 * self._moved / self._lasted, 'states')
            elif self._commands:
                self._judge(force, self._expected / self._commands, 'commanded rotors')
            self._begin(time)
        self._force = self._force + force
        self._samples += 1

    def _begin(self, time: int) -> None:
        self._start, self._samples, self._commands, self._lasted = time, 0, 0, 0
        self._force, self._expected, self._moved = np.zeros(3), np.zeros(3), np.zeros(3)

    def _judge(self, force: Array, expected: Array, source: str) -> None:
        """Take the means (3,) of a window, and of what the expected one is."""
        if np.linalg.norm(expected) < IN_AIR * self._vehicle.gravity:
            return
        off = float(np.linalg.norm(force - expected))
        left = {
            words: float(np.linalg.norm(matrix @ force - expected))
            for words, matrix in READINGS.items()}
        verdict = min(left, key=left.__getitem__)
        if off <= max(FORCE_OFF, SURE * left[verdict]):
            if self._found and CLEARLY * off >= left[self._found]:
                return
            verdict = ''
        self._times = self._times + 1 if verdict == self._verdict else 1
        self._verdict = verdict
        if self._times == WINDOWS:
            self._found = verdict
            self.fault = verdict and (
                f'its specific force is {off:.3g} m/s^2 away from that of the {source}; read as '
                f'{verdict} {left[verdict]:.3g}: expected m/s^2, forward-left-up')
