"""The certificate of an allocation: residuals that prove its optimality."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.problem import AllocationProblem

Number = TypeVar('Number', float, Array)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Certificate(Generic[Number]):
    """What proves an answer; for a batch of N, each field has a leading N.

    A `Number` is a float, for a batch an array (N,).

    After failures, `problem`, `demand` and `multipliers` have the axes that the method serves.

    - `demand` (m,)
    - `primal_residual`: |u - Gamma f| of all axes, also of lost ones [N, N m]
    - `bound_violation`: greatest violation of a bound by the thrusts [N], which is zero; of
      vectors in sets, greatest distance of a component from the projection on the sets: rounding
    - `multipliers` (m,): multipliers y of Gamma f = u in the quadratic program of Eqs. (20)-(22),
      for the wrench that the thrusts give
    - `kkt_residual`: greatest |f - P(Gamma^T y)| [N], where P clips, or projects on the sets.  It
      is zero if and only if the thrusts have the least norm of all that produce the same wrench.
      With weights and preferred thrusts, the norm is |W (f - f_p)|, and Gamma^T y becomes f_p +
      W^-2 Gamma^T y
    - `gap`: |W (f - f_p)|^2 / 2 is at most this much greater than that of any other thrusts for
      the same wrench.  On the boundary of the set of vectors no multipliers may exist: the nearer
      vectors come to it, the greater multipliers grow.  Theirs end at a finite length, and
      `kkt_residual` with them: up to 4e-5 N on the shipped vehicles, inside the set up to 1e-10
    - `wider`: the problem, if `problem` has narrower bounds: what the effectors reach at their
      rates
    """

    problem: AllocationProblem
    demand: Array
    primal_residual: Number
    bound_violation: Number
    multipliers: Array
    kkt_residual: Number
    gap: Number
    wider: AllocationProblem

    @cached_property
    def margin(self) -> Number:
        """Signed distance of u to the boundary of the admissible set, positive inside [N, N m].

        For vectors in sets an upper bound; `SupportedSet.margin_bounds` has the lower one.
        """
        margin: Any = self.problem.attainable_set.margin(self.demand)
        return margin  # type: ignore[no-any-return]

    @cached_property
    def limit(self) -> Array | None:
        """The nearest facet of the admissible set by the state of the rotors on it, (n,).

        At the upper bound (+1), at the lower bound (-1), or free (0).  None if the set has no list
        of facets.
        """
        return self.problem.program.attainable_set.nearest_facet(self.demand)

    @property
    def rate_limited(self) -> BoolArray:
        """Which effectors of `limit` are at bounds that are narrower than the problem's, (n,)."""
        limit, near, wide = self.limit, self.problem, self.wider
        if limit is None:
            return np.zeros(near.n, dtype=bool)
        slow = (limit > 0) & (near.upper < wide.upper)
        return np.asarray(slow | ((limit < 0) & (near.lower > wide.lower)))

    def __str__(self) -> str:
        """Summarise the certificate; for a batch, its largest residuals and its least margin.

        Without a list of facets it has the gap instead of the margin, which takes a search.
        """
        unit, limit = self.problem.unit, self.limit
        worst = (
            f'residual up to {np.max(self.primal_residual):.1e}, KKT residual up to '
            f'{np.max(self.kkt_residual):.1e}{unit}'
        )
        if limit is None:
            return f'{worst}, duality gap up to {np.max(self.gap):.1e}'
        if np.ndim(self.margin):
            least = f'least margin {np.min(self.margin):.3g}'
            return f'{np.size(self.margin)} allocations: {worst}; {least}'
        names, kind = self.problem.effector_names, self.problem.effector_kind
        groups = {
            name: [names[i] for i in np.flatnonzero(limit == value)]
            for name, value in (('maximum', 1), ('minimum', -1))
        }
        ends = ' and '.join(
            f'{kind if len(some) > 1 else kind.removesuffix("s")} {", ".join(some)} at {name}'
            for name, some in groups.items() if some)
        if (slow := np.flatnonzero(self.rate_limited)).size:
            ends = f'{ends} ({", ".join(names[i] for i in slow)} by their rates)'
        return (
            f'residual {_size(self.primal_residual)}, '
            f'KKT residual {_size(self.kkt_residual)}{unit}; '
            f'margin {self.margin:.3g}' + (f' to the facet with {ends}' if ends else '')
        )

    def __repr__(self) -> str:
        """Return the summary, with the class."""
        return f'{type(self).__name__}: {self}'


def _size(number: Any) -> str:
    return 'below 1e-12' if number < 1e-12 else f'{number:.1e}'


def certify(
    problem: AllocationProblem, demand: Array, thrusts: Array,
    preference: tuple[Array, Array] | None = None, bounds: tuple[Array, Array] | None = None,
) -> Certificate[Any]:
    """Return the certificate of thrusts (..., n) [N] for demands (..., m) [N, N m].

    `preference` has the weights and the preferred thrusts, (n,) each [1, N]; `bounds` are narrower
    bounds (n,) of one answer [N].
    """
    wider = problem
    if bounds is not None:
        problem = problem.bounded(*bounds)
        problem.check_volume()
    wrench = thrusts @ problem.gamma.T
    found = problem.program.dual(wrench.reshape(-1, wrench.shape[-1]), preference)
    multipliers, least = found[0].reshape(wrench.shape), found[1].reshape(thrusts.shape)
    weights, preferred = (1.0, 0.0) if preference is None else preference
    cost, lowest = (0.5 * ((weights * (f - preferred)) ** 2).sum(-1) for f in (thrusts, least))
    missed = wrench - least @ problem.gamma.T
    return Certificate(
        problem=problem, demand=demand, wider=wider, multipliers=multipliers,
        primal_residual=np.linalg.norm(problem.residual(demand, thrusts), axis=-1),
        bound_violation=problem.violation(thrusts),
        kkt_residual=np.abs(thrusts - least).max(axis=-1),
        # The gap cannot be negative; where it seems to be, it is a rounding error.
        gap=np.maximum(cost - lowest - (multipliers * missed).sum(-1), 0.0),
    )
