"""Direct allocation."""

from __future__ import annotations

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.critical_region import AffineLaw
from ca_ros.solver.region_memory import AffineLaws
from ca_ros.vehicle.vehicle import Vehicle

GOLDEN = (5.0**0.5 - 1.0) / 2.0


class Direct(Allocator):
    """As much of the wrench as is possible in its direction, Eqs. (14)-(17).

    ``max alpha`` subject to ``Gamma f = alpha u``, the bounds and 0 <= alpha <= 1: a linear
    program, whose solution is a vertex.  alpha is read off the facets of the admissible set.
    Where several vertices give the same alpha, as for every wrench inside the set, the paper
    leaves the choice to its solver; here the least of a cost without symmetries decides, so that
    there is one answer.  The dual simplex method of HiGHS finds it, and each basis that it finds
    is a law for all wrenches that have it.

    The status is SCALED if alpha < 1, and REJECTED if not even a share of the wrench can be given
    (the rotors cannot stand still, so zero is not attainable).

    Raises
    ------
    ValueError
        If the vehicle's admissible set has no volume.
    """

    def __init__(self, vehicle: Vehicle | AllocationProblem) -> None:
        super().__init__(vehicle)
        # Imported here: it takes longer than all else that a node imports, and only this method
        # needs it.
        from scipy.optimize import linprog

        self._linprog = linprog
        # Multiples of the golden ratio, less whole numbers: as far from each other as can be.
        self.cost = 1.0 + np.arange(1, vehicle.n + 1) * GOLDEN % 1.0
        self._image = self.problem.image
        self._laws = AffineLaws(vehicle.n, self._learn)

    def levels(self, demands: Array) -> Array:
        """Return alpha (...) for wrenches (..., m); NaN if there is none."""
        image = self._image
        middle = image.normals @ image.center
        rates = demands @ image.normals.T
        # For each pair of facets, alpha rates is within the width of the middle.
        slanted = image.slanted(rates, demands)
        with np.errstate(all='ignore'):
            ends = (middle + np.sign(rates) * image.widths) / rates
        levels = np.clip(np.where(slanted, ends, np.inf).min(axis=-1), -1.0, 1.0)
        served = levels[..., None] * demands
        given = (levels >= 0.0) & (image.margin(served) >= -0.5 * self.problem.tolerance(served))
        return np.where(given, levels, np.nan)

    def _allocate(self, u: Array) -> Allocation:
        level = float(self.levels(u))
        if np.isnan(level):
            return Allocation(self.problem, u, self.problem.lower.copy(), Status.REJECTED, 0.0)
        served = level * u
        thrusts = self._laws.find_or_learn(served)
        if not self._judge(served, thrusts):
            thrusts = self._settled(served, thrusts)
        if self._judge(u, thrusts):
            return Allocation(self.problem, u, thrusts, Status.EXACT)
        status = Status.SCALED if self._judge(served, thrusts) else Status.INEXACT
        return Allocation(self.problem, u, thrusts, status, level)

    def _allocate_batch(self, demands: Array) -> Allocation:
        levels = self.levels(demands)
        given = ~np.isnan(levels)
        served = np.where(given, levels, 0.0)[:, None] * demands
        thrusts = np.tile(self.problem.lower, (len(demands), 1))
        thrusts[given] = self._laws.find_or_learn_batch(served[given])
        for i in np.flatnonzero(~self._judge(served, thrusts) & given):
            thrusts[i] = self._settled(served[i], thrusts[i])
        status = np.full(len(demands), Status.INEXACT, dtype=np.int8)
        status[self._judge(served, thrusts)] = Status.SCALED
        exact = self._judge(demands, thrusts) & given
        status[exact], levels[exact] = Status.EXACT, 1.0
        status[~given], levels[~given] = Status.REJECTED, 0.0
        return self._batch(demands, thrusts, status, levels)

    def _learn(self, u: Array) -> tuple[Array, AffineLaw | None]:
        """Return the cheapest thrusts that give u, and the law of their basis."""
        gamma, low, high = self.problem.gamma, self.problem.lower, self.problem.upper
        for inwards in (0.0, 1e-6, 1e-8):
            # A wrench on the border of a basis's region does not determine it; one beside it does.
            thrusts = self._cheapest(u + inwards * (self._image.center - u))
            if thrusts is None:
                continue
            room = np.minimum(thrusts - low, high - thrusts)
            free = room > 1e-9 * (1.0 + high)
            if free.sum() != len(gamma) or np.linalg.cond(gamma[:, free]) > 1e12:
                continue
            ends = np.where(free, 0.0, np.where(thrusts - low < high - thrusts, low, high))
            slope = np.zeros_like(gamma.T)
            slope[free] = np.linalg.inv(gamma[:, free])
            law = AffineLaw.of(slope, ends - slope @ (gamma @ ends), free, ends, low, high)
            z = slope @ u + law.offset
            if np.all((law.least <= z) & (z <= law.greatest)):
                return self.problem.clip(z), law
        return self._vertex(u), None

    def _vertex(self, u: Array) -> Array:
        """Return the cheapest thrusts that give u, without the solver's tolerance."""
        thrusts = self._cheapest(u)
        if thrusts is None:
            # Lost between facets that are almost parallel: then any thrusts that give u.
            return self.problem.least_norm.solve(u, float(self.problem.tolerance(u)))[0]
        return self._settled(u, thrusts)

    def _settled(self, u: Array, thrusts: Array) -> Array:
        tolerance = 0.5 * float(self.problem.tolerance(u))
        return self.problem.least_norm.settle(thrusts, u, tolerance)

    def _cheapest(self, u: Array) -> Array | None:
        """Return the thrusts that HiGHS finds, if any."""
        # Imported here: SciPy's optimizers take most of the time of `import ca_ros`.

        gamma = self.problem.gamma
        size = np.linalg.norm(gamma, axis=1)
        tolerance = 1e-10
        solution = self._linprog(
            self.cost,
            A_eq=gamma / size[:, None],
            b_eq=u / size,
            bounds=np.column_stack([self.problem.lower, self.problem.upper]),
            method='highs-ds',
            options={
                'primal_feasibility_tolerance': tolerance,
                'dual_feasibility_tolerance': tolerance,
            },
        )
        return None if solution.x is None else self.problem.clip(solution.x)
