"""The pseudo-inverse method."""

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.arrays import Array


class PseudoInverse(Allocator):
    """The pseudo-inverse, clipped to the bounds: f = sat(Gamma^+ u), Eqs. (12)-(13).

    If clipping changes a thrust, the residual is the difference between demanded and produced
    wrench.  Lost rotors are left out of Gamma.  Of rotors that tilt, angle and thrust are clipped
    one after the other.
    """

    solves = 'f = sat(Gamma^+ u)'
    takes_vectors = True

    def _set_up(self) -> None:
        # Without the columns of lost rotors, the others produce the whole wrench.
        lost = (self.problem.lower == 0.0) & (self.problem.upper == 0.0)
        self._columns = self.problem.gamma * ~lost
        self.inverse = np.linalg.pinv(self._columns)

    def _allocate(self, u: Array) -> Allocation:
        return self._clipped(u, self.inverse @ u)

    def _allocate_batch(self, demands: Array) -> AllocationBatch:
        wanted = demands @ self.inverse.T
        thrusts = self.problem.sets.saturate(wanted)
        violations: Array = np.abs(wanted - thrusts).max(axis=-1, initial=0.0)
        inexact = ~self.problem.is_exact(demands, thrusts)
        status = (inexact * Status.INEXACT).astype(np.int8)
        ones = np.ones(len(demands))
        return AllocationBatch(self.problem, demands, thrusts, status, ones, violations)
