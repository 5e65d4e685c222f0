"""The lag of motors: rotor speeds that approach their commands exponentially."""

from __future__ import annotations

from math import expm1

import numpy as np

from ca_ros.arrays import Array


class MotorLag:
    """A first-order lag, T dw/dt = command - w, solved exactly for a command that is held.

    `time_constant`: T [s]; 0: the rotors have the commanded speeds at once.  An array
    (C, 1) of positive ones gives speeds (C, n).
    """

    def __init__(self, time_constant: float | Array) -> None:
        self.time_constant = time_constant

    def __call__(self, speeds: Array, command: Array, step: float) -> Array:
        """Return the speeds (n,) after a step [s] from the speeds (n,) before it [rad/s]."""
        if isinstance(self.time_constant, np.ndarray):
            return speeds - np.expm1(-step / self.time_constant) * (command - speeds)
        if not self.time_constant:
            return command
        return speeds - expm1(-step / self.time_constant) * (command - speeds)
