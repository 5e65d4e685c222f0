"""The settings of the simulated plant."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.settings import Numbers, ParameterError, Settings, Words, setting
from ca_ros.simulation.rotor_failures import NONE, RotorFailures
from ca_ros.vehicle.settings import XYZ, RotorSettings

_POSITION = 'position, x, y, z in the world frame'
_VELOCITY = 'velocity, x, y, z in the world frame'
_ATTITUDE = 'attitude, a rotation about x, y, z of the body'
_ANGULAR_VELOCITY = 'angular velocity, x, y, z in the body frame'
_NOISE = 'standard deviation of the white noise on each published'
_BIAS = 'constant error of each published'


_AT_START = ', at the start of a flight: in flight see simulator.failures'


@dataclass(frozen=True, kw_only=True)
class PlantRotorSettings(RotorSettings):
    """The rotors of the simulated vehicle, as they are at the start of a flight."""

    health: Numbers = setting(
        1.0, f'share of its thrust that a rotor produces{_AT_START}', minimum=0.0, maximum=1.0)
    stuck_servos: Numbers = setting(
        0.0, 'servos that stick, pairs of a rotor, from 1, and an angle [rad]; 0: none'
        f'{_AT_START}')


@dataclass(frozen=True, kw_only=True)
class PlantSettings(Settings):
    """The simulated vehicle: steps, initial state, effects and errors of measurement."""

    time_step: float = setting(
        0.01, 'time between two states, in which the rotors get one command', unit='s',
        minimum=1e-5, maximum=1.0)
    sub_steps: int = setting(
        1, 'steps of explicit Euler integration in one time step', minimum=1, maximum=1000)
    seed: int = setting(0, 'seed of gusts and noise', minimum=0)
    failures: Words = setting(
        [NONE], 'rotors that fail, such as 1@2.5 or 1@2.5=0.4 (with this health), and servos that '
        'stick, such as 1@2.5=0.4rad, at times from the first command on [s]', mutable=True)
    initial_position: Numbers = setting(0.0, f'initial {_POSITION}', unit='m', sizes=XYZ)
    initial_velocity: Numbers = setting(0.0, f'initial {_VELOCITY}', unit='m/s', sizes=XYZ)
    initial_angular_velocity: Numbers = setting(
        0.0, f'initial {_ANGULAR_VELOCITY}', unit='rad/s', sizes=XYZ)
    initial_attitude: Numbers = setting(
        [0.0, 0.0, 0.0, 1.0], 'initial attitude, a quaternion x, y, z, w, body to world', sizes=[4]
    )
    motor_time_constant: float = setting(
        0.0, 'time constant of the first-order lag from commanded to actual rotor speed', unit='s',
        minimum=0.0)
    lost_rotors: Literal['turn', 'stop'] = setting(
        'turn', 'turn: a lost rotor turns without thrust, as without its propeller; stop: it '
        'stops, which measured rotor speeds show')
    servo_time_constant: float = setting(
        0.0, 'time constant of the first-order lag from commanded to actual tilt angle', unit='s',
        minimum=0.0)
    servo_rate: float = setting(
        0.0, 'greatest rate of a tilt angle; 0: unlimited', unit='rad/s', minimum=0.0)
    command_delay: float = setting(
        0.0, 'time from a command to its effect on the motors, a multiple of the integration step',
        unit='s', minimum=0.0, maximum=10.0)
    state_delay: float = setting(
        0.0, 'age of a state when it is published, a multiple of the integration step', unit='s',
        minimum=0.0, maximum=10.0)
    linear_drag: Numbers = setting(
        0.0, 'drag force divided by airspeed, along x, y, z of the body', unit='N s/m',
        minimum=0.0, sizes=XYZ)
    rotor_drag: float = setting(
        0.0,
        'drag force of each rotor divided by its speed and the airspeed of its hub across its '
        'axis', unit='N s^2/(rad m)', minimum=0.0)
    rotational_drag: float = setting(
        0.0, 'drag torque divided by squared angular velocity of the vehicle',
        unit='N m s^2/rad^2', minimum=0.0)
    wind: Numbers = setting(
        0.0, 'mean wind, x, y, z in the world frame, which acts through the drag', unit='m/s',
        sizes=XYZ)
    gust_intensity: Numbers = setting(
        0.0, 'standard deviation of the gusts, x, y, z in the world frame', unit='m/s',
        minimum=0.0, sizes=XYZ)
    ground: Literal['none', 'flat'] = setting(
        'none', 'flat: a plane at z = 0 on which the centre of mass stops; none: no ground')
    mass_factor: float = setting(1.0, 'simulated mass divided by vehicle.mass', positive=True)
    thrust_factor: Numbers = setting(
        1.0, 'simulated k_f divided by that of the parameters, of all rotors or of each',
        positive=True)
    torque_factor: Numbers = setting(
        1.0, 'simulated k_tau divided by that of the parameters, of all rotors or of each',
        minimum=0.0)
    position_noise: Numbers = setting(
        0.0, f'{_NOISE} {_POSITION}', unit='m', minimum=0.0, sizes=XYZ)
    velocity_noise: Numbers = setting(
        0.0, f'{_NOISE} {_VELOCITY}', unit='m/s', minimum=0.0, sizes=XYZ)
    attitude_noise: Numbers = setting(
        0.0, f'{_NOISE} {_ATTITUDE}', unit='rad', minimum=0.0, sizes=XYZ)
    angular_velocity_noise: Numbers = setting(
        0.0, f'{_NOISE} {_ANGULAR_VELOCITY}', unit='rad/s', minimum=0.0, sizes=XYZ)
    position_bias: Numbers = setting(0.0, f'{_BIAS} {_POSITION}', unit='m', sizes=XYZ)
    velocity_bias: Numbers = setting(0.0, f'{_BIAS} {_VELOCITY}', unit='m/s', sizes=XYZ)
    attitude_bias: Numbers = setting(0.0, f'{_BIAS} {_ATTITUDE}', unit='rad', sizes=XYZ)
    angular_velocity_bias: Numbers = setting(
        0.0, f'{_BIAS} {_ANGULAR_VELOCITY}', unit='rad/s', sizes=XYZ)
    specific_force_bias: Numbers = setting(
        0.0, f'{_BIAS} specific force, x, y, z in the body frame', unit='m/s^2', sizes=XYZ)
    vibration: float = setting(
        0.0, 'amplitude of the vibration in the specific force at full speed of all rotors, at '
        'their frequencies; it grows with squared speed', unit='m/s^2', minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.any(self.initial_attitude):
            raise ParameterError('initial_attitude: expected a quaternion x, y, z, w, got zeros')
        try:
            RotorFailures.read(self.failures)
        except ParameterError as error:
            raise ParameterError(f'failures: {error}') from None
