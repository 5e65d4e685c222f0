"""The parameters of the controller and of the simulated plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.schema import Parameter, ParameterError

MEASURED = {
    'position': 'position, x, y, z in the world frame [m]',
    'velocity': 'velocity, x, y, z in the world frame [m/s]',
    'attitude': 'attitude, a rotation about x, y, z of the body [rad]',
    'angular_velocity': 'angular velocity, x, y, z in the body frame [rad/s]',
}
"""The parts of a measured state."""

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
    'controller.integral_gain': Parameter(
        'rate at which the controller compensates constant forces and torques that its model '
        'lacks, such as wind or a wrong mass; 0: no integral action [1/s]',
        default=0.0,
        minimum=0.0,
        maximum=10.0,
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
        'time between two states, in which the rotors get one command [s]',
        default=0.01,
        minimum=1e-5,
        maximum=1.0,
    ),
    'simulator.sub_steps': Parameter(
        'steps of the integration in one time step', default=1.0, minimum=1.0, maximum=1000.0
    ),
    'simulator.integrator': Parameter(
        'euler: explicit Euler, of order 1; rk4: classical Runge-Kutta, of order 4',
        str,
        default='euler',
        choices=('euler', 'rk4'),
    ),
    'simulator.seed': Parameter(
        'seed of gusts and noise, a whole number', default=0.0, minimum=0.0
    ),
    **{
        f'simulator.initial_{part}': Parameter(f'initial {words}', array=True, default=0.0)
        for part, words in MEASURED.items()
        if part != 'attitude'
    },
    'simulator.initial_attitude': Parameter(
        'initial attitude, a quaternion x, y, z, w, body to world',
        array=True,
        default=[0.0, 0.0, 0.0, 1.0],
    ),
    'simulator.motor_time_constant': Parameter(
        'time constant of the first-order lag from commanded to actual rotor speed [s]',
        default=0.0,
        minimum=0.0,
    ),
    'simulator.command_delay': Parameter(
        'time from a command to its effect on the motors, a multiple of the integration step [s]',
        default=0.0,
        minimum=0.0,
        maximum=10.0,
    ),
    'simulator.state_delay': Parameter(
        'age of a state when it is published, a multiple of the integration step [s]',
        default=0.0,
        minimum=0.0,
        maximum=10.0,
    ),
    'simulator.linear_drag': Parameter(
        'drag force divided by airspeed, along x, y, z of the body [N s/m]',
        array=True,
        default=0.0,
        minimum=0.0,
    ),
    'simulator.rotor_drag': Parameter(
        'drag force of each rotor divided by its speed and the airspeed of its hub across its '
        'axis [N s^2/(rad m)]',
        default=0.0,
        minimum=0.0,
    ),
    'simulator.rotational_drag': Parameter(
        'drag torque divided by squared angular velocity of the vehicle [N m s^2/rad^2]',
        default=0.0,
        minimum=0.0,
    ),
    'simulator.wind': Parameter(
        'mean wind, x, y, z in the world frame, which acts through the drag [m/s]',
        array=True,
        default=0.0,
    ),
    'simulator.gust_intensity': Parameter(
        'standard deviation of the gusts, x, y, z in the world frame [m/s]',
        array=True,
        default=0.0,
        minimum=0.0,
    ),
    'simulator.gust_time': Parameter(
        'correlation time of the gusts [s]', default=1.0, positive=True
    ),
    'simulator.ground': Parameter(
        'flat: a plane at z = 0 on which the centre of mass stops; none: no ground',
        str,
        default='none',
        choices=('none', 'flat'),
    ),
    'simulator.mass_factor': Parameter(
        'simulated mass divided by vehicle.mass', default=1.0, positive=True
    ),
    'simulator.thrust_factor': Parameter(
        'simulated k_f divided by that of the parameters, of all rotors or of each',
        array=True,
        default=1.0,
        positive=True,
    ),
    'simulator.torque_factor': Parameter(
        'simulated k_tau divided by that of the parameters, of all rotors or of each',
        array=True,
        default=1.0,
        minimum=0.0,
    ),
    **{
        f'simulator.{part}_noise': Parameter(
            f'standard deviation of the white noise on each published {words}',
            array=True,
            default=0.0,
            minimum=0.0,
        )
        for part, words in MEASURED.items()
    },
    **{
        f'simulator.{part}_bias': Parameter(
            f'constant error of each published {words}', array=True, default=0.0
        )
        for part, words in MEASURED.items()
    },
}


def triple(parameters: Mapping[str, Any], name: str) -> Array:
    """Return a parameter (3,) that is given once or for x, y, z."""
    array = np.asarray(parameters[name], dtype=float)
    if array.size not in (1, 3):
        raise ParameterError(f'{name}: expected 1 or 3 numbers, got {array.size}')
    return np.broadcast_to(array, (3,)).copy()
