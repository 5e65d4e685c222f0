"""Direct allocation."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation, Status
from ca_ros.arrays import Array


class Direct(Allocator):
    """As much of the wrench as is possible in its direction, Eqs. (14)-(17).

    ``max alpha`` subject to ``Gamma f = alpha u``, the bounds and 0 <= alpha <= 1: a linear
    program, solved by the dual simplex method of HiGHS, so that f is a vertex as in the paper.
    The status is SCALED if alpha < 1, and REJECTED if not even a share of the wrench can be given
    (the rotors cannot stand still, so zero is not attainable).
    """

    def _allocate(self, u: Array) -> Allocation:
        problem = self.problem
        size = np.linalg.norm(u)
        # In units of |u| alpha is as large as the thrusts, and a tolerance means the same for
        # both.
        direction = u / size if size > 0.0 else u
        cost = np.zeros(len(problem.lower) + 1)
        cost[-1] = -1.0
        solution = linprog(
            cost,
            A_eq=np.column_stack([problem.gamma, -direction]),
            b_eq=np.zeros(len(u)),
            bounds=np.column_stack(
                [np.append(problem.lower, 0.0), np.append(problem.upper, size)]
            ),
            method='highs-ds',
            options={'primal_feasibility_tolerance': 1e-10, 'dual_feasibility_tolerance': 1e-10},
        )
        if solution.status != 0:
            return Allocation(problem, u, problem.lower.copy(), Status.REJECTED, level=0.0)
        thrusts = self._refine(solution.x[:-1], solution.x[-1] * direction)
        level = float(solution.x[-1] / size) if size > 0.0 else 1.0
        if self._judge(u, thrusts):
            return Allocation(problem, u, thrusts, Status.EXACT)
        served = self._judge(level * u, thrusts) and level < 1.0
        return Allocation(
            problem, u, thrusts, Status.SCALED if served else Status.INEXACT, level=level
        )

    def _refine(self, vertex: Array, wrench: Array) -> Array:
        """Take the solver's tolerance out of the rotors that are between their bounds."""
        problem = self.problem
        thrusts = problem.clip(vertex)
        free = (thrusts > problem.lower) & (thrusts < problem.upper)
        correction = np.linalg.lstsq(
            problem.gamma[:, free], wrench - problem.gamma @ thrusts, rcond=None
        )[0]
        thrusts[free] += correction
        return problem.clip(thrusts)
