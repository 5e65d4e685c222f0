"""The control allocation matrix: the force and torque per thrust of each rotor."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle


def rotor_wrenches(vehicle: Vehicle, angles: Array | None = None) -> Array:
    """Return force and torque about the centre of mass per unit of thrust, Eqs. (5)-(6).

    The rows of the matrix (6, n) are force x, y, z [N/N] and torque x, y, z [N m/N] in the body
    frame.  `angles` (k,): of the servos; by default zero [rad].
    """
    if angles is None or not len(angles):
        return vehicle.wrenches
    return vehicle.thrust_wrenches(slice(None), vehicle.servos.directions(angles))


def produced(vehicle: Vehicle, thrusts: Array, angles: Array) -> Array:
    """Return the wrenches (K, m) of thrusts (K, n) [N] at servo angles (K, k) [rad]."""
    if not angles.shape[1]:
        return np.asarray(thrusts @ control_allocation_matrix(vehicle).T)
    rows = [AXES.index(axis) for axis in vehicle.axes]
    pairs = zip(thrusts, angles, strict=True)
    return np.array([rotor_wrenches(vehicle, turned)[rows] @ f for f, turned in pairs])


def control_allocation_matrix(vehicle: Vehicle) -> Array:
    """Return Gamma of u = Gamma f, Eqs. (8)-(9).

    Parameters
    ----------
    vehicle : Vehicle

    Returns
    -------
    (m, n) array
        One row for each of the vehicle's commanded axes; by default u = (thrust, tau_x, tau_y,
        tau_z), with the rows thrust [N/N] and torque x, y, z [N m/N].

    Examples
    --------
    >>> control_allocation_matrix(Vehicle.load('quadrotor')).round(3)
    array([[ 1.   ,  1.   ,  1.   ,  1.   ],
           [ 0.177,  0.177, -0.177, -0.177],
           [-0.177,  0.177,  0.177, -0.177],
           [ 0.02 , -0.02 ,  0.02 , -0.02 ]])
    """
    if not isinstance(vehicle, Vehicle):
        raise TypeError(f'expected a Vehicle, got {vehicle!r}')
    return rotor_wrenches(vehicle)[[AXES.index(axis) for axis in vehicle.axes]]
