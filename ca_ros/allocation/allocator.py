"""The interface that all allocation methods share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array, BoolArray, IntArray
from ca_ros.problem.audit import accept
from ca_ros.problem.problem import AllocationProblem, lengths
from ca_ros.schema import Parameter
from ca_ros.vehicle.vehicle import Vehicle


class Allocator(ABC):
    """Distributes a wrench among the rotors of a vehicle.

    A method is a subclass with `_allocate`.  The answer depends on the wrench alone, not on those
    before it.  A method of `ALLOCATORS` whose options are parameters of the nodes declares them in
    `parameters`: the option ``slack`` of the method ``exact`` is ``allocation.exact.slack``.

    Parameters
    ----------
    vehicle : Vehicle or AllocationProblem
        A vehicle is audited (`ca_ros.problem.audit.accept`); a problem is taken as it is.

    Raises
    ------
    ParameterError
        If the vehicle cannot command every axis and hover, and its `lost_axes` is 'refuse'.
    """

    parameters: ClassVar[Mapping[str, Parameter]] = {}
    engine: str = 'NumPy'
    """What works out the thrusts."""

    def __init__(self, vehicle: Vehicle | AllocationProblem) -> None:
        self.problem = (
            vehicle if isinstance(vehicle, AllocationProblem) else accept(vehicle).problem
        )

    def allocate(self, u: ArrayLike) -> Allocation:
        """Allocate one wrench.

        Parameters
        ----------
        u : (m,) array
            Demanded wrench [N, N m]; for the usual four axes (thrust, tau_x, tau_y, tau_z).

        Returns
        -------
        Allocation
            Also for a wrench that cannot be attained: its status says what was done.

        Raises
        ------
        ValueError
            If `u` is not m finite numbers.
        """
        return self._allocate(self.problem.check(u))

    def allocate_batch(self, wrenches: ArrayLike) -> Allocation:
        """Allocate N wrenches, (N, m) [N, N m]; the fields of the answer have a leading N."""
        demands = self.problem.check(wrenches, batch=True)
        if demands.ndim != 2:
            raise ValueError(
                f'wrenches: expected shape (N, {len(self.problem.axes)}), got {demands.shape}'
            )
        return self._allocate_batch(demands)

    @abstractmethod
    def _allocate(self, u: Array) -> Allocation:
        """Allocate one checked wrench."""

    def _allocate_batch(self, demands: Array) -> Allocation:
        answers = [self._allocate(u) for u in demands]
        thrusts = np.array([a.thrusts for a in answers])
        return self._batch(
            demands,
            thrusts.reshape(len(demands), self.problem.vehicle.n),
            np.array([a.status for a in answers], dtype=np.int8),
            levels=np.array([a.level for a in answers], dtype=float),
            violations=np.array([a.violation for a in answers], dtype=float),
        )

    def _batch(
        self,
        demands: Array,
        thrusts: Array,
        status: IntArray | None = None,
        levels: Array | None = None,
        violations: Array | None = None,
    ) -> Allocation:
        """Return the answer to demands (N, m), judged here if there is no status."""
        n = len(demands)
        if status is None:
            status = np.where(self._judge(demands, thrusts), Status.EXACT, Status.INEXACT)
        return Allocation(
            self.problem,
            demands,
            thrusts,
            status.astype(np.int8),
            np.ones(n) if levels is None else levels,
            np.zeros(n) if violations is None else violations,
        )

    def _judge(self, demands: Array, thrusts: Array, share: float = 1.0) -> BoolArray:
        """Return (...) whether thrusts (..., n) give the demands (..., m) exactly.

        A method that still has a choice asks for a `share` of the tolerance, so that another order
        of summation does not overturn the verdict.
        """
        residual = lengths(demands - thrusts @ self.problem.gamma.T)
        return residual <= share * self.problem.tolerance(demands)

    def _status(self, u: Array, thrusts: Array) -> Status:
        return Status.EXACT if self._judge(u, thrusts) else Status.INEXACT
