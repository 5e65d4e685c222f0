"""The file of a vehicle that was made in code."""

from typing import Any

import numpy as np

from ca_ros.vehicle.parameter_text import parameter_text
from ca_ros.vehicle.thrust_curve import ThrustCurve

COPIED = (
    'thrust_coefficient', 'thrust_coefficient_reverse', 'torque_coefficient', 'speed_min',
    'speed_max', 'acceleration_max', 'deceleration_max',
)
"""Parameters of the rotors that are fields of the vehicle."""


def file_text(vehicle: Any) -> str:
    """Return the text of the parameter file of a `Vehicle`; see its `save`."""
    curve, servos = vehicle.curve, vehicle.servos
    measured = len(curve.starts) or len(curve.throttles) or curve.expo
    if measured or curve.pwm != ThrustCurve().pwm or np.any(vehicle.speed_max_per_volt):
        raise ValueError('save: a vehicle with a thrust curve or a battery: keep its own file')
    if servos.unstuck is not None or vehicle.failed_arms:
        raise ValueError('save: stuck servos or failed arms: save the sound vehicle')
    rotors: dict[str, Any] = {
        'positions': vehicle.arms, 'axes': vehicle.rotor_axes,
        'spins': ['cw' if sign > 0.0 else 'ccw' for sign in vehicle.spins.tolist()],
        **{name: getattr(vehicle, name) for name in COPIED},
        'health': None if (vehicle.health == 1.0).all() else vehicle.health,
    }
    if len(servos):
        rotors |= {
            'tilt_axes': servos.axes, 'tilt_min': servos.lower, 'tilt_max': servos.upper,
            'gimbal': servos.gimbal, 'tilt_rate_max': servos.rate_max}
    body = {
        'mass': vehicle.mass, 'gravity': vehicle.gravity, 'buoyancy': vehicle.buoyancy or None,
        'inertia': vehicle.inertia}
    axes = {'axes': vehicle.axes, 'lost_axes': vehicle.lost_axes}
    groups = {'vehicle': body, 'rotors': rotors, 'allocation': axes}
    return parameter_text(groups, digits=17)
