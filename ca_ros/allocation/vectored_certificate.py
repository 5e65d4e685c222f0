"""The certificate of an allocation of vectors in convex sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ca_ros.arrays import Array
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.vectored import VectoredProblem


@dataclass(frozen=True, eq=False)
class VectoredCertificate:
    """Numbers that prove an allocation; for a batch of N, each has a leading N.

    They are computed from the matrix, the sets, the demand and the vectors alone.

    - `demand` (m,)
    - `primal_residual`: |u - B x| [N, N m]
    - `bound_violation`: greatest distance of a component from the projection on the sets: rounding
      only [N]
    - `multipliers` (m,): multipliers y of B x = B x* for the vectors x* of the answer
    - `kkt_residual`: greatest |x - P(x_p + W^-2 B^T y)| [N]
    - `gap`: duality gap: |W (x - x_p)|^2 / 2 is at most this much greater than that of any other
      vectors in the sets with the same wrench.  On the boundary, where no multipliers may exist,
      the gap is small even if `kkt_residual` is not
    """

    demand: Array
    primal_residual: float | Array
    bound_violation: float | Array
    multipliers: Array
    kkt_residual: float | Array
    gap: float | Array
    problem: VectoredProblem

    @cached_property
    def margin(self) -> Array:
        """Signed distance of u to the boundary of the attainable set, positive inside [N, N m].

        An upper bound; `SupportedSet.margin_bounds` has the lower one.
        """
        return self.problem.attainable_set.margin(self.demand)

    def __str__(self) -> str:
        """Summarise the certificate, without the margin, which takes longer."""
        return (
            f'residual up to {np.max(self.primal_residual):.1e}, KKT residual up to '
            f'{np.max(self.kkt_residual):.1e}{self.problem.unit}, duality gap up to '
            f'{np.max(self.gap):.1e}'
        )


def certify_vectors(
    problem: VectoredProblem, demand: Array, vectors: Array,
    preference: tuple[Array, Array] | None = None,
) -> VectoredCertificate:
    """Return the certificate of vectors (..., n) for demands (..., m)."""
    solver = sets_newton(problem.gamma, problem.sets, *(preference or (None, None)))
    wrenches = vectors @ problem.gamma.T
    rows = wrenches.reshape(-1, wrenches.shape[-1])
    found = solver.solve(rows)
    multipliers = found.multipliers.reshape(wrenches.shape)
    return VectoredCertificate(
        demand=demand, primal_residual=np.linalg.norm(problem.residual(demand, vectors), axis=-1),
        bound_violation=problem.violation(vectors), multipliers=multipliers,
        kkt_residual=np.abs(vectors - solver.least_norm(multipliers)).max(axis=-1),
        gap=solver.gap(wrenches, vectors, multipliers), problem=problem,
    )
