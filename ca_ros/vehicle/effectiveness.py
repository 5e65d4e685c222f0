"""The control allocation matrix: the force and torque per thrust of each rotor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.settings import AXES

if TYPE_CHECKING:
    from ca_ros.vehicle.vehicle import Vehicle


def rotor_wrenches(vehicle: Vehicle) -> Array:
    """Return force and torque about the centre of mass per unit of thrust, Eqs. (5)-(6).

    Returns
    -------
    (6, n) array
        Rows: force x, y, z [N/N] and torque x, y, z [N m/N] in the body frame.
    """
    k = vehicle.torque_coefficient / vehicle.thrust_coefficient
    (x, y, z), (a, b, c) = vehicle.arms.T, vehicle.rotor_axes.T
    torques = (vehicle.spins * k)[:, None] * vehicle.rotor_axes
    # np.cross takes longer than all of the rest.
    for i, moment in enumerate((y * c - z * b, z * a - x * c, x * b - y * a)):
        torques[:, i] += moment
    return np.concatenate([vehicle.rotor_axes.T, torques.T])


def control_allocation_matrix(vehicle: Vehicle) -> Array:
    """Return Gamma of u = Gamma f, Eqs. (8)-(9).

    Returns
    -------
    (m, n) array
        One row for each of the vehicle's commanded axes; by default u = (thrust, tau_x, tau_y,
        tau_z), with the rows thrust [N/N] and torque x, y, z [N m/N].
    """
    return rotor_wrenches(vehicle)[[AXES.index(axis) for axis in vehicle.axes]]
