"""A vehicle in code: its parameters from keywords."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.errors import shortened
from ca_ros.settings import ParameterError
from ca_ros.vehicle.settings import AxesSettings, MovingBodySettings, RotorSettings

GROUPS = {
    **{field.name: 'rotors' for field in fields(RotorSettings)},
    **{field.name: 'vehicle' for field in fields(MovingBodySettings)},
    **{field.name: 'allocation' for field in fields(AxesSettings)},
}
"""The group of each keyword; `axes` are those of the wrench, `rotor_axes` the directions."""

SIGNS = (
    '+1 is clockwise, seen from above, here and in rotorpy, and counter-clockwise in KM of PX4; '
    "expected 'cw' or 'ccw' for each rotor, or yaw_torque_signs=[1, -1, ...]: 1 for a rotor whose "
    'drag turns the vehicle to the left, which turns clockwise'
)


SYMBOLS = {
    **dict.fromkeys(('k_f', 'kf', 'k_eta', 'c_t', 'ct'), 'thrust_coefficient'),
    **dict.fromkeys(('k_tau', 'k_m', 'km', 'c_q', 'cq'), 'torque_coefficient'),
    **dict.fromkeys(('rotor_positions', 'rotor_pos', 'arms'), 'positions'),
    **dict.fromkeys(('directions', 'rotor_directions'), 'yaw_torque_signs'),
    **dict.fromkeys(('j', 'i', 'moment_of_inertia'), 'inertia'), 'm': 'mass', 'n': 'count',
    'rotor_speed_min': 'speed_min', 'rotor_speed_max': 'speed_max',
}
"""Other names of the keywords, which simulators and papers have."""

INSTEAD = {
    **dict.fromkeys(('max_thrust', 'thrust_max', 'thrust_min', 'min_thrust'), (
        'thrust is thrust_coefficient times the square of the speed: give '
        'speed_max=sqrt(max_thrust / thrust_coefficient), and speed_min alike')),
    **dict.fromkeys(('speed_limits', 'speed_range', 'speeds', 'rotor_speed_limits', 'limits'), (
        'give speed_min and speed_max [rad/s]')),
    **dict.fromkeys(('rotors', 'motors', 'propellers', 'arm_length', 'arm', 'n_rotors'), (
        'give positions=[(x, y, z), ...] and spins=[...], one for each rotor, or '
        'Vehicle.ring(count=..., radius=..., ...)')),
    **dict.fromkeys(('ixx', 'iyy', 'izz'), 'give inertia=[Ixx, Iyy, Izz] [kg m^2]'),
    **dict.fromkeys(('max_rpm', 'rpm_max', 'rpm'), (
        'give speed_max [rad/s], rpm times 2 pi / 60')),
}
"""By a keyword that somebody may guess, what to give instead."""


def parameters_of(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by name, as in a parameter file, of keywords of `Vehicle`.

    Values that are None are left out.  Raises a ParameterError that names the keyword and the
    fault.
    """
    found: dict[str, Any] = {}
    for name, value in keywords.items():
        if value is None:
            continue
        if name.lower() in SYMBOLS:
            raise ParameterError(f'{name}: no such keyword; did you mean {SYMBOLS[name.lower()]}?')
        if name not in GROUPS and name not in ('positions', 'rotor_axes', 'yaw_torque_signs'):
            raise ParameterError(f'{name}: no such keyword{_hint(name.lower())}')
        if name in ('positions', 'rotor_axes'):
            value = _rows(name, value)
        elif name == 'spins':
            value = _spins(value)
        elif name == 'axes' and isinstance(value, str):
            value = [value]
        elif name == 'yaw_torque_signs':
            name, value = 'spins', _spins_of_signs(value)
        group, key = ('rotors', 'axes') if name == 'rotor_axes' else (GROUPS[name], name)
        for path, each in flat(f'{group}.{key}', value):
            found[path] = plain(each)
    return found


def _hint(name: str) -> str:
    if name in INSTEAD:
        return f'; {INSTEAD[name]}'
    near = get_close_matches(name, [*GROUPS, 'rotor_axes', 'yaw_torque_signs'], n=1, cutoff=0.7)
    return f' (did you mean {near[0]}?)' if near else ''


def flat(name: str, value: Any) -> list[tuple[str, Any]]:
    """Return names and values of a mapping in mappings."""
    if not isinstance(value, Mapping):
        return [(name, value)]
    return [pair for key, each in value.items() for pair in flat(f'{name}.{key}', each)]


def with_rows(name: str, value: Any) -> Any:
    """Return the value of a parameter as a file has it, where it has a row for each rotor.

    Raises a ParameterError if the rows do not have three numbers each.
    """
    kinds = (list, tuple, np.ndarray)
    if name not in ('rotors.positions', 'rotors.axes') or not isinstance(value, kinds):
        return value
    return plain(_rows(name, value)) if any(isinstance(each, kinds) for each in value) else value


def ring_spins(count: int, spins: Sequence[str] | None) -> Sequence[str]:
    """Return the spins of a ring; by default they alternate, the first one clockwise.

    Raises a ParameterError if they cannot alternate.
    """
    if spins is None and count % 2:
        raise ParameterError(f'spins: missing; those of {count} rotors cannot alternate')
    return ['cw', 'ccw'] * (count // 2) if spins is None else spins


def _rows(name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        raise ParameterError(f'{name}: expected shape (n, 3), got a mapping: list its values()')
    right = 'shape (n, 3), x, y, z of each rotor, forward-left-up'
    array = _numbers(name, value, right)
    if array.ndim != 2 and name == 'rotor_axes' and array.size == 3:
        return array
    if array.ndim != 2 or array.shape[1] != 3:
        raise ParameterError(f'{name}: expected {right}; got {array.shape}')
    return array


def _numbers(name: str, value: Any, right: str) -> Array:
    """Return numbers as an array; raise a ParameterError that says what is right."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ParameterError(f'{name}: expected {right}; got {shortened(value)}') from None


def _spins(value: Any) -> Any:
    if isinstance(value, str):
        raise ParameterError(f"spins: expected 'cw' or 'ccw' for each rotor, got {value!r} alone")
    words = np.asarray(value, dtype=object).ravel().tolist()
    if any(not isinstance(word, str) for word in words):
        raise ParameterError(f'spins: got {words}: {SIGNS}')
    return words


def _spins_of_signs(value: Any) -> list[str]:
    """Return the spins of rotors with these signs of the yaw torque."""
    right = '1 or -1 for each rotor'
    signs = _numbers('yaw_torque_signs', value, right).ravel()
    if not np.isin(signs, (-1.0, 1.0)).all():
        raise ParameterError(f'yaw_torque_signs: expected {right}, got {value}')
    return ['cw' if sign > 0.0 else 'ccw' for sign in signs.tolist()]


def plain(value: Any) -> Any:
    """Return a value as a file has it: numbers, words and lists of them."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.ravel().tolist() if np.ndim(value) else value.item()
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return value
