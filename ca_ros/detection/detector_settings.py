"""The settings of the detector of rotor failures."""

from dataclasses import dataclass

from ca_ros.settings import Settings, setting


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
