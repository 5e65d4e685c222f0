"""Coaxial rotors, of which motion hardly shows the one that has failed."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.servos import Servos

COAXIAL = 0.1
"""Two rotors are a coaxial pair if the forces of a unit of thrust, and their moments over the mean
arm, differ by less, whatever the angles of their servos are."""


def coaxial_partners(arms: Array, axes: Array, servos: Servos) -> list[int | None]:
    """Return for each rotor the other one of its coaxial pair, from 0, if any.

    - `arms` (n, 3): positions about the centre of mass [m]
    - `axes` (n, 3): directions of the thrusts, servos at the angle zero
    """
    size = float(np.linalg.norm(arms, axis=1).mean()) or 1.0
    tilt = np.maximum(np.maximum(-servos.lower, servos.upper), servos.gimbal)
    turned = np.sin(np.clip(tilt, 0.0, np.pi / 2.0))[:, None] * arms
    each = np.hstack([axes, np.cross(arms, axes) / size, turned / size])
    away = np.linalg.norm(each[:, None] - each, axis=2)
    np.fill_diagonal(away, np.inf)
    nearest = away.argmin(axis=1).tolist()
    return [j if away[i, j] < COAXIAL and nearest[j] == i else None for i, j in enumerate(nearest)]
