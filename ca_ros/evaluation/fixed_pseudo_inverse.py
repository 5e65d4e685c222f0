"""The clipped pseudo-inverse of a matrix that is computed once."""

from __future__ import annotations

import numpy as np

from ca_ros.allocation.pseudo_inverse import PseudoInverse
from ca_ros.vehicle.vehicle import Vehicle


class FixedPseudoInverse(PseudoInverse):
    """The clipped pseudo-inverse of all rotors, as in allocators that know no rotor failures.

    The share of a lost rotor is clipped away, not given to the others.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.inverse = np.linalg.pinv(self.problem.gamma)
