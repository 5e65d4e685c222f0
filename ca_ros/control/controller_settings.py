"""The settings of the controller."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ca_ros.settings import Numbers, ParameterError, Settings, setting
from ca_ros.vehicle.settings import XYZ

SIDEWAYS = ('force_x', 'force_y')


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


def check_attitude(settings: ControllerSettings, axes: Sequence[str]) -> None:
    """Raise a ParameterError if an attitude needs axes that a vehicle does not declare.

    A vehicle that has lost these axes has to tilt; one that never had them is misconfigured.
    """
    if settings.attitude != 'tilt' and (missing := {*SIDEWAYS} - {*axes}):
        raise ParameterError(
            f'controller.attitude: {settings.attitude} needs '
            f'{", ".join(sorted(missing))} in allocation.axes'
        )
