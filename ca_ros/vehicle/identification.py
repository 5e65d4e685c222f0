"""Identification: lag, delay, inertia and thrust of a vehicle from recorded flights."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtrit

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.flight_fit import (
    AXES,
    BLOCK,
    FlightSides,
    Products,
    best_lag,
    fitted,
    refine,
    unseen,
)
from ca_ros.vehicle.formats.recording import Recording
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

BLOCKS_MIN = 6  # fewer of them give no interval
RESAMPLES = 200
SURE_WIDTH, SURE_R2 = 0.1, 0.5  # half width of the interval over the value, R^2 on unseen parts

WRONG_SIGN = 'wrong sign: check order and spins of rotors, and frame'

FIRST_GUESS = 'expected a first guess, such as that of a disc of the same mass and size'


@dataclass(frozen=True)
class Estimate:
    """An identified number.

    - `value`, and the ends `low` and `high` of its interval of 95 %
    - `unit`
    - `r2`: the least R^2 on parts that were not used for the fit; -inf if one has no motion
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
    - `parameters`: what is sure, by name, as values of a parameter file; nothing if a sign is
      wrong
    - `left`: why other parameters stay as they are, by name
    """

    lag: Estimate
    delay: Estimate
    total: Estimate
    effectiveness: dict[str, Estimate]
    kick: Estimate
    noise: float
    parameters: dict[str, object]
    left: dict[str, str]

    @property
    def wrong_signs(self) -> list[str]:
        """The axes about which the vehicle moves against the file, surely."""
        return [name for name, each in self.effectiveness.items() if each.fault == WRONG_SIGN]


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
    bootstrap of blocks of 2 s, and are wider where these are few; R^2 is that of blocks, or of
    flights if there are several, that were not used for the fit.

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
        If the vehicle has no inertia, its rotors tilt, the flights are too short, or times or
        speeds are far from seconds and rad/s.
    """
    inertia_of(vehicle, FIRST_GUESS)
    flights = [FlightSides(vehicle, each, measured) for each in recordings]
    if (blocks := sum(flight.blocks for flight in flights)) < BLOCKS_MIN:
        raise ParameterError(
            f'{blocks} blocks of {BLOCK:g} s of flight: expected {BLOCKS_MIN} or more')
    first = best_lag(flights)
    refine(flights, *first)
    best = best_lag(flights, first)
    table = Products.of(flights, best)
    r2 = unseen(flights, best)
    names = [name for i, name in enumerate(AXES) if table.measures(i)]
    factors, _ = fitted(flights, *best)
    values = np.array([*best, sum(best), *factors[:, 0], factors[2, 1]])
    low, high = values + _deviations(table, seed)
    low[:3] = np.maximum(low[:3], 0.0)
    shown = [r2[name] for name in names if name in ('roll', 'pitch')]
    common = max(shown, default=-np.inf)

    def estimate(i: int, unit: str, quality: float, scale: float = 0.0) -> Estimate:
        half, size = (high[i] - low[i]) / 2.0, max(abs(values[i]), scale)
        fault = ''
        if quality < SURE_R2:
            fault = f'R^2 of {quality:.2f} on unseen parts'
            if quality == -np.inf:
                fault = 'a part of the flight does not show it'
        elif half > SURE_WIDTH * size:
            fault = f'interval of +-{100.0 * half / size:.0f} %'
        return Estimate(float(values[i]), float(low[i]), float(high[i]), unit, quality, fault)

    effectiveness = {}
    for name in names:
        i = 3 + AXES.index(name)
        found = estimate(i, '', r2[name])
        if found.value <= 0.0 and not found.fault:
            found = replace(found, fault=WRONG_SIGN)
        effectiveness[name] = found
    identified = Identification(
        lag=estimate(0, 's', common, 0.02), delay=estimate(1, 's', common, 0.02),
        total=estimate(2, 's', common, 0.02), effectiveness=effectiveness,
        kick=estimate(7, '', r2['yaw']),
        noise=float(np.median([flight.noise for flight in flights])), parameters={}, left={},
    )
    return _with_parameters(identified, vehicle)


def _deviations(table: Products, seed: int) -> Array:
    """Return the ends (2, 8) of the intervals of 95 %, less the values.

    Lag, delay and their sum, the ratios of the axes, and that of the kick.  Quantiles of a
    bootstrap are too near to the middle if there are few blocks: they are moved out as Student's
    distribution is wider than the normal one.
    """
    rng, count = np.random.default_rng(seed), table.count

    def numbers(blocks: NDArray[np.integer]) -> Array:
        lag, delay, ratios = table.fit(blocks)
        return np.array([lag, delay, lag + delay, *ratios])

    samples = [numbers(draw) for draw in rng.integers(count, size=(RESAMPLES, count))]
    wider = stdtrit(count - 1, 0.975) / ndtri(0.975) * np.sqrt(count / (count - 1))
    ends = np.percentile(samples, [2.5, 97.5], axis=0)
    return np.asarray(wider * (ends - numbers(np.arange(count))))


def _with_parameters(found: Identification, vehicle: Vehicle) -> Identification:
    """Return the identification with the parameters that are sure, and why others are not."""
    effectiveness = dict(found.effectiveness)
    rotors = 'rotors.thrust_coefficient', 'rotors.torque_coefficient'
    inertia = {
        f'vehicle.inertia about {axis}': name for axis, name in zip('xyz', AXES[:3], strict=True)
    }
    times = {'detector.motor_time_constant': found.lag, 'detector.delay': found.delay}
    noise = 'detector.angular_velocity_noise'
    if found.wrong_signs:
        why = f'wrong sign: {", ".join(found.wrong_signs)}'
        return replace(found, left=dict.fromkeys([*rotors, *inertia, *times, noise], why))
    given: dict[str, object] = {}
    left: dict[str, str] = {}
    sure = {name: each.value for name, each in effectiveness.items() if not each.fault}
    thrust = sure.get('thrust', 1.0)
    for name, value in zip(
        rotors, (vehicle.thrust_coefficient, vehicle.torque_coefficient), strict=True
    ):
        if 'thrust' in sure:
            given[name] = _rounded(value * thrust)
        else:
            left[name] = _fault(effectiveness, 'thrust', 'no accelerometer')
    before = np.diag(inertia_of(vehicle))
    ratios = np.array([thrust / sure[name] if name in sure else 1.0 for name in AXES[:3]])
    if 'yaw' in sure and not _is_body(before * ratios):
        what = f'no body has the principal moments {_rounded(before * ratios)}'
        fault = f'{what}: rotors.torque_coefficient may be wrong'
        effectiveness['yaw'] = replace(effectiveness['yaw'], fault=fault)
        del sure['yaw']
        ratios[2] = 1.0
    left |= {
        title: _fault(effectiveness, name, 'no motion')
        for title, name in inertia.items() if name not in sure
    }
    if moments := [title for title, name in inertia.items() if name in sure]:
        if _is_body(before * ratios):
            given['vehicle.inertia'] = _rounded(before * ratios)
        else:
            why = f'no body has the principal moments {_rounded(before * ratios)}'
            stay = ', '.join(title[-1] for title, name in inertia.items() if name not in sure)
            left |= dict.fromkeys(moments, f'{why}: correct the guess about {stay}')
    for name, each in times.items():
        if each.fault:
            left[name] = each.fault
        else:
            given[name] = _rounded(each.value)
    if {*AXES[:3]} & sure.keys():
        given[noise] = _rounded(found.noise)
    else:
        left[noise] = 'no ratio of the gyro is sure'
    return replace(found, effectiveness=effectiveness, parameters=given, left=left)


def _fault(effectiveness: dict[str, Estimate], name: str, absent: str) -> str:
    """Return why the ratio of an axis is not sure."""
    return f'{name}: {effectiveness[name].fault}' if name in effectiveness else absent


def _is_body(moments: ArrayLike) -> bool:
    """Return whether a body can have the principal moments (3,) [kg m^2]."""
    return bool(2.0 * np.max(moments) <= np.sum(moments))


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
