"""The control allocation matrix: the force and torque per thrust of each rotor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.settings import AXES

if TYPE_CHECKING:
    from ca_ros.vehicle.vehicle import Vehicle


def rotor_wrenches(vehicle: Vehicle, angles: Array | None = None) -> Array:
    """Return force and torque about the centre of mass per unit of thrust, Eqs. (5)-(6).

    The rows of the matrix (6, n) are force x, y, z [N/N] and torque x, y, z [N m/N] in the body
    frame.  For rotors that tilt, `angles` (k,) of the servos may be given [rad].
    """
    directions = vehicle.rotor_axes
    if vehicle.tilts is not None and angles is not None:
        directions = vehicle.tilts.directions(angles)
    return thrust_wrenches(vehicle, slice(None), directions)


def thrust_wrenches(vehicle: Vehicle, rotors: Sequence[int] | slice, directions: Array) -> Array:
    """Return as `rotor_wrenches` (6, k) for thrusts of rotors (k,) with directions (k, 3)."""
    k = vehicle.torque_coefficient / vehicle.thrust_coefficient
    (x, y, z), (a, b, c) = vehicle.arms[rotors].T, directions.T
    torques = (vehicle.spins * k)[rotors, None] * directions
    # np.cross takes longer than all of the rest.
    for i, moment in enumerate((y * c - z * b, z * a - x * c, x * b - y * a)):
        torques[:, i] += moment
    return np.concatenate([directions.T, torques.T])


def control_allocation_matrix(vehicle: Vehicle) -> Array:
    """Return Gamma of u = Gamma f, Eqs. (8)-(9).

    The matrix (m, n) has one row for each of the vehicle's commanded axes; by default u = (thrust,
    tau_x, tau_y, tau_z), with the rows thrust [N/N] and torque x, y, z [N m/N].
    """
    return rotor_wrenches(vehicle)[[AXES.index(axis) for axis in vehicle.axes]]
