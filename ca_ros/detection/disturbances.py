"""What a disturbance explains: a push, a gust, a load or the ground."""

import numpy as np

from ca_ros.arrays import Array

CONTACT = 4.0
"""Evidence for the ground where the vehicle is pushed up: a lost rotor lets it drop, and feet
touch the ground more often than rotors are lost."""

SLACK = 0.1  # side forces and yaw of a contact, over those of a push


class Disturbances:
    """A free force and torque of a rotor's size.

    - `hover`: thrust of a rotor in hover [N]
    - `arm`: mean distance of the rotors [m]

    - `variances` (2, 6): squares of the force and torque [N^2, N^2 m^2] of a push, a force of
      `hover` in any direction with a lever of `arm`; and of a contact with the ground, which has
      a tenth of the side forces and of the yaw
    """

    def __init__(self, hover: float, arm: float) -> None:
        push = np.array([1.0, 1.0, 1.0, arm, arm, arm])
        contact = push * [SLACK, SLACK, 1.0, 1.0, 1.0, SLACK]
        self.variances = (hover * np.array([push, contact])) ** 2

    def evidence(self, ages: Array, lacked: Array, variance: Array, seen: Array) -> Array:
        """Return the evidence (T,) for the likelier one of a push and a contact.

        A contact pushes the vehicle up; there its evidence is greater by `CONTACT`.

        - `ages`, `lacked` and `variance`: see `HypothesisTest.__call__`
        - `seen` (T,): chi squared of what is lacked
        """
        disturbed = variance + ages[:, None] ** 2 * self.variances[:, None]
        left = (lacked**2 / disturbed).sum(axis=2)
        push, contact = 0.5 * (seen - left - np.log((disturbed / variance).prod(axis=2)))
        contact = np.where(lacked[:, 2] > 0.0, contact + CONTACT, push)
        return np.asarray(np.maximum(push, contact))
