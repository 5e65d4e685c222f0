"""The settings of the controller, of the detector and of the simulated plant."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.prioritization import PrioritizedAxesSettings
from ca_ros.settings import Numbers, ParameterError, Settings, repeated, setting
from ca_ros.vehicle.settings import MovingVehicleSettings

SIDEWAYS = ('force_x', 'force_y')

XYZ = (1, 3)  # sizes of a setting that is given once, or for x, y, z


@dataclass(frozen=True, kw_only=True)
class ControllerSettings(Settings):
    """Gains and limits of the controller."""

    position_stiffness: Numbers = setting(
        1.5, 'gain from position error to acceleration, x, y, z', unit='1/s^2', positive=True,
        sizes=XYZ)
    position_damping: Numbers = setting(
        2.4, 'gain from velocity error to acceleration, x, y, z', unit='1/s', positive=True,
        sizes=XYZ)
    attitude_stiffness: Numbers = setting(
        [60.0, 60.0, 4.0], 'gain from attitude error to angular acceleration, x, y, z',
        unit='1/s^2', positive=True, sizes=XYZ)
    attitude_damping: Numbers = setting(
        [14.0, 14.0, 4.0], 'gain from angular velocity to angular acceleration, x, y, z',
        unit='1/s', positive=True, sizes=XYZ)
    integral_gain: float = setting(
        0.0, 'rate at which the controller compensates constant forces and torques that its model '
        'lacks, such as wind or a wrong mass; 0: no integral action', unit='1/s', minimum=0.0,
        maximum=10.0)
    attitude: Literal['tilt', 'level', 'pose'] = setting(
        'tilt',
        'tilt: the vehicle tilts towards the force that it needs; level: it stays level, and its '
        'rotors produce the sideways force, which needs the axes force_x and force_y; pose: it '
        'takes the attitude of the waypoint, for vehicles that hover in any attitude')
    speed_max: float = setting(
        3.0, 'greatest commanded speed towards the waypoint along each axis', unit='m/s',
        positive=True)
    tilt_max: float = setting(
        0.8, 'greatest commanded tilt', unit='rad', positive=True, maximum=1.5)


@dataclass(frozen=True, kw_only=True)
class ControlSettings(MovingVehicleSettings):
    """What the controller needs: the vehicle, its priorities and the gains."""

    allocation: PrioritizedAxesSettings
    controller: ControllerSettings

    def __post_init__(self) -> None:
        super().__post_init__()
        # A vehicle that has lost these axes has to tilt; one that never had them is misconfigured.
        if self.controller.attitude != 'tilt' and (
            missing := {*SIDEWAYS} - {*self.allocation.axes}
        ):
            raise ParameterError(
                f'controller.attitude: {self.controller.attitude} needs '
                f'{", ".join(sorted(missing))} in allocation.axes'
            )


@dataclass(frozen=True, kw_only=True)
class DetectorSettings(Settings):
    """What the detector of rotor failures assumes and promises."""

    motor_time_constant: float = setting(
        0.0, 'time constant of the lag of the motors', unit='s', minimum=0.0, maximum=1.0)
    delay: float = setting(
        0.0, 'time from a command to its effect on the motors, plus the age of a state', unit='s',
        minimum=0.0, maximum=1.0)
    servo_time_constant: float = setting(
        0.0, 'time constant of the lag of servos that tilt rotors', unit='s', minimum=0.0,
        maximum=1.0)
    servo_rate: float = setting(
        0.0, 'greatest rate of a tilt angle; 0: unlimited', unit='rad/s', minimum=0.0)
    false_alarms: float = setting(
        0.01, 'false alarms in an hour of flight, if all errors are Gaussian', unit='1/h',
        positive=True, maximum=1000.0)
    certainty: float = setting(
        0.995, 'probability from which a rotor is named, against each other rotor', minimum=0.5,
        maximum=0.999999)
    least_loss: float = setting(
        0.35, 'least share of its thrust that a rotor loses in a failure', minimum=0.1, maximum=0.9
    )
    thrust_error: float = setting(
        0.1, 'relative error of the thrust of each rotor', minimum=0.0, maximum=1.0)
    time_error: float = setting(
        0.01, 'error of the lag and the delay', unit='s', minimum=0.0, maximum=1.0)
    velocity_noise: float = setting(
        0.03,
        'standard deviation of measured velocities, from which the detector begins to learn it',
        unit='m/s', positive=True)
    angular_velocity_noise: float = setting(
        0.02,
        'standard deviation of measured angular velocities, from which the detector begins to '
        'learn it', unit='rad/s', positive=True)
    learning_time: float = setting(
        2.0, 'time over which noise and disturbances are learnt', unit='s', minimum=0.5)


_POSITION = 'position, x, y, z in the world frame'
_VELOCITY = 'velocity, x, y, z in the world frame'
_ATTITUDE = 'attitude, a rotation about x, y, z of the body'
_ANGULAR_VELOCITY = 'angular velocity, x, y, z in the body frame'
_NOISE = 'standard deviation of the white noise on each published'
_BIAS = 'constant error of each published'


@dataclass(frozen=True, kw_only=True)
class PlantSettings(Settings):
    """The simulated vehicle: steps, initial state, effects and errors of measurement."""

    time_step: float = setting(
        0.01, 'time between two states, in which the rotors get one command', unit='s',
        minimum=1e-5, maximum=1.0)
    sub_steps: int = setting(
        1, 'steps of the integration in one time step', minimum=1, maximum=1000)
    integrator: Literal['euler', 'rk4'] = setting(
        'euler', 'euler: explicit Euler, of order 1; rk4: classical Runge-Kutta, of order 4')
    seed: int = setting(0, 'seed of gusts and noise', minimum=0)
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
    gust_time: float = setting(1.0, 'correlation time of the gusts', unit='s', positive=True)
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.any(self.initial_attitude):
            raise ParameterError('initial_attitude: expected a quaternion x, y, z, w, got zeros')


def triple(value: Numbers) -> Array:
    """Return a setting that is given once or for x, y, z as an array (3,)."""
    return repeated('x, y, z', value, 3)
