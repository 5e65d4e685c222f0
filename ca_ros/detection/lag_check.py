"""An estimate of the motors' lag and delay from a flight, which checks the settings."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import RESTART
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.motor_model import CommandedRotors
from ca_ros.vehicle.state import cross
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

LAGS: Array = np.linspace(0.005, 0.16, 32)  # candidates [s]
SLOW = 0.5  # time over which errors of the prediction are learnt as disturbances [s]
MEMORY = 30.0  # time over which old samples are forgotten [s]
WHITE = 0.01  # time after which the errors of a sample are new [s]
ERROR_MAX = 10.0  # greatest error of an angular velocity that a lag explains [rad/s]
CLEAR = 30.0  # lead of a lag in the logarithm of the likelihood, from which it counts
GAIN = 0.5, 2.0  # bounds of the true torques over those that are predicted
DAMPING = 2.0  # greatest rate at which air damps a rotation [1/s]
EXPLAINED = 0.7  # least share of the variance that the best prediction explains
LAUNCH = 2.0  # time after the ground in which the motion shows nothing [s]
SHARE, LEAST, MOST = 0.5, 0.018, 0.04
"""A set lag is warned of if it is off by more than this share of it, but at least and at most
these times [s]."""


class LagCheck:
    """Finds the lag with which the commands explain the motion best.

    For each candidate, the torques of the commanded rotors predict the angular velocity, and the
    best gain and damping of each axis, within bounds, are fitted with it: without the damping by
    air, a vehicle that is damped shows too short a lag.  The lag with the least squares of errors
    is the likeliest, the errors taken as white (output error method: Ljung, System
    Identification, 1999, section 4.2).  It counts if it explains enough of what is measured: a
    vehicle that hardly moves would else show the lag that predicts nothing.  The longest candidate
    shows nothing either.  Only the sum of lag
    and delay can be estimated: a delay that is longer by some milliseconds looks like a lag that
    is longer by as much, so the set delay counts as known.  Where rotor speeds are measured, the
    errors of the predicted speeds take the place of those of the motion.
    """

    def __init__(self, vehicle: Vehicle, settings: DetectorSettings) -> None:
        self._set, self._delay = settings.motor_time_constant, settings.delay
        self._rotors = CommandedRotors(vehicle, settings, LAGS[:, None])
        self._inertia = inertia_of(vehicle)
        self._inverse = np.linalg.inv(self._inertia)
        self._time: int | None = None
        self._predicted = self._slow = np.zeros((len(LAGS) + 2, 3))
        self._squares, self._count = np.zeros((6, len(LAGS), 3)), 0.0
        self._measured, self._flown, self._step = False, 0.0, 0.0

    @property
    def total(self) -> float | None:
        """The likeliest sum of lag and delay [s]; None while the flight does not show it."""
        costs = self._costs()
        shown = costs.max() - costs.min() > CLEAR and self._explains(int(costs.argmin()))
        return float(LAGS[costs.argmin()]) + self._delay if shown else None

    @property
    def fault(self) -> str:
        """What is wrong with the set lag and delay; empty if nothing is known to be."""
        costs, given = self._costs(), self._set
        likely = float(LAGS[costs.argmin()])
        clear = np.interp(given, LAGS, costs) - costs.min() > CLEAR
        clear = clear and self._explains(int(costs.argmin()))
        if not clear or abs(likely - given) <= min(max(SHARE * given, LEAST), MOST):
            return ''
        return (
            f'lag and delay of the motors are about {1e3 * (likely + self._delay):.0f} ms, but '
            'detector.motor_time_constant and detector.delay are '
            f'{1e3 * given:.0f} + {1e3 * self._delay:.0f} ms'
        )

    def _rests(self) -> Array:
        """Return the sums of squares (C, k) that each candidate leaves, with gain and damping."""
        seen, both, predicted, damped, shared, damping = self._squares
        bounds = (1.0, 1.0) if self._measured else GAIN
        rates = damped * predicted - both * shared
        rates = rates / np.maximum(damping * predicted - shared**2, 1e-12)
        rates = np.clip(rates, 0.0, DAMPING)
        gains = np.clip((both - rates * shared) / np.maximum(predicted, 1e-12), *bounds)
        left = seen + gains * (gains * predicted - 2.0 * both)
        left += rates * (rates * damping + 2.0 * gains * shared - 2.0 * damped)
        return np.asarray(np.maximum(left, 0.0))

    def _costs(self) -> Array:
        """Return the negative logarithm of the likelihood of each candidate (C,)."""
        costs: Array = 0.5 * self._count * np.log(self._rests() + 1e-9).sum(axis=1)
        return costs

    def _explains(self, best: int) -> bool:
        """Return whether a candidate explains enough of what is measured."""
        left = self._rests()[best] / np.maximum(self._squares[0, best], 1e-12)
        # The longest one may only be the least wrong, such as in a take-off.
        return bool(left.min() < 1.0 - EXPLAINED) and best < len(LAGS) - 1

    def command(self, time: int, command: Array) -> None:
        """Take a command with its stamp [ns], as `FailureDetector.command` does."""
        if self._time is None or time - self._time < RESTART:
            self._rotors.command(time, self._rotors.bounds.followed(command))

    def observe(self, time: int, angular_velocity: Array, health: Array) -> None:
        """Take the angular velocity (3,) [rad/s] at a time [ns], and the health (n,)."""
        last, self._time = self._time, time
        self._step = step = 0.0 if last is None else (time - last) / 1e9
        thrusts = None
        if last is not None and 0.0 < step < SLOW:
            thrusts = health * self._rotors.thrusts(last, time)
        if thrusts is None or not self._rotors.known:
            self._predicted = np.tile(angular_velocity, (len(LAGS) + 2, 1))
            self._slow, self._flown = self._predicted, 0.0
            return
        self._flown += step
        turned = cross(angular_velocity, self._inertia @ angular_velocity)
        torques = thrusts @ self._rotors.wrenches[3:].T - turned
        turned = self._predicted[2:] + step * torques @ self._inverse.T
        damped = self._predicted[1] - step * angular_velocity
        # The first row is what is measured, the second what a damping of 1/s adds.
        self._predicted = np.concatenate([[angular_velocity, damped], turned])
        self._slow = self._slow + step / SLOW * (self._predicted - self._slow)
        quick = self._predicted - self._slow
        counts = not self._measured and self._flown > LAUNCH
        if counts and (abs(quick[0] - quick[2:]) <= ERROR_MAX).all():
            self._add(quick[:1], quick[2:], quick[1:2])

    def interrupt(self) -> None:
        """Take the next state as one that does not continue those before."""
        self._time = None

    def measure(self, speeds: Array, health: Array) -> None:
        """Take measured rotor speeds (n,) [rad/s] at the time of the last state."""
        if not self._measured:
            self._squares, self._count = np.zeros((6, len(LAGS), len(speeds))), 0.0
            self._measured = True
        if not self._rotors.known:
            return
        sound = health >= 1.0
        self._add((sound * speeds)[None], sound * self._rotors.speeds, 0.0 * speeds[None])

    def _add(self, measured: Array, predicted: Array, damped: Array) -> None:
        """Add what is measured, what damping adds (1, k), and what candidates predict (C, k)."""
        keep, weight = 1.0 - self._step / MEMORY, min(self._step / WHITE, 1.0)
        products = np.stack(np.broadcast_arrays(
            measured**2, measured * predicted, predicted**2, measured * damped,
            predicted * damped, damped**2))
        self._squares = keep * self._squares + weight * products
        self._count = keep * self._count + weight
