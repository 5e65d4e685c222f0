"""The certificate of an allocation: residuals that prove its optimality."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vectored import VectoredProblem
from ca_ros.solver.least_norm_qp import DualNewton


@dataclass(frozen=True, eq=False, kw_only=True)
class Residuals:
    """What both kinds of certificates have; for a batch of N, each field has a leading N.

    - `primal_residual`: |u - Gamma f| [N, N m]
    - `bound_violation`: greatest violation of a bound by the thrusts [N], which is zero; of
      vectors in sets, greatest distance of a component from the projection on the sets: rounding
    - `multipliers` (m,): multipliers y of Gamma f = u in the quadratic program of Eqs. (20)-(22),
      for the wrench that the thrusts give
    - `kkt_residual`: greatest |f - P(Gamma^T y)| [N], where P clips, or projects on the sets.  It
      is zero if and only if the thrusts have the least norm of all that produce the same wrench.
      With weights and preferred thrusts, the norm is |W (f - f_p)|, and Gamma^T y becomes f_p +
      W^-2 Gamma^T y
    """

    problem: AllocationProblem
    primal_residual: float | Array
    bound_violation: float | Array
    multipliers: Array
    kkt_residual: float | Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Certificate(Residuals):
    """`Residuals`, and the nearest facet of the admissible set.

    - `margin`: signed distance of u to the boundary of the admissible set, positive inside [N, N
      m]
    - `limit` (n,): the nearest facet, by the state of the rotors on it: at the upper bound (+1),
      at the lower bound (-1), or free (0)
    - `rate_limited` (n,): which of these rotors are at bounds that are narrower than those of the
      problem: what they reach at their rates
    """

    margin: float | Array
    limit: Array
    rate_limited: BoolArray

    def __str__(self) -> str:
        """Summarise the certificate; for a batch, its largest residuals and its least margin."""
        unit = self.problem.unit
        if np.ndim(self.margin):
            return (
                f'{np.size(self.margin)} allocations: residual up to '
                f'{np.max(self.primal_residual):.1e}, KKT residual up to '
                f'{np.max(self.kkt_residual):.1e}{unit}; least margin {np.min(self.margin):.3g}'
            )
        names = self.problem.effector_names
        groups = {
            name: ', '.join(names[i] for i in np.flatnonzero(self.limit == value))
            for name, value in (('maximum', 1), ('minimum', -1))
        }
        ends = ' and '.join(f'{rotors} at {name}' for name, rotors in groups.items() if rotors)
        if self.rate_limited.any():
            slow = ', '.join(names[i] for i in np.flatnonzero(self.rate_limited))
            ends = f'{ends} ({slow} by their rates)'
        return (
            f'residual {_size(self.primal_residual)}, '
            f'KKT residual {_size(self.kkt_residual)}{unit}; '
            f'margin {self.margin:.3g} to the facet with {self.problem.effector_kind} {ends}'
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class VectoredCertificate(Residuals):
    """`Residuals` of vectors in convex sets, and the duality gap.

    - `demand` (m,)
    - `gap`: |W (x - x_p)|^2 / 2 is at most this much greater than that of any other vectors in the
      sets with the same wrench.  On the boundary, where no multipliers may exist, the gap is small
      even if `kkt_residual` is not
    """

    problem: VectoredProblem
    demand: Array
    gap: float | Array

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


def _size(number: float | Array) -> str:
    return 'below 1e-12' if number < 1e-12 else f'{number:.1e}'


def certify(
    problem: AllocationProblem, demand: Array, thrusts: Array,
    preference: tuple[Array, Array] | None = None, bounds: tuple[Array, Array] | None = None,
) -> Certificate | VectoredCertificate:
    """Return the certificate of thrusts (..., n) [N] for demands (..., m) [N, N m].

    `preference` has the weights and the preferred thrusts, (n,) each [1, N]; `bounds` are narrower
    bounds (n,) of one answer [N].
    """
    if bounds is not None:
        moved = problem.bounded(*bounds)
        moved.check_volume()
        found = certify(moved, demand, thrusts, preference)
        assert isinstance(found, Certificate)
        slow = (found.limit > 0) & (moved.upper < problem.upper)
        slow |= (found.limit < 0) & (moved.lower > problem.lower)
        return replace(found, rate_limited=slow)
    wrench = thrusts @ problem.gamma.T
    rows = wrench.reshape(-1, wrench.shape[-1])
    residual = np.linalg.norm(problem.residual(demand, thrusts), axis=-1)
    violation = problem.violation(thrusts)
    if isinstance(problem, VectoredProblem):
        newton = sets_newton(problem.gamma, problem.sets, *(preference or ()))
        multipliers = newton.solve(rows).multipliers.reshape(wrench.shape)
        return VectoredCertificate(
            problem=problem, primal_residual=residual, bound_violation=violation,
            multipliers=multipliers, demand=demand,
            kkt_residual=np.abs(thrusts - newton.least_norm(multipliers)).max(axis=-1),
            gap=newton.gap(wrench, thrusts, multipliers),
        )
    solver = problem.least_norm
    if preference is not None:
        solver = DualNewton(problem.gamma, problem.lower, problem.upper, *preference)
    solved = [solver.solve(row, float(problem.tolerance(row))).multipliers for row in rows]
    multipliers = np.array(solved).reshape(wrench.shape)
    image = problem.attainable_set
    heights = (demand - image.center) @ image.normals.T
    slacks = image.widths - np.abs(heights)
    nearest = np.argmin(slacks, axis=-1)
    side = np.take_along_axis(np.sign(heights), nearest[..., None], axis=-1)
    return Certificate(
        problem=problem, primal_residual=residual, bound_violation=violation,
        multipliers=multipliers,
        kkt_residual=np.abs(thrusts - solver.least_norm_thrusts(multipliers)).max(axis=-1),
        margin=slacks.min(axis=-1), limit=np.sign(side * image.sides[nearest]).astype(np.int8),
        rate_limited=np.zeros(thrusts.shape, dtype=bool),
    )
