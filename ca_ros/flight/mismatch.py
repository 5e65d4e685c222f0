"""Model mismatch: a simulated vehicle that differs from the one that is controlled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ca_ros.vehicle.values import per_rotor
from ca_ros.vehicle.vehicle import Vehicle


def mismatched(vehicle: Vehicle, parameters: Mapping[str, Any]) -> Vehicle:
    """Return a vehicle with its mass and its rotors' coefficients times the factors.

    The bounds of the rotor speeds stay, so the bounds of the thrusts change.

    Parameters
    ----------
    vehicle : Vehicle
    parameters : mapping
        ``simulator.mass_factor``, ``simulator.thrust_factor`` of k_f and
        ``simulator.torque_factor`` of k_tau.

    Raises
    ------
    ParameterError
        If the numbers of factors and of rotors differ.
    """
    thrust, torque = (
        per_rotor(parameters, f'simulator.{each}_factor', vehicle.n)
        for each in ('thrust', 'torque')
    )
    return replace(
        vehicle,
        mass=vehicle.mass * parameters['simulator.mass_factor'],
        thrust_coefficient=vehicle.thrust_coefficient * thrust,
        thrust_coefficient_reverse=vehicle.thrust_coefficient_reverse * thrust,
        torque_coefficient=vehicle.torque_coefficient * torque,
    )
