"""The fit of recorded flights: lag, delay, and how far thrusts move a vehicle.

For a lag and a delay, the commands give thrusts, and these the motion of the vehicle in the file.
`solve` returns the ratios between the measured motion and this one, and a damping of each axis.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize
from scipy.signal import butter, lfilter, sosfilt

from ca_ros.arrays import Array, BoolArray
from ca_ros.settings import ParameterError
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.plausibility import check
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

HIGH_PASS = 1.5  # corner of the filter of both sides of the fit [Hz]
SMOOTH = 25.0  # corner of the low-pass of both sides, at most a quarter of the sampling rate [Hz]
FINE = 0.002  # greatest step of the rotors' model, also where the gyro is slower [s]
LAG_MAX, DELAY_MAX = 0.3, 0.15  # greatest lag and delay that are tried [s]
GRID = 9  # values of lag and of delay from which the search begins
BLOCK = 2.0  # length of the blocks of the bootstrap and of cross-validation [s]
RATIO_MAX = 20.0  # greatest factor by which a first guess of the inertia may be wrong
DAMPING_MAX = 10.0  # greatest rate at which air damps or drives a rotation [1/s]
NEAR = 5  # lags and delays about the best, from which each resample chooses
BEYOND = 3.0  # greatest command over the greatest speed of the vehicle's file
EXCITED = 1e-6  # least variance of a side of the fit
ROUNDING = 1e-15  # least singular value of the products of sides that counts, over the greatest
AXES = 'roll', 'pitch', 'yaw', 'thrust'


class FlightSides:
    """A recording on one clock, and its filtered sides of the fit for a lag and a delay."""

    def __init__(self, vehicle: Vehicle, recording: Recording, measured: bool) -> None:
        self._vehicle, self._inertia = vehicle, inertia_of(vehicle)
        self._turning = self._inertia
        source = 'speed' if measured else 'command'
        if source not in recording.values:
            raise ParameterError(f'{recording.name}: no measured rotor speeds')
        times = recording.times['gyro']
        self._step = float(np.median(np.diff(times)))
        if 4.0 * HIGH_PASS * self._step >= 1.0:
            raise ParameterError(
                f'{recording.name}: t: a value of the gyro each {self._step:g} s: expected more '
                f'than {4.0 * HIGH_PASS:g} in a second; t is in seconds'
            )
        turning, most = np.abs(recording.values[source]).max(), np.abs(
            [vehicle.speed_min, vehicle.speed_max]).max()
        if turning > BEYOND * most:
            raise ParameterError(
                f'{recording.name}: {source}: up to {turning:.4g}, but rotors.speed_max is '
                f'{most:.4g} rad/s: expected rad/s; if these are rpm, multiply them by 2 pi / 60'
            )
        start, end = recording.span
        if end - start < BLOCK:
            raise ParameterError(
                f'{recording.name}: {max(0.0, end - start):.3g} s: expected {BLOCK:g} s or more '
                'with command and gyro')
        check(vehicle, recording, source)
        self._time = np.arange(start, end, self._step)
        # Rotors follow their commands also between two values of the gyro.
        self._parts = int(np.ceil(self._step / FINE - 1e-6))
        edges = np.arange(-0.5, (len(self._time) - 1) * self._parts + 1.0)
        self._edges = start + self._step / self._parts * edges
        self.blocks = int(len(self._time) * self._step / BLOCK)
        # The integrals of commands that are held until the next, before the first and after the
        # last, too; their differences are smooth in the delay.
        moments, commands = recording.times[source], recording.values[source]
        self._moments = np.array([start - 1.0, *moments, end + 1.0])
        held = np.diff(self._moments)[:, None] * np.vstack([commands[:1], commands])
        self._integrals = np.vstack([np.zeros_like(commands[:1]), held.cumsum(axis=0)])
        gyro = recording.values['gyro']
        # The second difference of white noise has six times its variance.
        self.noise = float(np.sqrt(np.median(np.diff(gyro, 2, axis=0) ** 2) / 0.4549 / 6.0))
        self._gyro = _sampled(self._time, times, gyro)
        rate = 1.0 / self._step
        band = [HIGH_PASS, min(SMOOTH, rate / 4.0)]
        self._filter = butter(2, band, 'bandpass', fs=rate, output='sos')
        self._wrenches, self._inverse = rotor_wrenches(vehicle), np.linalg.inv(self._inertia)
        # The filters have forgotten their start after this.
        self._begin = min(int(1.0 / self._step), len(self._time) // 4)
        self._rates, self._up = self._filtered(self._gyro), None
        if 'acc' in recording.values:
            acc = _sampled(self._time, recording.times['acc'], recording.values['acc'])
            self._up = self._filtered(acc[:, 2])

    def refine(self, ratios: Array) -> None:
        """Take the ratios (2,) of roll and pitch of a first fit into the gyroscopic torque.

        That of yaw is as wrong as the torque coefficient may be.
        """
        likely = np.where((ratios > 1.0 / RATIO_MAX) & (ratios < RATIO_MAX), ratios, 1.0)
        likely = np.sqrt([*likely, likely.prod() ** 0.5])
        self._turning = self._inertia / np.outer(likely, likely)

    def _filtered(self, values: Array) -> Array:
        return sosfilt(self._filter, values - values[:1], axis=0)[self._begin :]

    def _models(self, lag: float, delay: float) -> tuple[Array, Array, Array, Array]:
        """Return the filtered sides that commands and rates give.

        Rates (K, 3), those of the rotors' kick (K,), those of damping (K, 3), acceleration (K,).
        """
        step = self._step / self._parts
        given = _sampled(self._edges - delay, self._moments, self._integrals)
        speeds: Array = np.diff(given, axis=0) / step
        if lag > 0.0:
            share = 1.0 - np.exp(-step / lag)
            mean, start = [share / 2.0, share / 2.0], (1.0 - share / 2.0) * speeds[:1]
            speeds = lfilter(mean, [1.0, share - 1.0], speeds, axis=0, zi=start)[0]
        wrench = self._vehicle.thrusts(speeds) @ self._wrenches.T
        gyro = np.repeat(self._gyro, self._parts, axis=0)[: len(wrench)]
        torque = wrench[:, 3:] - np.cross(gyro, gyro @ self._turning)
        # The mean torque is that of a centre of mass beside the rotors' centre: the filter takes
        # it away, but integrated it would overflow the filter's precision.
        torque = torque - torque.mean(axis=0)
        rates = cumulative_trapezoid(torque @ self._inverse.T, dx=step, axis=0, initial=0.0)
        turned = cumulative_trapezoid(gyro, dx=step, axis=0, initial=0.0)
        sides = rates, speeds @ self._vehicle.spins, turned, wrench[:, 2] / self._vehicle.mass
        rates, kick, turned, up = (self._filtered(side[:: self._parts]) for side in sides)
        return rates, kick, turned, up

    def products(self, lag: float, delay: float) -> Array:
        """Return the products of all sides, summed over each block, (blocks, 4 axes, 4, 4).

        The sides are what the rotors do, their kick, the damping, and what is measured.
        """
        rates, kick, turned, up = self._models(lag, delay)
        none = np.zeros(len(rates))
        sides = [(rates[:, i], kick if i == 2 else none, turned[:, i], self._rates[:, i])
                 for i in range(3)]
        sides.append((up, none, none, none if self._up is None else self._up))
        length = max(1, round(BLOCK / self._step))
        count = len(none) // length
        blocks = np.array(sides)[:, :, : count * length].reshape(4, 4, count, length)
        return np.asarray(np.einsum('aibk,ajbk->baij', blocks, blocks))


def _sampled(time: Array, times: Array, values: Array) -> Array:
    """Return values (K, c) of a stream at some times, interpolated."""
    return np.column_stack([np.interp(time, times, column) for column in values.T])


def solve(sums: Array) -> tuple[Array, Array]:
    """Return the factors (..., 4, 4) of the sides of each axis, and the errors (...).

    The factors give the measured side: those of the rotors, of their kick and of the damping; the
    last is -1.  The error is the sum of the logarithms of the axes' residual variances.

    - `sums` (..., 4, 4, 4): products of the sides of each axis, see `FlightSides.products`
    """
    squares = np.diagonal(sums, axis1=-2, axis2=-1)
    excited = np.minimum(squares[..., 0], squares[..., 3]) > EXCITED

    def least(there: BoolArray) -> Array:
        both = there[..., :, None] & there[..., None, :]
        inverse = np.linalg.pinv(
            np.where(both, sums[..., :3, :3], 0.0), rcond=ROUNDING, hermitian=True)
        return np.asarray(np.einsum('...ij,...j->...i', inverse, sums[..., :3, 3]))

    there = squares[..., :3] > EXCITED
    damped, free = least(there), least(there & [True, True, False])
    ratios = np.where(abs(damped[..., 2:]) <= DAMPING_MAX, damped, free)
    factors = np.concatenate([ratios, np.full((*excited.shape, 1), -1.0)], axis=-1)
    left = np.einsum('...i,...ij,...j->...', factors, sums, factors)
    shares = np.divide(left, squares[..., 3], out=np.ones_like(left), where=excited)
    factors[~excited] = [np.nan, 0.0, 0.0, -1.0]
    return factors, np.log(np.maximum(shares, 1e-12)).sum(axis=-1)


def fitted(flights: Sequence[FlightSides], lag: float, delay: float) -> tuple[Array, float]:
    """Return the factors (4, 4) and the error of all flights; see `solve`."""
    sums = np.sum([flight.products(lag, delay).sum(axis=0) for flight in flights], axis=0)
    factors, error = solve(sums)
    return factors, float(error)


def refine(flights: Sequence[FlightSides], lag: float, delay: float) -> None:
    """Take the fitted inertia into the gyroscopic torques, if this lessens the error."""
    factors, error = fitted(flights, lag, delay)
    for ratios in factors[:2, 0], np.ones(2):
        for flight in flights:
            flight.refine(ratios)
        if fitted(flights, lag, delay)[1] < error:
            return


def best_lag(
    flights: Sequence[FlightSides], first: tuple[float, float] | None = None
) -> tuple[float, float]:
    """Return the lag and delay of the least error [s]; `first`: where the search begins."""
    def error(point: Sequence[float]) -> float:
        lag, delay = point
        if not (0.0 <= lag <= LAG_MAX and 0.0 <= delay <= DELAY_MAX):
            return np.inf
        return fitted(flights, lag, delay)[1]

    if first is None:
        squares = np.linspace(0.0, 1.0, GRID) ** 2
        first = min(itertools.product(LAG_MAX * squares, DELAY_MAX * squares), key=error)
    simplex = np.array([first, *(np.add(first, step) for step in ((0.01, 0.0), (0.0, 0.005)))])
    options = {'initial_simplex': simplex, 'xatol': 1e-4, 'fatol': 1e-6, 'maxfev': 80}
    lag, delay = minimize(error, first, method='Nelder-Mead', options=options).x.tolist()
    return lag, delay


class Products:
    """Products of blocks for lags and delays about the best, from which a resample chooses."""

    def __init__(self, points: Array, sums: Array) -> None:
        self.points, self.sums, self.count = points, sums, sums.shape[1]
        away = points - points[0]
        self._reach = np.maximum(np.abs(away).max(axis=0), 1e-9)
        self._scaled = away / self._reach
        self._ends = self._scaled.min(axis=0), self._scaled.max(axis=0)
        self._surface = np.linalg.pinv(_powers(self._scaled))

    @classmethod
    def of(cls, flights: Sequence[FlightSides], best: tuple[float, float]) -> 'Products':
        """Return the products of all blocks of flights."""
        ways = np.linspace(-1.0, 1.0, NEAR)
        lags = np.unique(np.clip(best[0] + max(0.2 * best[0], 0.005) * ways, 0.0, LAG_MAX))
        delays = np.unique(np.clip(best[1] + max(0.2 * best[1], 0.003) * ways, 0.0, DELAY_MAX))
        points = np.array([best, *((lag, delay) for lag in lags for delay in delays)])
        rows = [
            np.concatenate([flight.products(*point) for flight in flights]) for point in points
        ]
        return cls(points, np.array(rows))

    def measures(self, axis: int) -> bool:
        """Return whether there is a measurement of an axis."""
        return bool(self.sums[0, :, axis, 3, 3].sum() > EXCITED)

    def fit(self, blocks: NDArray[np.integer]) -> tuple[float, float, Array]:
        """Return the best lag and delay for some of the blocks, and the ratios (5,).

        They are those of the rotors on each axis, and of the kick.  The error and the ratios are
        quadratic between the points.
        """
        factors, errors = solve(self.sums[:, blocks].sum(axis=1))
        ratios = self._surface @ np.column_stack([factors[:, :, 0], factors[:, 2, 1]])
        _, *slope, xx, xy, yy = self._surface @ errors
        bend = np.array([[2.0 * xx, xy], [xy, 2.0 * yy]])
        if np.linalg.eigvalsh(bend)[0] > 0.0:
            place = np.clip(np.linalg.solve(bend, np.negative(slope)), *self._ends)
        else:
            place = self._scaled[np.argmin(errors)]
        lag, delay = self.points[0] + place * self._reach
        return lag, delay, _powers(place[None])[0] @ ratios


def _powers(places: Array) -> Array:
    """Return the monomials (k, 6) up to the second degree of places (k, 2)."""
    x, y = places.T
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])


def unseen(flights: Sequence[FlightSides], best: tuple[float, float]) -> dict[str, float]:
    """Return the least R^2 of each axis on flights, or blocks, that were not used for the fit."""
    parts = [part for flight in flights if len(part := flight.products(*best))]
    if len(parts) == 1:
        parts = np.array_split(parts[0], 3)
    found = dict.fromkeys(AXES, np.inf)
    for i, part in enumerate(parts):
        rest = np.concatenate([each for k, each in enumerate(parts) if k != i])
        factors, _ = solve(rest.sum(axis=0))
        for own, name, products in zip(factors, AXES, part.sum(axis=0), strict=True):
            measured = products[3, 3]
            quality = 1.0 - own @ products @ own / measured if measured > EXCITED else -np.inf
            found[name] = min(found[name], quality if np.isfinite(quality) else -np.inf)
    return found
