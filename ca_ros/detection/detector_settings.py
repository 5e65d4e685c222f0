"""The settings of the detector of rotor failures."""

from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from ca_ros.settings import Numbers, ParameterError, Settings, setting
from ca_ros.vehicle.settings import XYZ

FARTHEST = 10.0
"""The farthest that an accelerometer is from the centre of mass [m]; more is millimetres."""


def no_lag(given: Container[str], prefix: str = 'detector.') -> str:
    """Return a warning if the lag is not among the names of given settings; empty if it is."""
    name = f'{prefix}motor_time_constant'
    return '' if name in given else (
        f'{name}: taken as 0; motors with a lag make false alarms. Give the lag [s], or 0 if '
        'there is none')


@dataclass(frozen=True, kw_only=True)
class ImuSettings(Settings):
    """The accelerometer, as detector and simulator take it."""

    specific_force_noise: float = setting(
        0.3, 'standard deviation of the measured specific force, a third of which is the least '
        'that the detector learns', unit='m/s^2', positive=True)
    imu_position: Numbers = setting(
        0.0, 'place of the accelerometer, x, y, z from the centre of mass; 0: monitor and '
        'simulator have none', unit='m', sizes=XYZ)

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.imu_position
        place = given if isinstance(given, tuple) else (given,)
        nested = any(isinstance(each, tuple) for each in place)
        one = len(place) == 1 and place[0] != 0.0
        if nested or one or np.linalg.norm(place) > FARTHEST:
            raise ParameterError(
                f'imu_position: expected x, y, z up to {FARTHEST:g} m from the centre of mass, or '
                f'0 for no accelerometer, got {self.imu_position}')

    @property
    def has_imu(self) -> bool:
        """Whether there is an accelerometer: a place of three numbers is given."""
        return np.size(self.imu_position) == 3


@dataclass(frozen=True, kw_only=True)
class DetectorSettings(ImuSettings):
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
    velocity_noise: float = setting(
        0.03,
        'standard deviation of measured velocities, from which the detector begins to learn it',
        unit='m/s', positive=True)
    angular_velocity_noise: float = setting(
        0.02,
        'standard deviation of measured angular velocities, from which the detector begins to '
        'learn it', unit='rad/s', positive=True)
