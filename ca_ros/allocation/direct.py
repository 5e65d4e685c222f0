"""Direct allocation."""

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array
from ca_ros.solver.lexicographic_lp import Simplex

GOLDEN = (5.0**0.5 - 1.0) / 2.0


class Direct(Allocator):
    """Largest attainable share of the wrench, in its direction, Eqs. (14)-(17).

    The linear program is ``max alpha`` subject to ``Gamma f = alpha u``, the bounds and
    0 <= alpha <= 1; the solution is a vertex.  The facets of the admissible set determine alpha.
    If several vertices have the same alpha, as for all wrenches inside the set, the paper leaves
    the choice to the solver.  Here an asymmetric cost selects one of them, so that the solution
    is unique.  The simplex method finds it.

    The status is SCALED if alpha < 1.  It is REJECTED if no share of the wrench is attainable: if
    the rotors have positive minimum speeds, zero is not attainable, so such wrenches exist.

    Raises
    ------
    ValueError
        If the vehicle's admissible set has no volume.
    """

    solves = 'linear program: max alpha with Gamma f = alpha u within the bounds, 0 <= alpha <= 1'
    guarantees = 'the bounds, and the direction of u'

    def _set_up(self) -> None:
        problem = self.problem
        # Fractional parts of multiples of the golden ratio are far from each other.
        self.cost = 1.0 + np.arange(1, problem.n + 1) * GOLDEN % 1.0
        problem.check_volume()
        self._image = problem.box.attainable_set
        cost = self.cost * problem.half_range
        gamma = problem.gamma * problem.half_range / problem.extent[:, None]
        self._simplex = Simplex(np.vstack([gamma, cost / cost.sum()]))

    def levels(self, demands: Array) -> Array:
        """Return alpha (...) for wrenches (..., m); NaN if there is none."""
        image = self._image
        middle = image.normals @ image.center
        rates = demands @ image.normals.T
        # For each pair of facets, |alpha rate - middle| is at most the width.
        slanted = image.slanted(rates, demands)
        with np.errstate(all='ignore'):
            ends = (middle + np.sign(rates) * image.widths) / rates
        levels = np.clip(np.where(slanted, ends, np.inf).min(axis=-1), -1.0, 1.0)
        served = levels[..., None] * demands
        given = (levels >= 0.0) & (image.margin(served) >= -0.5 * self.problem.tolerance(served))
        return np.where(given, levels, np.nan)

    def _allocate(self, u: Array) -> Allocation:
        level, problem = float(self.levels(u)), self.problem
        if np.isnan(level):
            return Allocation(problem, u, problem.resting_thrusts.copy(), Status.REJECTED, 0.0)
        served = level * u
        thrusts = self._cheapest(served)
        if problem.is_exact(u, thrusts):
            return Allocation(problem, u, thrusts, Status.EXACT)
        status = Status.SCALED if problem.is_exact(served, thrusts) else Status.INEXACT
        return Allocation(problem, u, thrusts, status, level)

    def _cheapest(self, u: Array) -> Array:
        """Return the thrusts (n,) of least cost that give u: a vertex of all that give it."""
        problem, simplex = self.problem, self._simplex.copy()
        rows = range(problem.n, problem.n + len(problem.axes))
        simplex.hold(rows, problem.scaled(u).tolist())
        # The last row is the cost, and -1 is less than it can be.
        simplex.push(rows.stop, -1.0)
        shares = np.array(simplex.value[: problem.n])
        thrusts = problem.clip(problem.middle + problem.half_range * shares)
        return problem.box.least_norm.settle(thrusts, u, float(problem.tolerance(u)))
