"""The parameters of the controller and of the simulated rigid body."""

from __future__ import annotations

from ca_ros.schema import Parameter

CONTROL = {
    'controller.position_stiffness': Parameter(
        'gain from position error to acceleration, x, y, z [1/s^2]',
        array=True,
        default=1.5,
        positive=True,
    ),
    'controller.position_damping': Parameter(
        'gain from velocity error to acceleration, x, y, z [1/s]',
        array=True,
        default=2.4,
        positive=True,
    ),
    'controller.attitude_stiffness': Parameter(
        'gain from attitude error to angular acceleration, x, y, z [1/s^2]',
        array=True,
        default=[60.0, 60.0, 4.0],
        positive=True,
    ),
    'controller.attitude_damping': Parameter(
        'gain from angular velocity to angular acceleration, x, y, z [1/s]',
        array=True,
        default=[14.0, 14.0, 4.0],
        positive=True,
    ),
    'controller.attitude': Parameter(
        'tilt: the vehicle tilts towards the force that it needs; level: it stays level, and its '
        'rotors produce the sideways force, which needs the axes force_x and force_y',
        str,
        default='tilt',
        choices=('tilt', 'level'),
    ),
    'controller.speed_max': Parameter(
        'greatest commanded speed towards the waypoint along each axis [m/s]',
        default=3.0,
        positive=True,
    ),
    'controller.tilt_max': Parameter(
        'greatest commanded tilt [rad]', default=0.8, positive=True, maximum=1.5
    ),
}

SIMULATION = {
    'simulator.time_step': Parameter(
        'step of the Euler integration [s]', default=0.01, minimum=1e-5, maximum=1.0
    ),
    'simulator.rotational_drag': Parameter(
        'drag torque divided by squared angular velocity of the vehicle [N m s^2/rad^2]',
        default=0.0,
        minimum=0.0,
    ),
}
