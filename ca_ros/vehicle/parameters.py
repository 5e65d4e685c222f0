"""The parameters of a vehicle: its mass, its rotors and the axes that it commands."""

from __future__ import annotations

from ca_ros.schema import Parameter

AXES = ('force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw')

BODY = {
    'vehicle.name': Parameter(
        'name of the vehicle, its hardware_id on /diagnostics', str, default='multirotor'
    ),
    'vehicle.mass': Parameter('mass [kg]', positive=True),
    'vehicle.gravity': Parameter('local gravity [m/s^2]', positive=True, default=9.81),
    'vehicle.buoyancy': Parameter(
        'buoyancy of a vehicle in water, at the centre of mass [N]', default=0.0, minimum=0.0
    ),
    'vehicle.center_of_mass': Parameter(
        'centre of mass in the body frame [m]', array=True, default=[0.0, 0.0, 0.0]
    ),
}

INERTIA = {
    'vehicle.inertia': Parameter(
        'inertia about the centre of mass [kg m^2]: Jx, Jy, Jz, or the matrix row by row',
        array=True,
    ),
}

PROPULSION = {
    'rotors.positions': Parameter(
        'x, y, z of each rotor in the body frame, forward-left-up [m]', array=True
    ),
    'rotors.axes': Parameter(
        'direction of thrust, x, y, z: of all rotors, or of each',
        array=True,
        default=[0.0, 0.0, 1.0],
    ),
    'rotors.spins': Parameter(
        'sense of rotation of each rotor, seen from above',
        str,
        array=True,
        choices=('cw', 'ccw'),
    ),
    'rotors.thrust_coefficient': Parameter(
        'k_f, thrust divided by squared speed [kg m]', array=True, positive=True
    ),
    'rotors.thrust_coefficient_reverse': Parameter(
        'k_f of a rotor that turns backwards; 0: as forwards [kg m]',
        array=True,
        default=0.0,
        minimum=0.0,
    ),
    'rotors.torque_coefficient': Parameter(
        'k_tau, reaction torque divided by squared speed [kg m^2]', array=True, minimum=0.0
    ),
    'rotors.speed_min': Parameter(
        'lower bound of the rotor speed; below zero if the rotor can reverse [rad/s]', array=True
    ),
    'rotors.speed_max': Parameter(
        'upper bound of the rotor speed [rad/s]', array=True, positive=True
    ),
    'rotors.health': Parameter(
        'share of its thrust that a rotor still produces: 1 healthy, 0 (or below 1e-9) lost',
        array=True,
        default=1.0,
        minimum=0.0,
        maximum=1.0,
        mutable=True,
    ),
}

COMMANDED_AXES = {
    'allocation.axes': Parameter(
        'the components of the wrench that are commanded',
        str,
        array=True,
        default=['thrust', 'roll', 'pitch', 'yaw'],
        choices=AXES,
    ),
    'allocation.lost_axes': Parameter(
        'at the start, if the rotors cannot command every axis or cannot hover: refuse the '
        'vehicle, or drop the lost axes (axes that are lost in flight are always dropped)',
        str,
        default='refuse',
        choices=('refuse', 'drop'),
    ),
}

ALLOCATED = {**BODY, **PROPULSION, **COMMANDED_AXES}
"""What an allocator needs of a vehicle."""

SIMULATED = {**BODY, **INERTIA, **PROPULSION}
"""What a simulation needs of a vehicle."""

VEHICLE = {**BODY, **INERTIA, **PROPULSION, **COMMANDED_AXES}
"""All parameters of a vehicle; a controller needs them all."""
