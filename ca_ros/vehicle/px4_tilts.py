"""The servos of PX4's airframe "Multirotor with Tilt" as those of a vehicle, and back.

The names are those of module.yaml of PX4's control_allocator at commit 00f285e.  A rotor of this
airframe points upwards at the angle zero.  At the angle a it points by sin a towards the direction
TD [degrees], clockwise seen from above: 0 is the front, 90 the right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, degrees, radians
from typing import Any

import numpy as np

from ca_ros.vehicle.vehicle import Vehicle

AIRFRAME, SERVOS = 8, 4  # CA_AIRFRAME of a multirotor with tilt, and its greatest CA_SV_TL_COUNT

DEFAULTS = {'MINA': 0.0, 'MAXA': 90.0, 'TD': 0.0}

ROUNDING = 1e-6


def tilts_from(given: Mapping[str, float], n: int) -> dict[str, Any]:
    """Return the settings `rotors.*` of the tilts of n rotors by name; empty if none tilts.

    Raises a ValueError if PX4 would tilt none, or two rotors by one servo.
    """
    servos = [int(given.get(f'CA_ROTOR{i}_TILT', 0)) for i in range(n)]
    if not any(servos):
        return {}
    if given.get('CA_AIRFRAME') != AIRFRAME:
        raise ValueError(f'CA_AIRFRAME: expected {AIRFRAME} (multirotor with tilt) beside _TILT')
    count, lower, upper = int(given.get('CA_SV_TL_COUNT', 0)), [0.0] * n, [0.0] * n
    axes = np.zeros((n, 3))
    for i, servo in enumerate(servos):
        if not servo:
            continue
        if not 1 <= servo <= count:
            raise ValueError(f'CA_ROTOR{i}_TILT is {servo}: CA_SV_TL_COUNT is {count}')
        if servos.count(servo) > 1:
            raise ValueError(f'CA_ROTOR{i}_TILT is {servo}: expected a servo for each rotor')
        low, high, way = (
            radians(given.get(f'CA_SV_TL{servo - 1}_{kind}', value))
            for kind, value in DEFAULTS.items()
        )
        axes[i] = np.sin(way), np.cos(way), 0.0
        lower[i], upper[i] = low, high
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return {'axes': up, 'tilt_axes': axes, 'tilt_min': lower, 'tilt_max': upper}


def tilts_to(vehicle: Vehicle, rows: Sequence[int]) -> dict[str, float]:
    """Return the parameters of a vehicle's tilts by name; `rows` has the rotor of each motor.

    Raises a ValueError if PX4 has no such servos: more than four, gimbals, rotors that do not
    point upwards at the angle zero, directions that are no whole degrees.
    """
    tilts = vehicle.tilts
    if tilts is None:
        return {}
    if (tilts.gimbal > 0.0).any() or tilts.driven.sum() > SERVOS:
        raise ValueError(f'PX4 tilts up to {SERVOS} rotors about one axis each')
    if (abs(tilts.nominal - [0.0, 0.0, 1.0]) > ROUNDING).any():
        raise ValueError('PX4 tilts rotors that point upwards at the angle zero: rotors.axes')
    found: dict[str, float] = {'CA_AIRFRAME': AIRFRAME, 'CA_SV_TL_COUNT': int(tilts.driven.sum())}
    servo = 0
    for motor, i in enumerate(rows):
        if not tilts.driven[i]:
            continue
        x, y, _ = tilts.axes[i].tolist()
        way = degrees(atan2(x, y)) % 360.0
        if abs(way - round(way)) > 1e-3:
            raise ValueError(f'rotor {i + 1} tilts towards {way:g} degrees: PX4 has whole degrees')
        side = np.cross(tilts.axes[i], tilts.nominal[i])
        _, pitch, yaw = np.abs(np.cross(vehicle.arms[i], side)) > ROUNDING
        found |= {
            f'CA_ROTOR{motor}_TILT': servo + 1, f'CA_SV_TL{servo}_MINA': degrees(tilts.lower[i]),
            f'CA_SV_TL{servo}_MAXA': degrees(tilts.upper[i]),
            f'CA_SV_TL{servo}_TD': round(way) % 360,
            f'CA_SV_TL{servo}_CT': int(yaw) + 2 * int(pitch),
        }
        servo += 1
    if np.abs([tilts.lower, tilts.upper]).max() > radians(90.0) + ROUNDING:
        raise ValueError('PX4 tilts rotors by up to 90 degrees: rotors.tilt_min, rotors.tilt_max')
    return found
