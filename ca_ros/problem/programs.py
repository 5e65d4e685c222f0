"""The programs of a problem: over a box of numbers, or over vectors in convex sets.

Both classes have the same methods, for a matrix (m, n), its sets, and the middle and half of the
range of each axis, `center` and `extent` (m,).
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import comb

import numpy as np

from ca_ros.arrays import Array
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.failures import bounds_after
from ca_ros.problem.supported_set import SupportedSet
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import Box, ConvexSets
from ca_ros.solver.least_norm_over_sets import SetsNewton
from ca_ros.solver.least_norm_qp import DualNewton
from ca_ros.solver.lexicographic_lp import Simplex
from ca_ros.solver.zonotope import Zonotope

EXACT_TOLERANCE = 1e-12  # residual of an exact allocation, relative to max(1, |u|)

SEARCHED = 10**9
"""`facet_choices` of a set without facets, whose margins take a search: above all limits."""

Preference = tuple[Array, Array]


def lengths(vectors: Array) -> Array:
    """Return the Euclidean lengths (...) of vectors (..., m), faster than NumPy for short ones."""
    if vectors.ndim == 1:
        return np.sqrt(vectors.dot(vectors))
    return np.sqrt(np.einsum('...i,...i->...', vectors, vectors))


def tolerance(u: Array) -> Array:
    """Return the residual (...) up to which wrenches (..., m) count as exact [N, N m]."""
    return EXACT_TOLERANCE * np.maximum(1.0, lengths(u))


class BoxProgram:
    """The programs over effectors that are numbers within bounds.

    `served_rounding`: miss of an axis, as a share of half of its range, that counts as none.
    `reference_rounding`: share of the way to the reference that it has to be away from the
    boundary to be inside.
    `kernel`: the name of the kernel in C that allocates.
    """

    kernel = 'exact'
    served_rounding, reference_rounding = 1e-9, 1e-12

    def __init__(self, matrix: Array, sets: Box, center: Array, extent: Array) -> None:
        self.matrix, self.sets, self.box = matrix, sets, self
        self.center, self.extent = center, extent

    @cached_property
    def generators(self) -> Array:
        """What half of the range of each effector gives (m, n)."""
        return self.matrix * self.sets.half_range

    @cached_property
    def least_norm(self) -> DualNewton:
        """The quadratic program of Eqs. (20)-(22)."""
        return DualNewton(self.matrix, self.sets.lower, self.sets.upper)

    def solver(self, preference: Preference | None) -> DualNewton:
        """Return the program with weights and preferred thrusts (n,), if there are any."""
        if preference is None:
            return self.least_norm
        return DualNewton(self.matrix, self.sets.lower, self.sets.upper, *preference)

    def dual(self, wrenches: Array, preference: Preference | None = None) -> tuple[Array, Array]:
        """Return the multipliers (K, m) of wrenches (K, m), and the thrusts (K, n) they give."""
        solver = self.solver(preference)
        rows = [solver.solve(u, float(tolerance(u))).multipliers for u in wrenches]
        found = np.reshape(rows, wrenches.shape)
        return found, solver.least_norm(found)

    def thrusts(self, u: Array) -> Array:
        """Return the least thrusts (n,) of an attainable wrench (m,)."""
        return self.least_norm.solve(u, float(tolerance(u))).thrusts

    def attains(self, u: Array) -> bool:
        """Tell whether a wrench (m,) is attainable, up to `tolerance` and rounding errors."""
        thrusts = self.least_norm.unbounded(u)
        within = bool((thrusts == self.sets.project(thrusts)).all())
        return within or self.least_norm.solve(u, float(tolerance(u))).attained

    @cached_property
    def simplex(self) -> Simplex:
        """The simplex method with thrusts and axes, relative to their middles and half ranges."""
        return Simplex(self.generators / self.extent[:, None])

    def reach(self, start: Array, direction: Array, limit: float) -> float:
        """Return the greatest t <= limit for which ``start + t direction`` is attainable."""
        line, n = self.simplex.copy(), self.sets.n
        rows = range(n, n + len(start))
        line.hold(rows, ((start - self.center) / self.extent).tolist())
        way = direction / self.extent
        size = float(np.abs(way).max()) or 1.0
        length = line.add_ray(rows, (way / size).tolist())
        line.push(length, limit * size)
        return line.value[length] / size

    @cached_property
    def attainable_set(self) -> Zonotope:
        """The admissible set A of Eq. (23)."""
        return Zonotope(self.center, self.generators)

    @property
    def facet_choices(self) -> int:
        """Number of choices of m - 1 rotors; each may span a facet of `attainable_set`."""
        return comb(self.sets.n, len(self.matrix) - 1)

    def refuse_vectors(self, taker: str, others: str) -> None:
        """Do nothing: the effectors are numbers, which each `taker` takes."""

    def sets_after(
        self, shares: Array, stuck: Mapping[int, float], resting: Array, names: Sequence[str]
    ) -> Box:
        """Return the bounds after failures; see `bounds_after`."""
        return bounds_after(self.sets, shares, stuck, resting, names)


class SetsProgram:
    """The programs over effectors that are vectors in convex sets."""

    kernel = 'vectored'
    served_rounding, reference_rounding = 1e-6, 1e-9
    facet_choices = SEARCHED

    def __init__(self, matrix: Array, sets: ConvexSets, center: Array, extent: Array) -> None:
        self.matrix, self.sets, self.center, self.extent = matrix, sets, center, extent

    @property
    def box(self) -> BoxProgram:
        """There is none: raise a TypeError."""
        raise TypeError(
            'the effectors of this problem are vectors in sets, not numbers within bounds: there '
            'are margin, contains, sample, section, projection, scale and prioritize'
        )

    @cached_property
    def least_norm(self) -> SetsNewton:
        """The quadratic program of `exact` over the sets."""
        return sets_newton(self.matrix, self.sets)

    def solver(self, preference: Preference | None) -> SetsNewton:
        """Return the program with weights and preferred vectors (n,), if there are any."""
        if preference is None:
            return self.least_norm
        return sets_newton(self.matrix, self.sets, *preference)

    def dual(self, wrenches: Array, preference: Preference | None = None) -> tuple[Array, Array]:
        """Return the multipliers (K, m) of wrenches (K, m), and the vectors (K, n) they give."""
        solver = self.solver(preference)
        found = solver.solve(wrenches).multipliers
        return found, solver.least_norm(found)

    def thrusts(self, u: Array) -> Array:
        """Return the least vectors (n,) of an attainable wrench (m,)."""
        return self.least_norm.solve(u[None]).points[0]

    def attains(self, u: Array) -> bool:
        """Tell whether a wrench (m,) is attainable."""
        vectors = np.linalg.pinv(self.matrix) @ u
        within = bool(np.abs(vectors - self.sets.project(vectors)).max() < 1e-12)
        return within or bool(self.least_norm.solve(u[None]).attained[0])

    def reach(self, start: Array, direction: Array, limit: float) -> float:
        """Return the greatest t <= limit for which ``start + t direction`` is attainable."""
        return self.least_norm.line(start, direction, limit).length

    @cached_property
    def attainable_set(self) -> SupportedSet:
        """The set without a list of facets."""
        return SupportedSet(self.least_norm, self.center, self.extent)

    def refuse_vectors(self, taker: str, others: str) -> None:
        """Raise a ParameterError: a `taker` takes numbers alone; `others` says what else does."""
        raise ParameterError(
            f'{taker} takes effectors that are numbers within bounds, not vectors in sets such as '
            f'rotors that tilt: {others}'
        )

    def sets_after(
        self, shares: Array, stuck: Mapping[int, float], resting: Array, names: Sequence[str]
    ) -> ConvexSets:
        """Return the sets after failures: the same; raise a ParameterError if effectors stick."""
        if stuck:
            raise ParameterError(
                'stuck: effectors that are vectors in sets cannot stick; give the matrix and the '
                'sets that are left'
            )
        return self.sets


def program_of(
    matrix: Array, sets: Box | ConvexSets, center: Array, extent: Array
) -> BoxProgram | SetsProgram:
    """Return the programs for a matrix, its sets, and the middles and half ranges of the axes."""
    if isinstance(sets, Box):
        return BoxProgram(matrix, sets, center, extent)
    return SetsProgram(matrix, sets, center, extent)
