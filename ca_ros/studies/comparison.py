"""Allocators for comparison, which only the studies have."""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from ca_ros.allocation import Allocation, AllocationProblem, Allocator
from ca_ros.allocation.direct import Direct
from ca_ros.allocation.exact import Exact
from ca_ros.allocation.osqp import Osqp
from ca_ros.allocation.pseudo_inverse import PseudoInverse
from ca_ros.arrays import Array
from ca_ros.problem.prioritization import default_order


class FixedPseudoInverse(PseudoInverse):
    """The clipped pseudo-inverse computed once, for sound rotors.

    The share of a lost rotor is lost and not given to the others.
    """

    def _set_up(self) -> None:
        super()._set_up()
        self.inverse = np.linalg.pinv(self.problem.gamma)


class DirectAboutHover(Allocator):
    """Direct allocation of the change from hover, which keeps the direction of this change.

    From zero, which rotors that cannot stop cannot produce, it has no answer to many wrenches.
    """

    def _set_up(self) -> None:
        whole, reference = self.problem, self.problem.reference
        self._still = Exact(whole).allocate(reference).thrusts
        bounds = whole.lower - self._still, whole.upper - self._still
        self._direct = Direct(AllocationProblem(whole.gamma, *bounds, axes=whole.axes))

    def _allocate(self, u: Array) -> Allocation:
        change = self._direct.allocate(u - self.problem.reference).thrusts
        thrusts = self.problem.clip(self._still + change)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))


class TightOsqp(Osqp):
    """`Osqp` at tolerances of 1e-8, as tight as the paper's own."""

    options: ClassVar[dict[str, Any]] = {'eps_abs': 1e-8, 'eps_rel': 1e-8}


class HierarchicalDaqp(Allocator):
    """The hierarchical program of DAQP, see `hierarchical`; a ValueError without the package."""

    def _set_up(self) -> None:
        try:
            self._solve = hierarchical(self.problem)
        except ImportError:
            raise ValueError('hierarchical DAQP needs daqp (pip install daqp)') from None

    def _allocate(self, u: Array) -> Allocation:
        wanted, _, flag, _ = self._solve(u)
        return self._clipped(u, np.where(flag > 0, wanted, np.nan))


def hierarchical(problem: AllocationProblem) -> Callable[[Array], Any]:
    """Return the call of DAQP for least norm, bounds first, then groups of axes in turn.

    The groups are those of `default_order`.  Of each group DAQP minimises the 2-norm of what is
    missed, without keeping direction or sense; the call returns thrusts, value, flag, facts.
    """
    import daqp

    groups, n = default_order(problem.axes), problem.n
    rows = [problem.axes.index(axis) for group in groups for axis in group]
    # The first n rows are bounds; each level ends at a break point.
    ends = np.cumsum([n, *map(len, groups)]).astype(np.intc)
    program = np.eye(n), np.zeros(n), problem.gamma[rows]
    low = np.concatenate([problem.lower, np.zeros(len(rows))])
    high, sense = np.concatenate([problem.upper, np.zeros(len(rows))]), np.zeros(ends[-1], np.intc)

    def call(u: Array) -> Any:
        low[n:] = high[n:] = u[rows]
        # DAQP writes into what it is given.
        return daqp.solve(*program, high.copy(), low.copy(), sense.copy(), ends)

    return call


FOR_COMPARISON: dict[str, type[Allocator]] = {
    'osqp_tight': TightOsqp, 'daqp_hierarchical': HierarchicalDaqp,
    'direct_about_hover': DirectAboutHover, 'fixed_pseudo_inverse': FixedPseudoInverse,
}
