"""Whether the streams of a recorded flight can be true: their units, frames and gaps.

Streams that say the same by the laws of motion are compared over short windows in the air.
Where they differ by more than a tolerance, and another reading leaves less than 1 / `CLEARLY` of
it, the recording is refused.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.formats.recording import G, Recording, other_frame
from ca_ros.vehicle.state import GAP
from ca_ros.vehicle.vehicle import Vehicle

MOST = 0.8  # quantile of the differences that counts: most of a flight is hover
LONGEST = 86400.0  # of a flight [s]
CLEARLY = 2.0  # ratio of the differences of two readings
FORCE_WINDOW = 0.5  # in which specific forces are compared [s]
FORCE_OFF = 5.0  # how far a specific force in the right unit may be off [m/s^2]
IN_AIR = 0.5  # least thrust in the air, over the weight
WINDOWS_MIN = 6  # in the air; of fewer nothing is said
RATE = 25.0  # values of a stream below which half of the losses are not named [1/s]
MANY = 0.75  # share of the commands beyond the greatest speed that a controller hardly sends
ROUNDING = 1e-6  # of a number in a file
FROZEN = 1.0  # time for which no stream in the air has the same value [s]
STEPS = 100  # in which the gyro is integrated over a window

Readings = Mapping[str, Callable[[Recording], Recording]]


def _turned(attitude: Array, vectors: Array) -> Array:
    """Return vectors (K, 3) turned by quaternions (K, 4), whose length counts for nothing."""
    unit = attitude / np.linalg.norm(attitude, axis=1, keepdims=True)
    twice = 2.0 * np.cross(unit[:, :3], vectors)
    return np.asarray(vectors + unit[:, 3:] * twice + np.cross(unit[:, :3], twice))


def _inverse(attitude: Array) -> Array:
    return attitude * [-1.0, -1.0, -1.0, 1.0]


def _at(times: Array, recording: Recording, name: str) -> Array:
    """Return a stream at some times, interpolated."""
    values = recording.values[name]
    if name == 'attitude':
        # A quaternion and its opposite are the same.
        flips = np.sign((values[1:] * values[:-1]).sum(axis=1) + 1e-12)
        values = values * np.cumprod([1.0, *flips])[:, None]
    return _interpolated(times, recording.times[name], values)


def _interpolated(times: Array, known: Array, values: Array) -> Array:
    return np.column_stack([np.interp(times, known, column) for column in values.T])


def _mean(edges: Array, times: Array, values: Array) -> Array:
    """Return the means of values (K, c) between edges."""
    steps = np.diff(times)[:, None] * (values[1:] + values[:-1]) / 2.0
    sums = np.vstack([np.zeros(values.shape[1]), steps.cumsum(axis=0)])
    return np.diff(_interpolated(edges, times, sums), axis=0) / np.diff(edges)[:, None]


def _turn_rate(recording: Recording, edges: Array, flies: Array, gravity: float) -> Array:
    """Return the turn rate that the attitude has, less that of the gyro."""
    attitude = _at(edges, recording, 'attitude')
    (u, w), (v, s) = ((each[:, :3], each[:, 3:]) for each in (attitude[:-1], attitude[1:]))
    half, cosine = w * v - s * u - np.cross(u, v), w * s + (u * v).sum(axis=1, keepdims=True)
    sine = np.linalg.norm(half, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, abs(cosine)) * np.sign(cosine)
    rate = half * angle / np.maximum(sine, 1e-12) / np.diff(edges)[:, None]
    rate = rate - _mean(edges, recording.times['gyro'], recording.values['gyro'])
    return np.asarray(rate[flies])


def _force(recording: Recording, edges: Array) -> Array:
    """Return the mean specific force, in the world frame if there is an attitude."""
    times, force = recording.times['acc'], recording.values['acc']
    if 'attitude' in recording.values:
        force = _turned(_at(times, recording, 'attitude'), force)
    return _mean(edges, times, force)


def _less_weight(recording: Recording, edges: Array, flies: Array, gravity: float) -> Array:
    """Return the mean specific force, less the weight's."""
    return np.asarray(_force(recording, edges)[flies] - [0.0, 0.0, gravity])


def _carried(recording: Recording, edges: Array, flies: Array, gravity: float) -> Array:
    """Return how far the mean specific force is from gravity, in a frame that the gyro keeps.

    No velocity grows for long, so that they are nearly equal; a gyro that turns too far averages
    the force out.
    """
    # Here, since the import takes half a second, and the monitor needs other things of this file.
    from scipy.spatial.transform import Rotation

    fine = np.linspace(edges[0], edges[-1], STEPS * (len(edges) - 1) + 1)
    parts = len(edges) - 1, STEPS, 3
    rates, forces = (
        _mean(fine, recording.times[name], recording.values[name]).reshape(parts)[flies]
        for name in ('gyro', 'acc'))
    turn, sums = Rotation.identity(len(rates)), np.zeros((len(rates), 3))
    for k in range(STEPS):
        turn = turn * Rotation.from_rotvec(rates[:, k] * (fine[1] - fine[0]))
        sums += turn.apply(forces[:, k])
    return np.asarray(np.linalg.norm(sums / STEPS, axis=1, keepdims=True) - gravity)


def _acceleration(recording: Recording, edges: Array, flies: Array, gravity: float) -> Array:
    """Return the acceleration that the velocity has, less the force's, a drag and a constant.

    The drag goes with the velocity; that and the constant are those that leave the least.
    """
    attitude, velocity = (_at(edges, recording, name) for name in ('attitude', 'velocity'))
    world = _turned(attitude, velocity)
    gained = np.diff(world, axis=0) / np.diff(edges)[:, None] - _force(recording, edges)
    gained, mean = gained[flies], (world[1:] + world[:-1])[flies]
    causes = np.column_stack([mean.ravel(), np.tile(np.eye(3), (len(mean), 1))])
    fit = np.linalg.lstsq(causes, gained.ravel(), rcond=None)[0]
    return np.asarray(gained - (causes @ fit).reshape(gained.shape))


def _scaled(name: str, factor: float) -> Callable[[Recording], Recording]:
    return lambda recording: recording.with_stream(name, factor * recording.values[name])


def _from_world(recording: Recording) -> Recording:
    attitude = _at(recording.times['velocity'], recording, 'attitude')
    return recording.with_stream(
        'velocity', _turned(_inverse(attitude), recording.values['velocity']))


READINGS: Mapping[str, tuple[str, Readings, Readings]] = {
    'gyro': ('rad/s', {'deg/s': _scaled('gyro', np.pi / 180.0)}, {}),
    'velocity': (
        'm/s in the body frame', {'mm/s': _scaled('velocity', 1e-3)},
        {'of the world frame': _from_world}),
    'acc': (
        'the specific force [m/s^2], up in hover', {'g': _scaled('acc', G)},
        {'of the other --frame': other_frame}),
    'attitude': ('x, y, z, w, body to world', {}, {
        'w, x, y, z': lambda recording: recording.with_stream(
            'attitude', np.roll(recording.values['attitude'], -1, axis=1)),
        'world to body': lambda recording: recording.with_stream(
            'attitude', _inverse(recording.values['attitude']))}),
}
"""What is expected of a stream, and by mistake sometimes another unit, and another frame."""

CHECKS = (
    (('gyro', 'attitude'), _turn_rate, 0.25, 'rad/s', (1.0, 0.15)),
    (('acc',), _less_weight, FORCE_WINDOW, 'm/s^2', (FORCE_OFF, FORCE_OFF)),
    (('gyro',), _carried, 2.0, 'm/s^2', (3.0, 3.0)),
    (('gyro',), _carried, 1.0, 'm/s^2', (3.0, 3.0)),
    (('velocity', 'attitude'), _acceleration, 0.5, 'm/s^2', (3.0, 0.15)),
)
"""Streams of which one may be wrong, a difference that is zero if they are right, the length of
the windows [s], and its tolerances, for units and for frames."""


def check(vehicle: Vehicle, recording: Recording, source: str = 'command') -> list[str]:
    """Return in words which streams contradict the others.

    Raises a ParameterError that names the stream if its unit or frame cannot be right.

    Or if rotors tilt, since a recording has no angles of them.

    - `source`: the stream of rotor speeds [rad/s]
    """
    if len(vehicle.servos):
        raise ParameterError(
            'rotors.tilt_axes: a recorded flight has no tilt angles: expected rotors that do not '
            'tilt')
    times, speeds = recording.times[source], recording.values[source]
    thrusts = vehicle.thrusts(speeds)
    lift, notes = thrusts.sum(axis=1), dict[str, str]()

    def difference(read: Recording, found: Callable[..., Array], edges: Array) -> float:
        if 'acc' not in read.values:
            force = thrusts @ vehicle.wrenches[:3].T / vehicle.mass
            read = replace(read, times={**read.times, 'acc': times},
                           values={**read.values, 'acc': force})
        each = found(read, edges, flies, vehicle.gravity)
        return float(np.quantile(np.linalg.norm(each, axis=1), MOST))

    for names, found, window, unit, tolerances in CHECKS:
        if not set(names) <= recording.values.keys():
            continue
        used = [recording.times[name] for name in (*names, 'acc') if name in recording.values]
        used.append(times)
        start, end = max(each[0] for each in used), min(each[-1] for each in used)
        if end - start > LONGEST:
            raise ParameterError(
                f'{recording.name}: times from {start:g} to {end:g} s: expected one flight, of a '
                'day at most; was its clock set meanwhile?')
        edges = np.arange(start, end, window)
        flies = np.interp(edges[1:], times, lift) >= IN_AIR * vehicle.weight
        for each in used:
            flies &= np.diff(np.searchsorted(each, edges)) > 0
        if flies.sum() < WINDOWS_MIN:
            continue
        given = difference(recording, found, edges)
        for name in [each for each in (*names, 'attitude') if each in recording.values]:
            expected, *readings = READINGS[name]
            for tolerance, others in zip(tolerances, readings, strict=True):
                for words, read in others.items():
                    least = difference(read(recording), found, edges)
                    if given > max(tolerance, CLEARLY * least):
                        raise ParameterError(
                            f'{recording.name}: {name}: {given:.3g} {unit} away from what the '
                            f'other streams say; read as {words} {least:.3g}: expected {expected}')
        if given > CLEARLY * tolerances[0]:
            notes.setdefault(
                names[0], f'{names[0]}: {given:.3g} {unit} away from what the other streams say')
    return list(notes.values())


def gaps(recording: Recording, names: Iterable[str]) -> list[tuple[str, float, float]]:
    """Return streams that have no value for `GAP` or more, and from when to when [s].

    A recording lasts as long as its command or its gyro.
    """
    own = [recording.times[name] for name in ('command', 'gyro')]
    start, end = min(each[0] for each in own), max(each[-1] for each in own)
    found: dict[tuple[float, float], list[str]] = {}
    for name in names:
        times = recording.times[name]
        edges = np.array([start, *times[(times > start) & (times < end)], end])
        for i in np.flatnonzero(np.diff(edges) >= GAP / 1e9):
            found.setdefault((float(edges[i]), float(edges[i + 1])), []).append(name)
    return [(', '.join(streams), *when) for when, streams in sorted(found.items())]


def frozen(
    vehicle: Vehicle, recording: Recording, names: Iterable[str], source: str = 'command'
) -> list[str]:
    """Return in words which streams do not change for `FROZEN` or more, and from when on.

    In the air by the stream `source`, which are rotor speeds [rad/s].
    """
    lift = vehicle.thrusts(recording.values[source]).sum(axis=1)
    start, notes = recording.span[0], []
    for name in names:
        times, values = recording.times[name], recording.values[name]
        flies = np.interp(times, recording.times[source], lift) >= IN_AIR * vehicle.weight
        same = (values[1:] == values[:-1]).all(axis=1) & flies[1:] & flies[:-1]
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same, [0]])))
        begin, lasting = times[edges[::2]], times[edges[1::2]] - times[edges[::2]]
        if (long := lasting >= FROZEN).any():
            notes.append(
                f'{name}: does not change from {begin[long][0] - start:.2f} s on, and for '
                f'{lasting[long].sum():.2f} s in all')
    return notes


def slow(recording: Recording, names: Iterable[str]) -> list[str]:
    """Return in words which of the streams that show a loss have few values a second.

    Raises a ParameterError if a stream has none for `GAP` or more in the median.
    """
    rates = {name: 1.0 / float(np.median(np.diff(recording.times[name]))) for name in names}
    for name, rate in rates.items():
        if rate * GAP <= 1e9:
            raise ParameterError(
                f'{recording.name}: {name}: {rate:.2g} values a second: expected {RATE:g}')
    shows = 'gyro', 'acc' if 'acc' in rates else 'velocity', 'command'
    return [f'{name}: {rates[name]:.2g} values a second: below {RATE:g} a loss may not be named'
            for name in shows if rates.get(name, RATE) < RATE]


def clipped(vehicle: Vehicle, recording: Recording) -> list[str]:
    """Return in words how many commands are beyond the greatest speed, and for how long.

    Raises a ParameterError if `MANY` of those that turn a rotor are.
    """
    most = np.maximum(abs(vehicle.speed_min), abs(vehicle.speed_max))
    times, commands = recording.times['command'], np.abs(recording.values['command'])
    beyond = commands > most * (1.0 + ROUNDING)
    count, turning = int(beyond.sum()), int((commands > 0.0).sum())
    if count > MANY * turning:
        raise ParameterError(
            f'{recording.name}: command: {count} of {turning} are beyond rotors.speed_max, up to '
            f'{commands.max():.4g}: expected rad/s; if these are rpm, multiply them by 2 pi / 60')
    lasting = float(np.diff(times)[beyond[:-1].any(axis=1)].sum())
    return [f'command: {count} of {turning} are beyond rotors.speed_max and taken as it, in '
            f'{lasting:.2f} s'] * (count > 0)
