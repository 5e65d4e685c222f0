"""The plant of `plant.c`: its structures, and a flight as a table of rows."""

import ctypes
import subprocess
from functools import lru_cache
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ca_ros import Exact
from ca_ros.arrays import Array
from ca_ros.errors import CaRosError
from ca_ros.vehicle.vehicle import Vehicle

SOURCE = Path(__file__).with_name('plant.c')
COMPILERS = ('cc', 'gcc', 'clang')
OPTIONS = ['-std=c99', '-O3', '-ffp-contract=off', '-fno-math-errno', '-fPIC', '-shared']

ROTORS = 8  # room for rotors, as in `plant.c`
PERIOD = 0.01  # between two states, but for the jitter [s]
STEP = 1.25e-3  # of the rigid body [s]
RADIUS = 0.15  # of a rotor [m]
FEET_ANGLE = np.pi / 4.0  # of the first of four feet, from the x axis [rad]
HEIGHT = 0.15  # of the body's origin above its feet [m]

ROW = np.dtype([
    ('time', 'i8'), ('attitude', 'f8', 4), ('velocity', 'f8', 3), ('rates', 'f8', 3),
    ('specific_force', 'f8', 3), ('command', 'f8', ROTORS), ('position', 'f8', 3),
    ('speeds', 'f8', ROTORS), ('wind', 'f8', 3), ('feet', 'f8'), ('mode', 'f8'),
    ('pushed', 'f8'), ('failed', 'f8'),
])
"""A row of a flight: struct row of `plant.c`."""

Rows = np.ndarray[Any, np.dtype[np.void]]
"""Rows (N,) of a flight."""

AIRBORNE, GROUNDED, CLIMBING, HOLDING, DESCENDING, SHUTTING = range(6)
"""Modes of the controller, in the column ``mode``."""

FAILURES = {'none': 0, 'loss': 1, 'fade': 2, 'stuck': 3}


def _structure(name: str, *fields: Any) -> Any:
    """Return a structure of doubles: a name, or a name with one or two sizes."""
    kinds: list[tuple[str, Any]] = []
    for field in fields:
        label, *sizes = [field] if isinstance(field, str) else field
        kind: Any = ctypes.c_double
        for size in reversed(sizes):
            kind = kind * size
        kinds.append((label, kind))
    return type(name, (ctypes.Structure,), {'_fields_': kinds})


Believed = _structure(
    'Believed', 'n', 'mass', 'gravity', ('inertia', 3), ('position', ROTORS, 3),
    ('spin', ROTORS), 'thrust', 'torque', 'slowest', 'fastest', 'radius', 'foot', 'height',
    ('inverse', ROTORS, 4))

Truth = _structure(
    'Truth', 'mass_factor', ('inertia_factor', 3), ('centre', 3), ('thrust_factor', ROTORS),
    ('torque_factor', ROTORS), ('lag', ROTORS), 'braking', 'delay', 'age', 'jitter', 'sag',
    'sag_rate', 'sag_load', 'flapping', 'hub_moment', 'inflow', 'wake', 'coaxial',
    'rotor_inertia', 'body_drag', ('pressure', 3), 'ground_effect', 'sink', 'damping', 'friction',
    ('uneven', 4), ('wind', 3), 'turbulence', 'payload', ('hook', 3), 'dropped', 'position_noise',
    'velocity_noise', 'attitude_noise', 'rate_noise', 'force_noise', ('force_bias', 3),
    ('imu', 3), 'vibration')

Mission = _structure(
    'Mission', 'speed', 'acceleration', 'tilt', 'ahead', 'stiffness', 'reach', 'low', 'high',
    'shortest', 'longest', 'turn', 'period', 'pushes', 'push', 'briefest',
    'lasting', 'failure', 'rotor', 'left', 'time')


def fill(structure: Any, **values: Any) -> Any:
    """Set fields of a structure: numbers, or arrays that fit or are shorter; return it."""
    for name, value in values.items():
        if np.ndim(value) == 0:
            setattr(structure, name, float(value))
        else:
            view = np.ctypeslib.as_array(getattr(structure, name))
            view[:len(value)] = value
    return structure


def believed(vehicle: Vehicle) -> Any:
    """Return what the plant's controller believes of a vehicle with equal, parallel rotors."""
    gamma = np.asarray(Exact(vehicle).problem.gamma)
    arms = np.asarray(vehicle.arms)
    thrust, torque = gamma[0], np.abs(gamma[3])
    equal = [vehicle.thrust_per_squared_speed, vehicle.speed_min, vehicle.speed_max]
    if len(vehicle.axes) != 4 or vehicle.n > ROTORS or not np.allclose(thrust, 1.0):
        raise CaRosError(f'the plant has room for {ROTORS} parallel rotors')
    k, slowest, fastest = (float(np.mean(each)) for each in equal)
    if any(np.ptp(each) > 1e-9 for each in equal) or np.ptp(torque) > 1e-9:
        raise CaRosError('the plant is for equal rotors')
    inertia = np.asarray(vehicle.inertia)
    reach = float(np.linalg.norm(arms[:, :2], axis=1).max())
    return fill(
        Believed(), n=vehicle.n, mass=vehicle.mass, gravity=vehicle.gravity,
        inertia=inertia if inertia.ndim == 1 else np.diag(inertia), position=arms,
        spin=np.sign(gamma[3]), thrust=k, torque=k * torque[0], slowest=slowest, fastest=fastest,
        radius=RADIUS, foot=max(0.6 * reach, 0.18), height=HEIGHT, inverse=np.linalg.pinv(gamma))


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Compile `plant.c` and load it; raise a CaRosError without a compiler."""
    compiler = next(filter(None, map(which, COMPILERS)), None)
    if compiler is None:
        raise CaRosError(f'the plant needs a C compiler: one of {", ".join(COMPILERS)}')
    with TemporaryDirectory() as folder:
        path = str(Path(folder) / 'plant.so')
        subprocess.run([compiler, *OPTIONS, '-o', path, str(SOURCE), '-lm'], check=True)
        loaded = ctypes.CDLL(path)
    loaded.plant_size.restype = ctypes.c_size_t
    loaded.plant_fly.restype = loaded.plant_send.restype = ctypes.c_long
    return loaded


class Plant:
    """One flight: `fly` with the controller's own allocation, or `sense` and `act` in turns.

    `state` (13,): position, velocity (world), quaternion x, y, z, w, angular velocity (body).
    """

    def __init__(
        self, vehicle: Any, truth: Any, mission: Any, seed: int, state: Array | None = None
    ) -> None:
        self._library = library()
        self._memory = ctypes.create_string_buffer(self._library.plant_size())
        if state is None:
            height = vehicle.height if mission.period else mission.low
            state = np.array([0, 0, height, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0], float)
        self._library.plant_start(
            self._memory, ctypes.byref(vehicle), ctypes.byref(truth), ctypes.byref(mission),
            ctypes.c_uint64(seed), np.ascontiguousarray(state, float).ctypes.data_as(
                ctypes.c_void_p))
        self._row, self._wrench = np.zeros(1, ROW), np.zeros(4)
        self._pointers = [
            each.ctypes.data_as(ctypes.c_void_p) for each in (self._row, self._wrench)]

    def fly(self, duration: float) -> Rows:
        """Return the rows (N,) of a flight of a duration [s]; fewer if the vehicle turns over."""
        rows = np.zeros(round(duration / PERIOD), ROW)
        count = self._library.plant_fly(
            self._memory, rows.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(len(rows)))
        return rows[:count]

    def sense(self) -> tuple[Any, Array]:
        """Return a row without its command, and the wrench (4,) that the controller wants."""
        self._library.plant_sense(self._memory, *self._pointers)
        return self._row[0].copy(), self._wrench.copy()

    def act(self, command: Array) -> None:
        """Send speeds (n,) [rad/s], and move until the next state."""
        self._library.plant_act(self._memory, self._padded(command))

    def drift(self, command: Array, count: int) -> None:
        """Move by `count` steps of the rigid body at commanded speeds (n,) alone."""
        self._library.plant_drift(self._memory, self._padded(command), ctypes.c_long(count))

    @property
    def state(self) -> tuple[Array, Array]:
        """The true state (13,), and the speeds of the rotors [rad/s]."""
        state, speeds = np.zeros(13), np.zeros(ROTORS)
        self._library.plant_state(
            self._memory, state.ctypes.data_as(ctypes.c_void_p),
            speeds.ctypes.data_as(ctypes.c_void_p))
        return state, speeds

    @staticmethod
    def _padded(command: Array) -> Any:
        padded = (ctypes.c_double * ROTORS)()
        padded[:len(command)] = list(command)
        return padded
