"""Identification: lag, delay, inertia and thrust of a vehicle from recorded flights."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize
from scipy.signal import butter, lfilter, sosfilt

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

HIGH_PASS = 1.5  # corner of the filter of both sides of the fit [Hz]
SMOOTH = 25.0  # corner of the low-pass of both sides, at most a quarter of the sampling rate [Hz]
LAG_MAX, DELAY_MAX = 0.3, 0.15  # greatest lag and delay that are tried [s]
GRID = 9  # values of lag and of delay from which the search begins
BLOCK = 2.0  # length of the blocks of the bootstrap and of cross-validation [s]
BLOCKS_MIN = 6  # fewer of them give no interval
RESAMPLES = 200
NEAR = 5  # lags and delays about the best, from which each resample chooses
SURE_WIDTH, SURE_R2 = 0.1, 0.5  # half width of the interval over the value, R^2 on unseen parts
EXCITED = 1e-6  # least variance of a side of the fit

AXES = 'roll', 'pitch', 'yaw', 'thrust'

FIRST_GUESS = 'expected a first guess, such as that of a disc of the same mass and size'


@dataclass(frozen=True)
class Estimate:
    """An identified number.

    - `value`, and the ends `low` and `high` of its interval of 95 %
    - `unit`
    - `r2`: the least R^2 on parts that were not used for the fit
    - `fault`: why it is not sure; empty if it is
    """

    value: float
    low: float
    high: float
    unit: str
    r2: float
    fault: str = ''

    def __str__(self) -> str:
        """Return the value with its interval, and the fault."""
        text = f'{self.value:.4g} [{self.low:.4g}, {self.high:.4g}] {self.unit}'.rstrip()
        return f'{text}: {self.fault}' if self.fault else text


@dataclass(frozen=True, eq=False)
class Identification:
    """What recorded flights tell of a vehicle.

    - `lag` and `delay`: of the rotors [s], and their sum `total`
    - `effectiveness`: angular acceleration about x, y, z, and acceleration along z, over those of
      the vehicle's file, by the names of `AXES`; thrust is missing without an accelerometer
    - `kick`: inertia of a rotor over that of the vehicle about z
    - `noise`: standard deviation of the white noise of the gyro [rad/s]
    - `parameters`: what is sure, by name, as values of a parameter file
    """

    lag: Estimate
    delay: Estimate
    total: Estimate
    effectiveness: dict[str, Estimate]
    kick: Estimate
    noise: float
    parameters: dict[str, object]


def identify(
    vehicle: Vehicle, recordings: Sequence[Recording], measured: bool = False, seed: int = 0
) -> Identification:
    """Identify a vehicle from recorded flights.

    The rotors follow their commands after a delay, with a first-order lag of their speed.  The
    thrusts then give angular accelerations by the vehicle's arms and inertia, and an acceleration
    along z by its mass.  The ratio between the accelerations in the flight and these is fitted by
    least squares for each axis, after both sides went through the same band-pass filter: without
    the high-pass, the controller's own slow reactions to disturbances bias the fit.  Lag and delay
    are those of the least error over all axes, weighted by their noise.  Intervals come from a
    bootstrap of blocks of 2 s; R^2 is that of blocks, or of flights if there are several, that
    were not used for the fit.

    Parameters
    ----------
    vehicle : Vehicle
        With mass, inertia and rotors as they are known; the inertia may be wrong by far.
    recordings : sequence of Recording
        Commands are rotor speeds [rad/s], see `speeds_of`.
    measured : bool
        Use the measured rotor speeds instead of the commands; lag and delay are then those of the
        measurement.
    seed : int
        Of the bootstrap.

    Returns
    -------
    Identification

    Raises
    ------
    ParameterError
        If the vehicle has no inertia, its rotors tilt, or the flights are too short.
    """
    inertia_of(vehicle, FIRST_GUESS)
    if vehicle.tilts is not None:
        raise ParameterError('rotors.tilt_axes: rotors that tilt cannot be identified')
    flights = [_Flight(vehicle, each, measured) for each in recordings]
    if (blocks := sum(flight.blocks for flight in flights)) < BLOCKS_MIN:
        what = f'expected {BLOCKS_MIN} or more'
        raise ParameterError(f'{blocks} blocks of {BLOCK:g} s of flight: {what}')
    best = _search(flights)
    table = _Sums.of(flights, best)
    rng = np.random.default_rng(seed)
    draws = rng.integers(table.count, size=(RESAMPLES, table.count))
    drawn = [table.fit(blocks) for blocks in draws]
    whole = table.fit(np.arange(table.count))
    r2 = _unseen(flights, best)
    names = [name for i, name in enumerate(AXES) if table.measures(i)]
    samples = np.array([[lag, delay, lag + delay, *ratios] for lag, delay, ratios in drawn])
    lag, delay, ratios = whole
    values = np.array([lag, delay, lag + delay, *ratios])
    low, high = np.percentile(samples, [2.5, 97.5], axis=0)
    shown = [r2[name] for name in names if name in ('roll', 'pitch')]
    common = max(shown, default=-np.inf)

    def made(i: int, unit: str, quality: float, scale: float = 0.0) -> Estimate:
        half, size = (high[i] - low[i]) / 2.0, max(abs(values[i]), scale)
        fault = ''
        if quality < SURE_R2:
            fault = f'R^2 of {quality:.2f} on unseen parts'
        elif half > SURE_WIDTH * size:
            fault = f'interval of +-{100.0 * half / size:.0f} %'
        return Estimate(float(values[i]), float(low[i]), float(high[i]), unit, quality, fault)

    effectiveness = {}
    for name in names:
        i = 3 + AXES.index(name)
        found = made(i, '', r2[name])
        if found.value <= 0.0 and not found.fault:
            found = replace(found, fault='wrong sign: check order and spins of rotors, and frame')
        effectiveness[name] = found
    identified = Identification(
        lag=made(0, 's', common, 0.02), delay=made(1, 's', common, 0.02),
        total=made(2, 's', common, 0.02), effectiveness=effectiveness, kick=made(7, '', r2['yaw']),
        noise=float(np.median([flight.noise for flight in flights])), parameters={},
    )
    return _with_parameters(identified, vehicle)


def _with_parameters(found: Identification, vehicle: Vehicle) -> Identification:
    """Return the identification with the parameters that are sure."""
    given: dict[str, object] = {}
    sure = {name: each for name, each in found.effectiveness.items() if not each.fault}
    thrust = sure['thrust'].value if 'thrust' in sure else 1.0
    if 'thrust' in sure:
        given['rotors.thrust_coefficient'] = _rounded(vehicle.thrust_coefficient * thrust)
        given['rotors.torque_coefficient'] = _rounded(vehicle.torque_coefficient * thrust)
    moments = np.diag(inertia_of(vehicle)).copy()
    torques = [i for i, name in enumerate(AXES[:3]) if name in sure]
    for i in torques:
        moments[i] *= thrust / sure[AXES[i]].value
    effectiveness = dict(found.effectiveness)
    if 2 in torques and 2.0 * moments.max() > moments.sum():
        what = f'no body has the principal moments {_rounded(moments)}'
        fault = f'{what}: rotors.torque_coefficient may be wrong'
        effectiveness['yaw'] = replace(sure['yaw'], fault=fault)
        moments[2] = inertia_of(vehicle)[2, 2]
        torques.remove(2)
    if torques and 2.0 * moments.max() <= moments.sum():
        given['vehicle.inertia'] = _rounded(moments)
    if not found.lag.fault:
        given['detector.motor_time_constant'] = _rounded(found.lag.value)
    if not found.delay.fault:
        given['detector.delay'] = _rounded(found.delay.value)
    given['detector.angular_velocity_noise'] = _rounded(found.noise)
    return replace(found, effectiveness=effectiveness, parameters=given)


def _rounded(value: ArrayLike) -> object:
    """Return numbers with five digits; equal ones once."""
    numbers = [float(f'{each:.5g}') for each in np.ravel(value)]
    return numbers[0] if len({*numbers}) == 1 and len(numbers) != 3 else numbers


def speeds_of(vehicle: Vehicle, recording: Recording, law: str | None) -> Recording:
    """Return a recording whose commands, given as throttles from 0 to 1, are rotor speeds [rad/s].

    `law`: ``linear`` if the thrust is linear in the throttle, ``quadratic`` if the speed is,
    ``curve`` for the vehicle's thrust curve; None: the commands are speeds already.

    Raises a ParameterError if a command is not between 0 and 1, or speeds are all below 1 rad/s.
    """
    commands = recording.values['command']
    if law is None:
        if commands.max() <= 1.0:
            raise ParameterError(
                f'{recording.name}: commands up to {commands.max():g}: expected rotor speeds '
                '[rad/s], or --throttle for throttles from 0 to 1'
            )
        return recording
    if commands.min() < 0.0 or commands.max() > 1.0:
        raise ParameterError(
            f'{recording.name}: commands from {commands.min():g} to {commands.max():g}: expected '
            'throttles from 0 to 1'
        )
    if law == 'curve':
        speeds = np.linspace(0.0, 1.0, 501)[:, None] * vehicle.speed_max
        throttles = np.asarray(vehicle.throttles(speeds))
        found = np.column_stack([
            np.interp(command, own, turning)
            for command, own, turning in zip(commands.T, throttles.T, speeds.T, strict=True)
        ])
    else:
        found = (np.sqrt(commands) if law == 'linear' else commands) * vehicle.speed_max
    return recording.with_stream('command', found)


class _Flight:
    """A recording on one clock, and its filtered sides of the fit for a lag and a delay."""

    def __init__(self, vehicle: Vehicle, recording: Recording, measured: bool) -> None:
        self.vehicle, self._inertia = vehicle, inertia_of(vehicle)
        source = 'speed' if measured else 'command'
        if source not in recording.values:
            raise ParameterError(f'{recording.name}: no measured rotor speeds')
        times = recording.times['gyro']
        self.step = float(np.median(np.diff(times)))
        start, end = recording.span
        self.time = np.arange(start, end, self.step)
        self.blocks = int(len(self.time) * self.step / BLOCK)
        self._commands = recording.times[source], recording.values[source]
        gyro = recording.values['gyro']
        # The second difference of white noise has six times its variance.
        self.noise = float(np.sqrt(np.median(np.diff(gyro, 2, axis=0) ** 2) / 0.4549 / 6.0))
        self.gyro = _sampled(self.time, times, gyro)
        self.up = None
        if 'acc' in recording.values:
            self.up = _sampled(self.time, recording.times['acc'], recording.values['acc'])[:, 2]
        rate = 1.0 / self.step
        band = [HIGH_PASS, min(SMOOTH, rate / 4.0)]
        self._filter = butter(2, band, 'bandpass', fs=rate, output='sos')
        self.wrenches, self.inverse = rotor_wrenches(vehicle), np.linalg.inv(self._inertia)
        # The filters have forgotten their start after this.
        self.begin = min(int(1.0 / self.step), len(self.time) // 4)
        self.sides = self._filtered(self.gyro), None if self.up is None else (
            self._filtered(self.up))

    def _filtered(self, values: Array) -> Array:
        return sosfilt(self._filter, values - values[:1], axis=0)[self.begin :]

    def models(self, lag: float, delay: float) -> tuple[Array, Array, Array]:
        """Return the filtered rates (K, 3), those of the rotors' kick (K,), acceleration (K,)."""
        times, commands = self._commands
        at = np.searchsorted(times, self.time - delay, side='right') - 1
        speeds = commands[np.maximum(at, 0)]
        if lag > 0.0:
            share = 1.0 - np.exp(-self.step / lag)
            start = (1.0 - share) * speeds[:1]
            speeds = lfilter([share], [1.0, share - 1.0], speeds, axis=0, zi=start)[0]
        wrench = self.vehicle.thrusts(speeds) @ self.wrenches.T
        torque = wrench[:, 3:] - np.cross(self.gyro, self.gyro @ self._inertia)
        # The mean torque is that of a centre of mass beside the rotors' centre: the filter takes
        # it away, but integrated it would overflow the filter's precision.
        torque = torque - torque.mean(axis=0)
        rates = cumulative_trapezoid(torque @ self.inverse.T, dx=self.step, axis=0, initial=0.0)
        kick = speeds @ self.vehicle.spins
        return (
            self._filtered(rates), self._filtered(kick),
            self._filtered(wrench[:, 2] / self.vehicle.mass),
        )

    def products(self, lag: float, delay: float) -> Array:
        """Return sums over each block of products of the sides, (blocks, 4 axes, 6).

        For regressors a and b and the measured side y: aa, ab, bb, ay, by, yy.
        """
        rates, kick, up = self.models(lag, delay)
        measured, measured_up = self.sides
        none = np.zeros(len(rates))
        pairs = [(rates[:, i], kick if i == 2 else none, measured[:, i]) for i in range(3)]
        pairs.append((up, none, none if measured_up is None else measured_up))
        length = max(1, round(BLOCK / self.step))
        starts = np.arange(0, len(none) - length + 1, length)
        rows = [[a * a, a * b, b * b, a * y, b * y, y * y] for a, b, y in pairs]
        sums = np.add.reduceat(np.array(rows), starts, axis=2)
        # reduceat's last sum runs to the end, beyond its block.
        sums[:, :, -1] = np.array(rows)[:, :, starts[-1] : starts[-1] + length].sum(axis=2)
        return np.moveaxis(sums, 2, 0)


def _sampled(time: Array, times: Array, values: Array) -> Array:
    """Return values (K, c) of a stream at some times, interpolated."""
    return np.column_stack([np.interp(time, times, column) for column in values.T])


def _solve(sums: Array) -> tuple[Array, float]:
    """Return the ratios (5,) of products (4, 6): of the axes, and of the kick; and the error.

    The error is the sum of the logarithms of the axes' residual variances.
    """
    ratios, error = np.zeros(5), 0.0
    for i, (aa, ab, bb, ay, by, yy) in enumerate(sums):
        if yy <= EXCITED or aa <= EXCITED:
            ratios[i] = np.nan
            continue
        if i == 2 and bb > EXCITED:
            ratios[2], ratios[4] = np.linalg.lstsq([[aa, ab], [ab, bb]], [ay, by], rcond=None)[0]
        else:
            ratios[i] = ay / aa
        kick = ratios[4] if i == 2 else 0.0
        left = yy - ratios[i] * ay - kick * by
        error += np.log(max(left, 1e-12 * yy) / yy)
    return ratios, error


def _search(flights: Sequence[_Flight]) -> tuple[float, float]:
    """Return the lag and delay of the least error [s]."""
    def error(point: Sequence[float]) -> float:
        lag, delay = point
        if not (0.0 <= lag <= LAG_MAX and 0.0 <= delay <= DELAY_MAX):
            return np.inf
        sums = sum(flight.products(lag, delay).sum(axis=0) for flight in flights)
        return _solve(np.asarray(sums))[1]

    lags = LAG_MAX * np.linspace(0.0, 1.0, GRID) ** 2
    delays = DELAY_MAX * np.linspace(0.0, 1.0, GRID) ** 2
    first = min(((lag, delay) for lag in lags for delay in delays), key=error)
    simplex = np.array([first, *(np.add(first, step) for step in ((0.01, 0.0), (0.0, 0.005)))])
    options = {'initial_simplex': simplex, 'xatol': 1e-4, 'fatol': 1e-6, 'maxfev': 80}
    lag, delay = minimize(error, first, method='Nelder-Mead', options=options).x.tolist()
    return lag, delay


class _Sums:
    """Products of blocks for lags and delays about the best, from which a resample chooses."""

    def __init__(self, points: Array, sums: Array) -> None:
        self.points, self.sums, self.count = points, sums, sums.shape[1]
        away = points - points[0]
        self._reach = np.maximum(np.abs(away).max(axis=0), 1e-9)
        self._scaled = away / self._reach
        self._ends = self._scaled.min(axis=0), self._scaled.max(axis=0)
        self._surface = np.linalg.pinv(_powers(self._scaled))

    @classmethod
    def of(cls, flights: Sequence[_Flight], best: tuple[float, float]) -> '_Sums':
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
        return bool(self.sums[0, :, axis, 5].sum() > EXCITED)

    def fit(self, blocks: NDArray[np.integer]) -> tuple[float, float, Array]:
        """Return the best lag, delay and ratios for some of the blocks.

        The error and the ratios are quadratic between the points.
        """
        found = [_solve(sums[blocks].sum(axis=0)) for sums in self.sums]
        errors = self._surface @ [error for _, error in found]
        ratios = self._surface @ np.array([ratios for ratios, _ in found])
        _, *slope, xx, xy, yy = errors
        bend = np.array([[2.0 * xx, xy], [xy, 2.0 * yy]])
        if np.linalg.eigvalsh(bend)[0] > 0.0:
            place = np.clip(np.linalg.solve(bend, np.negative(slope)), *self._ends)
        else:
            place = self._scaled[min(range(len(found)), key=lambda k: found[k][1])]
        lag, delay = self.points[0] + place * self._reach
        return lag, delay, _powers(place[None])[0] @ ratios


def _powers(places: Array) -> Array:
    """Return the monomials (k, 6) up to the second degree of places (k, 2)."""
    x, y = places.T
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])


def _unseen(flights: Sequence[_Flight], best: tuple[float, float]) -> dict[str, float]:
    """Return the least R^2 of each axis on flights, or blocks, that were not used for the fit."""
    parts = [flight.products(*best) for flight in flights]
    if len(parts) == 1:
        parts = [part for part in np.array_split(parts[0], 3) if len(part)]
    found = dict.fromkeys(AXES, np.inf)
    for i, part in enumerate(parts):
        rest = np.concatenate([each for k, each in enumerate(parts) if k != i])
        ratios, _ = _solve(rest.sum(axis=0))
        for axis, name in enumerate(AXES):
            aa, ab, bb, ay, by, yy = part[:, axis].sum(axis=0)
            a, b = ratios[axis], ratios[4] if axis == 2 else 0.0
            left = yy - 2.0 * (a * ay + b * by) + a * a * aa + 2.0 * a * b * ab + b * b * bb
            quality = 1.0 - left / yy if yy > EXCITED else -np.inf
            found[name] = min(found[name], quality if np.isfinite(quality) else -np.inf)
    return found
