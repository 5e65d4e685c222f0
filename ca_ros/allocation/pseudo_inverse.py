"""The pseudo-inverse method."""

from __future__ import annotations

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.vehicle import Vehicle


class PseudoInverse(Allocator):
    """The thrusts of least norm, saturated: f = sat(Gamma^+ u), Eqs. (12)-(13).

    The bounds hold; where they were violated the wrench is not the demanded one and the residual
    tells by how much.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.inverse = np.linalg.pinv(self.problem.gamma)

    def _allocate(self, u: Array) -> Allocation:
        wanted = self.inverse @ u
        thrusts = self.problem.clip(wanted)
        return Allocation(
            self.problem,
            u,
            thrusts,
            self._status(u, thrusts),
            violation=float(np.abs(wanted - thrusts).max()),
        )

    def _allocate_batch(self, demands: Array) -> Allocation:
        wanted = demands @ self.inverse.T
        thrusts = self.problem.clip(wanted)
        status = np.where(self._judge(demands, thrusts), Status.EXACT, Status.INEXACT).astype(
            np.int8
        )
        return Allocation(
            self.problem, demands, thrusts, status, violation=np.abs(wanted - thrusts).max(axis=-1)
        )
