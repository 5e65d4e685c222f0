"""The weighted pseudo-inverse."""

from dataclasses import dataclass

import numpy as np

from ca_ros.allocation.pseudo_inverse import PseudoInverse
from ca_ros.arrays import Array
from ca_ros.settings import Numbers, Settings, setting
from ca_ros.vehicle.validation import check_ratio, repeated


@dataclass(frozen=True, kw_only=True)
class WeightedPseudoInverseSettings(Settings):
    """The settings of `WeightedPseudoInverse`."""

    weights: Numbers = setting(
        1.0,
        'weight of each rotor in the norm of the thrusts: one number, or one for each rotor, at '
        'most 1e4 times each other', positive=True, mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ratio('weights', self.weights)


class WeightedPseudoInverse(PseudoInverse):
    """The pseudo-inverse with a weight for each rotor, clipped to the bounds.

    Before clipping, the thrusts ``W^-1 (Gamma W^-1)^+ u`` are those of least ``|W f|`` that give
    the wrench, with W the diagonal matrix of the weights [1]_.  A rotor with a greater weight is
    used less; with equal weights the method is `PseudoInverse`.  Lost rotors are left out.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    weights : float or (n,) array, default 1
        Weight of each rotor, positive, at most 1e4 times each other.

    References
    ----------
    .. [1] W. Durham, K. A. Bordignon and R. Beck, Aircraft Control Allocation, Wiley, 2017.
    """

    solves = 'f = sat(W^-1 (Gamma W^-1)^+ u), W the `weights` of the rotors'

    settings_type = WeightedPseudoInverseSettings
    settings: WeightedPseudoInverseSettings

    def _set_up(self) -> None:
        super()._set_up()
        self.weights = repeated('weights', self.settings.weights, self.problem.n)
        self.inverse = weighted_inverse(self._columns, self.weights)


def weighted_inverse(gamma: Array, weights: Array) -> Array:
    """Return the matrix (n, m) that maps u to the f of least ``|W f|`` with ``Gamma f = u``."""
    inverse: Array = np.linalg.pinv(gamma / weights) / weights[:, None]
    return inverse
