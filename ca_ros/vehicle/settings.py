"""The settings of a vehicle: its mass, its rotors and the axes that it commands."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import (
    MissingParameterError,
    Numbers,
    ParameterError,
    Settings,
    Words,
    setting,
)
from ca_ros.vehicle.validation import repeated

AXES = ('force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw')


def unit(axis: str) -> str:
    """Return the unit of a component of the wrench."""
    return 'N m' if axis in ('roll', 'pitch', 'yaw') else 'N'


XYZ = (1, 3)  # sizes of a setting that is given once, or for x, y, z


@dataclass(frozen=True, kw_only=True)
class BodySettings(Settings):
    """The body of a vehicle, as far as an allocator needs it."""

    name: str = setting('multirotor', 'name of the vehicle, its hardware_id on /diagnostics')
    mass: float = setting(description='mass', unit='kg', positive=True)
    gravity: float = setting(9.81, 'local gravity', unit='m/s^2', positive=True)
    buoyancy: float = setting(
        0.0, 'buoyancy of a vehicle in water, at the centre of mass', unit='N', minimum=0.0)
    center_of_mass: Numbers = setting(
        [0.0, 0.0, 0.0], 'centre of mass in the body frame', unit='m', sizes=[3])


@dataclass(frozen=True, kw_only=True)
class MovingBodySettings(BodySettings):
    """The body of a vehicle that a controller or a simulation moves."""

    inertia: Numbers = setting(
        description='inertia about the centre of mass: Jx, Jy, Jz, or the matrix row by row',
        unit='kg m^2', sizes=[3, 9])


@dataclass(frozen=True, kw_only=True)
class RingSettings(Settings):
    """A ring of rotors about the z axis, which is symmetric to the last bit."""

    count: int = setting(
        0, 'number of rotors on a ring, counter-clockwise; 0: no ring', minimum=0, maximum=1000)
    radius: float = setting(0.0, 'radius of the ring', unit='m', minimum=0.0)
    first_angle: float = setting(
        0.0, 'angle of the first rotor, from forward to the left', unit='deg')
    height: float = setting(0.0, 'z of the rotors of the ring', unit='m')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count and not self.radius:
            raise MissingParameterError('radius: missing; it is the radius of the ring [m]')
        if not self.count and (self.radius or self.first_angle or self.height):
            raise MissingParameterError('count: missing; it is the number of rotors on the ring')


@dataclass(frozen=True, kw_only=True)
class ThrustCurveSettings(Settings):
    """What a test stand measured of a motor with its propeller; see `ThrustCurve`."""

    polynomial: Numbers = setting(
        0.0, 'a, b, c of the thrust a w^2 + b w + c [N] at speed w [rad/s]; 0: k_f w^2',
        sizes=[1, 3])
    speeds: Numbers = setting(0.0, 'speeds of the measured points; 0: none', unit='rad/s')
    thrusts: Numbers = setting(
        0.0, 'thrusts at these speeds, instead of the polynomial; 0: none', unit='N')
    throttles: Numbers = setting(
        0.0, 'throttles, from 0 to 1, at these speeds; 0: expo gives the throttle', minimum=0.0,
        maximum=1.0)
    expo: float = setting(
        0.0, 'throttle without measurement: the x of f / f_max = expo x^2 + (1 - expo) x, as '
        'THR_MDL_FAC of PX4', minimum=0.0, maximum=1.0)
    pwm: Numbers = setting(
        0.0, 'pulse widths of no throttle and of full throttle, for command/pwm; 0: none are '
        'published', unit='us', sizes=[1, 2], minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.polynomial != 0.0 and self.thrusts != 0.0:
            raise ParameterError('polynomial: given beside thrusts; expected one of them')
        if self.polynomial != 0.0 and np.size(self.polynomial) != 3:
            raise ParameterError(f'polynomial: expected a, b and c, got {self.polynomial}')
        if (self.thrusts != 0.0 or self.throttles != 0.0) and self.speeds == 0.0:
            raise MissingParameterError(
                'speeds: missing; they are the speeds of thrusts and throttles [rad/s]')
        if self.pwm != 0.0 and len({*np.ravel(self.pwm)}) < 2:
            raise ParameterError(f'pwm: expected two different pulse widths, got {self.pwm}')


@dataclass(frozen=True, kw_only=True)
class RotorSettings(Settings):
    """The rotors of a vehicle."""

    positions: Numbers = setting(
        0.0, 'x, y, z of each rotor in the body frame, forward-left-up; 0: rotors.ring has them',
        unit='m')
    ring: RingSettings = RingSettings()
    axes: Numbers = setting(
        [0.0, 0.0, 1.0], 'direction of thrust, x, y, z: of all rotors, or of each')
    tilt_axes: Numbers = setting(
        [0.0, 0.0, 0.0],
        'axis about which the thrust tilts, normal to rotors.axes: of all rotors, or of each; '
        'zero for a rotor that does not tilt')
    tilt_min: Numbers = setting(
        0.0, 'least tilt angle: of all rotors, or of each', unit='rad')
    tilt_max: Numbers = setting(
        0.0, 'greatest tilt angle; half a circle more than tilt_min at most, or a circle: an '
        'azimuth thruster', unit='rad')
    gimbal: Numbers = setting(
        0.0, 'half angle of the cone of a rotor on a gimbal, which tilts about two axes; 0: none',
        unit='rad', minimum=0.0)
    spins: Words = setting(
        description='sense of rotation of each rotor, seen from above', choices=['cw', 'ccw'])
    thrust_coefficient: Numbers = setting(
        description='k_f, thrust divided by squared speed', unit='kg m', positive=True)
    thrust_coefficient_reverse: Numbers = setting(
        0.0, 'k_f of a rotor that turns backwards; 0: as forwards', unit='kg m', minimum=0.0)
    torque_coefficient: Numbers = setting(
        description='k_tau, reaction torque divided by squared speed', unit='kg m^2', minimum=0.0)
    speed_min: Numbers = setting(
        description='lower bound of the rotor speed; below zero if the rotor can reverse',
        unit='rad/s')
    speed_max: Numbers = setting(
        description='upper bound of the rotor speed', unit='rad/s', positive=True)
    speed_max_per_volt: Numbers = setting(
        0.0, 'greatest rotor speed per volt of the battery, up to speed_max; 0: the voltage does '
        'not matter', unit='rad/s/V', minimum=0.0)
    battery_voltage: float = setting(
        0.0, 'nominal voltage, before the first message on battery and of the simulation; 0: '
        'speed_max holds. Readings from 0.5 to 1.5 times of it are sound', unit='V', minimum=0.0)
    thrust_curve: ThrustCurveSettings = ThrustCurveSettings()
    acceleration_max: Numbers = setting(
        0.0, 'greatest rate at which a rotor speed grows; 0: no limit', unit='rad/s^2',
        minimum=0.0)
    deceleration_max: Numbers = setting(
        0.0, 'greatest rate at which a rotor speed shrinks; 0: as acceleration_max',
        unit='rad/s^2', minimum=0.0)
    health: Numbers = setting(
        1.0, 'share of its thrust that a rotor still produces: 1 healthy, 0 (or below 1e-9) lost',
        minimum=0.0, maximum=1.0, mutable=True)
    tilt_rate_max: Numbers = setting(
        0.0, 'greatest rate of the tilt angles that are commanded: of all rotors, or of each; 0: '
        'no limit', unit='rad/s', minimum=0.0)
    stuck_servos: Numbers = setting(
        0.0, 'servos that stick: number of the rotor, from 1, and angle [rad], one pair after the '
        'other; 0: none', mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.positions != 0.0
        if given and self.ring.count:
            raise ParameterError('positions: given beside rotors.ring; expected one of them')
        if not given and not self.ring.count:
            raise MissingParameterError(
                'positions: missing; expected x, y, z of each rotor [m], or rotors.ring'
            )


@dataclass(frozen=True, kw_only=True)
class AxesSettings(Settings):
    """The axes that a vehicle commands."""

    axes: Words = setting(
        ['thrust', 'roll', 'pitch', 'yaw'], 'the components of the wrench that are commanded',
        choices=AXES)
    lost_axes: Literal['refuse', 'drop'] = setting(
        'refuse',
        'at the start, if the rotors cannot control every axis or cannot hover: refuse the '
        'vehicle, or accept it without the lost axes, as always in flight')

    def __post_init__(self) -> None:
        super().__post_init__()
        if len({*self.axes}) < len(self.axes) or not self.axes:
            raise ParameterError(f'axes: expected different axes, got {list(self.axes)!r}')


@dataclass(frozen=True, kw_only=True)
class VehicleSettings(Settings):
    """What an allocator needs of a vehicle."""

    vehicle: BodySettings
    rotors: RotorSettings
    allocation: AxesSettings


@dataclass(frozen=True, kw_only=True)
class MovingVehicleSettings(VehicleSettings):
    """What a controller needs of a vehicle."""

    vehicle: MovingBodySettings

def triple(value: Numbers) -> Array:
    """Return a setting that is given once or for x, y, z as an array (3,)."""
    return repeated('x, y, z', value, 3)
