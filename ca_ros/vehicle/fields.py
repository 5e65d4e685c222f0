"""The fields of a vehicle from its settings, checked against each other."""

from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import ParameterError
from ca_ros.vehicle.geometry import rotor_axes, rotor_positions
from ca_ros.vehicle.servos import servos_of
from ca_ros.vehicle.settings import (
    AXES,
    AxesSettings,
    BodySettings,
    MovingBodySettings,
    RotorSettings,
)
from ca_ros.vehicle.thrust_curve import ThrustCurve
from ca_ros.vehicle.validation import inertia_matrix, ordered_bounds, repeated

EFFECTORS_MAX = 1000  # greatest number of rotors; more would need hours to list what they can do
VOLTAGES = 0.5, 1.5  # what a battery can have, over its nominal voltage


def fields_of(body: BodySettings, rotors: RotorSettings, axes: AxesSettings) -> dict[str, Any]:
    """Return the fields of `Vehicle` by name, without stuck servos and the battery's voltage.

    Raises a ParameterError if settings contradict each other.
    """
    arms = rotor_positions(rotors) - np.array(body.center_of_mass, float)
    n, spins = len(arms), rotors.spins
    _check_numbers(n, spins)

    def each(name: str) -> Array:
        return repeated(f'rotors.{name}', getattr(rotors, name), n)

    speed_min, speed_max = each('speed_min'), each('speed_max')
    names = [f'rotor {i + 1}' for i in range(n)]
    ordered_bounds('rotors.speed_min', 'rotors.speed_max', speed_min, speed_max, names)
    forwards, backwards = each('thrust_coefficient'), each('thrust_coefficient_reverse')
    up, down = each('acceleration_max'), each('deceleration_max')
    _check_rates(up, down)
    per_volt, nominal = each('speed_max_per_volt'), rotors.battery_voltage
    if per_volt.any() and not nominal:
        nominal = float((speed_max[per_volt > 0.0] / per_volt[per_volt > 0.0]).max())
    # Full throttle reaches beyond speed_max with a full battery.
    full = np.maximum(speed_max, VOLTAGES[1] * nominal * per_volt)
    curve = _curve_of(rotors, forwards, speed_min, speed_max, float(full.max()))
    servos = servos_of(rotors, rotor_axes(rotors, n), speed_min, speed_max)
    return {
        'mass': body.mass,
        'gravity': body.gravity,
        'buoyancy': body.buoyancy,
        'inertia': inertia_matrix(body.inertia) if isinstance(body, MovingBodySettings) else None,
        'arms': arms,
        'rotor_axes': servos.nominal,
        'spins': np.array([1.0 if word == 'cw' else -1.0 for word in spins]),
        'thrust_coefficient': forwards,
        'thrust_coefficient_reverse': np.where(backwards > 0.0, backwards, forwards),
        'torque_coefficient': each('torque_coefficient'),
        'speed_min': speed_min,
        'speed_max': speed_max,
        'health': each('health'),
        'axes': tuple(axis for axis in AXES if axis in axes.axes),
        'lost_axes': axes.lost_axes,
        'curve': curve,
        'speed_max_per_volt': per_volt,
        'nominal_voltage': nominal,
        'servos': servos,
        'acceleration_max': up if up.any() else None,
        'deceleration_max': down if down.any() else None,
    }


def _check_numbers(n: int, spins: Any) -> None:
    """Raise a ParameterError if there are too many rotors, or not a spin for each."""
    if n > EFFECTORS_MAX:
        raise ParameterError(f'rotors.positions: expected up to {EFFECTORS_MAX} rotors, got {n}')
    if isinstance(spins, str) or len(spins) != n:
        raise ParameterError(f'rotors.spins: expected {n} words, one per rotor, got {spins!r}')


def _check_rates(up: Array, down: Array) -> None:
    """Raise a ParameterError if only some rotors have a limit on the rate of their speed (n,)."""
    if (up > 0.0).any() != (up > 0.0).all() or (down.any() and not (up * down).all()):
        raise ParameterError(
            'rotors.acceleration_max, rotors.deceleration_max: expected positive numbers for '
            f'all rotors, or 0 for all, got {up.tolist()} and {down.tolist()}'
        )


def _curve_of(
    rotors: RotorSettings, k_f: Array, speed_min: Array, speed_max: Array, full: float
) -> ThrustCurve:
    """Return the curve of `ThrustCurve.from_settings`; errors have the name of the group."""
    try:
        return ThrustCurve.from_settings(rotors.thrust_curve, k_f, speed_min, speed_max, full)
    except ParameterError as error:
        raise ParameterError(f'rotors.thrust_curve.{error}') from None
