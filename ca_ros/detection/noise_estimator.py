"""What is usual in a flight without failures: wrenches of the rotors, drag and noise."""

from math import expm1

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import REST
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.hypothesis_test import THRUST_ERROR
from ca_ros.detection.windows import BLOCK, WINDOWS, Windows
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

FLOOR = 0.3  # least noise over that of the settings
OUTLIER = 9.0  # greatest square that is learnt, over the variance
LEARNING = 2.0, 20.0  # times over which the noise is learnt [s]; disturbances over the first
TIME_ERROR = 0.01  # standard deviation of the lag and the delay of a rotor [s]
COMMON_ERROR = 0.25  # that of an error which all rotors share, over the sum of lag and delay

UNTESTED, TRIM = 0.295, 0.15
"""A flight that has not begun at rest is not tested for this time [s].  Its trim is then
unknown by a share of the thrust of a rotor in hover, which falls to 0 within the first of
`LEARNING`."""

LEARNT = 0.95  # time after which it learns again, over the shortest window


class UsualMotion:
    """Learns the mean wrenches of the rotors, the drag along and about each axis, and the noise.

    It learns once in the time of the shortest window.

    The noise is the greater one of what was seen in a short and in a long time: after a quiet time
    the next manoeuvre may be as rough as those before.

    - `noise` (6,): variance of an impulse by the noise of the settings
    - `flown`: time since the flight began [s]
    - `rested`: whether it began at rest, and its trim is known
    """

    def __init__(self, vehicle: Vehicle, settings: DetectorSettings) -> None:
        inertia, s = np.diag(inertia_of(vehicle)), settings
        self._common = COMMON_ERROR * (s.motor_time_constant + s.delay)
        force = np.full(3, vehicle.mass * s.velocity_noise)
        self.force_noise = BLOCK * (vehicle.mass * s.specific_force_noise) ** 2
        self.noise = 2.0 * np.concatenate([force, inertia * s.angular_velocity_noise]) ** 2
        self._given = np.zeros((6, vehicle.n))
        self.reset()
        self.begin()

    def reset(self) -> None:
        """Forget the trim, the drag and the noise."""
        self.rested = False
        self._spreads = np.tile(self.noise, (len(LEARNING), len(WINDOWS), 1))
        self._drag = np.zeros(6)
        self._means, self._products = np.zeros((2, 6)), np.zeros((2, 6))

    def begin(self) -> None:
        """Begin a flight."""
        self.flown, self._since = 0.0, 0.0

    def rest(self, step: float, given: Array) -> None:
        """Take a step [s] before the flight, with what the rotors gave (6, n) [N, N m].

        This is usual in hover at rest, but not in a take-off, whose trim is not known.
        """
        self._given = self._given - expm1(-step / REST) * (given - self._given)

    @property
    def thrusts(self) -> Array:
        """The mean thrust of each rotor (n,) [N]."""
        return np.asarray(np.linalg.norm(self._given[:3], axis=0))

    def gain(self, time: float = LEARNING[0]) -> float:
        """Return the rate of learning over a time [1/s]: greater in the beginning of a flight."""
        return 1.0 / min(time, self.flown + 0.05)

    def spread(self, ages: Array, measured: bool) -> Array:
        """Return the variance (T, 6) of what windows of some ages (T,) lack, by noise.

        `measured`: whether the force is that of an accelerometer.
        """
        least = np.tile(self.noise, (len(ages), 1))
        if measured:
            least[:, :3] = self.force_noise * ages[:, None]
        return np.asarray(np.maximum(self._spreads.max(axis=0), FLOOR**2 * least))

    def drag(self, motion: Array) -> Array:
        """Return the drag (6,) [N, N m] of a motion (6,), beyond that of the mean motion."""
        return self._drag * (motion - self._means[1])

    def due(self, step: float) -> bool:
        """Return whether it is time to learn, after a further step [s]."""
        self._since += step
        if self._since < LEARNT * WINDOWS[0]:
            return False
        self._since = 0.0
        return True

    def learn(
        self, windows: Windows, spread: Array, motion: Array | None, steady: Array, given: Array
    ) -> None:
        """Learn from windows that end now and show no failure.

        - `spread` (T, 6): the variance of what they lack
        - `motion` (6,): the mean of those at both ends of the shortest window, so that their noise
          cancels in the drag.  None if the vehicle does not move: what holds it may be the ground,
          and only the noise is learnt
        - `steady` (6,): the mean disturbance [N, N m], which is no part of what they lack
        - `given` (6, n): what the rotors give now [N, N m]
        """
        age = windows.ages[0]
        squares = np.minimum(windows.lacked**2, OUTLIER * spread)
        shares = np.array([-expm1(-age * self.gain(time)) for time in LEARNING])
        self._spreads = self._spreads + shares[:, None, None] * (squares - self._spreads)
        self._given = self._given + shares[0] * (given - self._given)
        if motion is not None:
            lacked = windows.lacked[0] / age + steady + self.drag(motion)
            share = -expm1(-age / min(2.5 * LEARNING[0], self.flown))
            moved = np.array([lacked, motion]) - self._means
            self._means = self._means + share * moved
            self._products = self._products + share * (moved * moved[1] - self._products)
            self._drag = np.minimum(self._products[0] / (self._products[1] + 0.05**2), 0.0)

    @property
    def tested(self) -> bool:
        """Whether enough is known of the trim to test the motion."""
        return self.rested or self.flown >= UNTESTED

    def trim(self, ages: Array, push: Array) -> Array:
        """Return the variance (T, 6) of what windows of some ages (T,) lack, by the trim.

        `push` (6,): see `Disturbances`
        """
        share = 0.0 if self.rested else TRIM * max(1.0 - self.flown / LEARNING[0], 0.0)
        return np.asarray((share * ages[:, None]) ** 2 * push)

    def model_errors(self, ages: Array, given: Array, change: Array) -> Array:
        """Return the variance (T, 6) by errors of the thrusts, the lag and the delay.

        `ages`, `given` and `change`: see `Windows`.
        """
        unusual = given - ages[:, None, None] * self._given
        error = (THRUST_ERROR * unusual) ** 2 + (TIME_ERROR * change) ** 2
        common = (self._common * change.sum(axis=2)) ** 2
        return np.asarray(error.sum(axis=2) + common)
