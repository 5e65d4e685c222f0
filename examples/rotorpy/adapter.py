"""ca_ros and rotorpy 3.0.0: vehicles, allocation, and a plant for any number of rotors.

rotorpy's `Multirotor` inverts a 4 x 4 matrix and packs the speeds of four rotors.  The subclass
here does both for n rotors, for that version alone.  Frames and signs agree: forward-left-up,
quaternions x, y, z, w, a positive direction of a rotor gives a positive yaw torque (``cw``).
"""

from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from ca_ros import Vehicle
from ca_ros.arrays import Array

VERSION = '3.0.0'


def check_version() -> None:
    """Raise a ModuleNotFoundError if another version of rotorpy is installed, or none."""
    try:
        found = version('rotorpy')
    except PackageNotFoundError:
        raise ModuleNotFoundError(f'rotorpy is missing: pip install rotorpy=={VERSION}') from None
    if found != VERSION:
        raise ModuleNotFoundError(f'rotorpy {found}: this adapter is for {VERSION}')


check_version()

from rotorpy.controllers.quadrotor_control import SE3Control  # noqa: E402
from rotorpy.vehicles.multirotor import Multirotor  # noqa: E402


def vehicle_of(params: dict[str, Any]) -> Vehicle:
    """Return the vehicle of rotorpy's parameters."""
    positions = np.array([*params['rotor_pos'].values()])
    return Vehicle.from_parameters({
        'vehicle.mass': params['mass'], 'vehicle.gravity': 9.81,
        'rotors.positions': positions.ravel().tolist(),
        'rotors.spins': ['cw' if way > 0 else 'ccw' for way in params['rotor_directions']],
        'rotors.thrust_coefficient': params['k_eta'], 'rotors.torque_coefficient': params['k_m'],
        'rotors.speed_min': float(params['rotor_speed_min']),
        'rotors.speed_max': float(params['rotor_speed_max']),
    })


def params_of(vehicle: Vehicle, lag: float, drag: float = 0.0) -> dict[str, Any]:
    """Return rotorpy's parameters of a vehicle with equal rotors.

    `lag`: time constant of the motors [s].  `drag`: of each rotor, over its speed and the airspeed
    of its hub [N s^2/(rad m)].
    """
    inertia = np.asarray(vehicle.inertia)
    names = [f'r{i + 1}' for i in range(vehicle.n)]
    moments = {f'I{a}{b}': inertia[i, j] for i, a in enumerate('xyz')
               for j, b in enumerate('xyz') if j >= i}  # fmt: skip
    return {
        'mass': vehicle.mass, **moments, 'num_rotors': vehicle.n,
        'rotor_pos': dict(zip(names, vehicle.arms, strict=True)),
        'rotor_directions': np.asarray(vehicle.spins), 'c_Dx': 0.0, 'c_Dy': 0.0, 'c_Dz': 0.0,
        'k_eta': float(vehicle.thrust_coefficient[0]), 'k_d': drag, 'k_z': drag, 'k_flap': 0.0,
        'k_m': float(vehicle.torque_coefficient[0]), 'tau_m': lag,
        'rotor_speed_min': float(vehicle.speed_min[0]),
        'rotor_speed_max': float(vehicle.speed_max[0]),
    }


def first_four(params: dict[str, Any]) -> dict[str, Any]:
    """Return parameters with four rotors, for constructors that invert a 4 x 4 matrix."""
    names = [f'r{i}' for i in range(4)]
    corners = dict(zip(names, np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) * 0.1,
                       strict=True))  # fmt: skip
    return {**params, 'num_rotors': 4, 'rotor_pos': corners,
            'rotor_directions': np.array([1, -1, 1, -1])}  # fmt: skip


class AnyMultirotor(Multirotor):
    """rotorpy's plant with any number of rotors, some of which may be `lost`."""

    def __init__(self, params: dict[str, Any], state: dict[str, Array]) -> None:
        super().__init__(first_four(params), state, 'cmd_motor_speeds')
        self.num_rotors, self.rotor_pos = params['num_rotors'], params['rotor_pos']
        self.rotor_dir = params['rotor_directions']
        self.extract_geometry()
        places = self.rotor_geometry
        ratio = self.k_m / self.k_eta
        self.f_to_TM = np.array(
            [np.ones(len(places)), places[:, 1], -places[:, 0], ratio * self.rotor_dir])
        self.TM_to_f = np.linalg.pinv(self.f_to_TM)
        self.lost = np.zeros(self.num_rotors, bool)

    def compute_body_wrench(self, rates: Array, speeds: Array, airspeed: Array) -> Any:
        """Return force and torque; a lost rotor has no thrust, drag or torque."""
        return super().compute_body_wrench(rates, np.where(self.lost, 0.0, speeds), airspeed)

    def step(self, state: dict[str, Array], control: dict[str, Array], t_step: float) -> Any:
        """Integrate rotorpy's derivative over a step by Runge-Kutta of order 4, without ground."""
        speeds = np.clip(
            control['cmd_motor_speeds'], self.rotor_speed_min, self.rotor_speed_max)
        parts = [state[name] for name in ('x', 'v', 'q', 'w', 'wind', 'rotor_speeds')]
        s, total, slope = np.concatenate(parts), 0.0, 0.0
        for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            slope = self._s_dot_fn(0.0, s + share * t_step * slope, speeds)
            total = total + weight * slope
        found: dict[str, Array] = self._unpack_state(s + t_step / 6.0 * total)
        found['q'] = found['q'] / np.linalg.norm(found['q'])
        return found

    def own_speeds(self, wrench: Array) -> Array:
        """Return the speeds that rotorpy's own mixing commands for a wrench [rad/s]."""
        squares = self.TM_to_f @ wrench / self.k_eta
        return np.sign(squares) * np.sqrt(np.abs(squares))


class Controller:
    """rotorpy's SE3 controller: its wrench before any allocation."""

    def __init__(self, params: dict[str, Any]) -> None:
        self._se3 = SE3Control(first_four(params))

    def wrench(self, time: float, state: dict[str, Array], target: dict[str, Any]) -> Array:
        """Return thrust and torques (4,) [N, N m]."""
        command = self._se3.update(time, state, target)
        return np.array([command['cmd_thrust'], *command['cmd_moment']])
