"""Model mismatch: a simulated vehicle that differs from the one that is controlled."""

from __future__ import annotations

from dataclasses import replace

from ca_ros.flight.settings import PlantSettings
from ca_ros.settings import repeated
from ca_ros.vehicle.vehicle import Vehicle


def mismatched(vehicle: Vehicle, settings: PlantSettings) -> Vehicle:
    """Return a vehicle with its mass and its rotors' coefficients times the factors.

    The bounds of the rotor speeds stay, so the bounds of the thrusts change.

    Parameters
    ----------
    vehicle : Vehicle
    settings : PlantSettings
        With ``mass_factor``, ``thrust_factor`` of k_f and ``torque_factor`` of k_tau.

    Raises
    ------
    ParameterError
        If the numbers of factors and of rotors differ.
    """
    thrust = repeated('simulator.thrust_factor', settings.thrust_factor, vehicle.n)
    torque = repeated('simulator.torque_factor', settings.torque_factor, vehicle.n)
    return replace(
        vehicle,
        mass=vehicle.mass * settings.mass_factor,
        thrust_coefficient=vehicle.thrust_coefficient * thrust,
        thrust_coefficient_reverse=vehicle.thrust_coefficient_reverse * thrust,
        torque_coefficient=vehicle.torque_coefficient * torque,
    )
