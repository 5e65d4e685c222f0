"""Allocation problems whose effectors are vectors in convex sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import pi
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, BoolArray, IntArray, constant
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.problem import EXACT_TOLERANCE, AllocationProblem
from ca_ros.problem.supported_set import SupportedSet
from ca_ros.settings import Numbers
from ca_ros.solver.convex_sets import ConvexSet, ConvexSets, Interval, Sector
from ca_ros.solver.least_norm_over_sets import SetsNewton
from ca_ros.vehicle.validation import repeated

SHAPES = {'interval': 1, 'sector': 2, 'cone': 3, 'disc': 2}  # sets in a file, with components


class VectoredProblem(AllocationProblem):
    """Find x with u = B x, where each effector is a vector x_i in a convex set C_i.

    A rotor that tilts about one axis is a vector in a sector, a rotor on a gimbal one in a cone,
    an azimuth thruster one in a disc; a rotor that is fixed to the body is a number in an
    interval.  The thrusts of an answer are all components of these vectors, in the order of
    the columns of B.

    Arguments, attributes and errors are those of `AllocationProblem`, but for:

    - `matrix` (m, n): B, with one column for each component.  The first component of a sector is
      along its axis
    - `sets`: an `Interval` or `Sector` for each effector, with n components together
    - `effector_names`: one for each set
    - `lower`, `upper` (n,): attributes: the least box around the sets
    """

    reference_rounding = 1e-9
    sets: ConvexSets
    by_rate: BoolArray
    """Whether rates limit the length, or the tilt, of the components' vectors (n,)."""

    def __init__(
        self, matrix: ArrayLike, sets: Sequence[ConvexSet], axes: Sequence[str] | None = None,
        effector_names: Sequence[str] | None = None, reference: ArrayLike | None = None,
        effector_kind: str = 'effectors', effector_unit: str = '',
        axis_units: str | Sequence[str] = '',
    ) -> None:
        self.sets = ConvexSets(sets)
        names = effector_names or [str(i + 1) for i in range(len(sets))]
        if len(names) != len(sets):
            raise ValueError(f'effector_names: expected {len(sets)}, got {len(names)}')
        super().__init__(
            matrix, self.sets.lower, self.sets.upper, axes, component_names(names, sets),
            reference, effector_kind, effector_unit, axis_units,
        )

    def _fill(self, gamma: Array, lower: Array, upper: Array, reference: Array) -> None:
        super()._fill(gamma, lower, upper, reference)
        self.by_rate = np.zeros(self.n, dtype=bool)
        most, least = np.split(self.sets.support(np.concatenate([gamma, -gamma])), 2)
        least = -least
        self.middle = constant(self.sets.inner)
        self.center, self.extent = constant((most + least) / 2.0), constant((most - least) / 2.0)

    def with_other_sets(self, sets: ConvexSets) -> VectoredProblem:
        """Return the problem with other sets, but with the middle and the ranges of this one."""
        other = VectoredProblem.__new__(VectoredProblem)
        other.sets, other.axes = sets, self.axes
        other._fill(self.gamma, sets.lower, sets.upper, self.reference)
        other.middle, other.center, other.extent = self.middle, self.center, self.extent
        return other

    @property
    def bound_names(self) -> Sequence[str]:
        """The names (n,) of the effectors that the components belong to."""
        return [name.split('.')[0] for name in self.effector_names]

    def clip(self, thrusts: Array) -> Array:
        """Return the nearest vectors (..., n) of the sets."""
        return self.sets.project(thrusts)

    def spread(self, name: str, value: Numbers, along: bool = False) -> Array:
        """Return numbers (n,), the same for all components of a set, or `along` its axis only."""
        each = repeated(name, value, len(self.sets.sets))
        sizes = [part.size for part in self.sets.sets]
        spread = np.repeat(each, sizes)
        if along:
            spread[np.setdiff1d(range(self.n), self.sets.first)] = 0.0
        return spread

    def sizes(self, thrusts: Array) -> Array:
        """Return the length (..., k) of each effector's vector, of an interval its number."""
        return self.sets.lengths(thrusts)

    def saturation(
        self, thrusts: Array, bounds: tuple[Array, Array] | None = None
    ) -> IntArray:
        """Return (..., k) -1 at the least and +1 at the greatest length of each effector."""
        sizes, (low, high) = self.sizes(thrusts), self.sets.length_limits
        rounding = EXACT_TOLERANCE * np.maximum(1.0, high)
        at_upper = (sizes >= high - rounding).astype(np.int8)
        return np.where(sizes <= low + rounding, np.int8(-1), at_upper)

    def saturate(self, thrusts: Array) -> Array:
        """Return components (..., n) with the angle and the length of each vector clipped."""
        return self.sets.saturate(thrusts)

    def bounded(self, lower: Array, upper: Array) -> AllocationProblem:
        """Raise a TypeError: vectors are bounded by sets."""
        raise self.no_box()

    @cached_property
    def least_norm(self) -> SetsNewton:  # type: ignore[override]
        """The quadratic program of `exact` over the sets."""
        return sets_newton(self.gamma, self.sets)

    def attains(self, u: Array) -> bool:
        found = self.least_norm.solve(u[None])
        return bool(found.attained[0])

    def attains_unbounded(self, u: Array) -> bool:
        """Tell whether the pseudo-inverse of a wrench (m,) is in the sets."""
        vectors = np.linalg.pinv(self.gamma) @ u
        return bool(np.abs(vectors - self.clip(vectors)).max() < 1e-12)

    def reach(self, start: Array, direction: Array, limit: float = np.inf) -> float:
        return self.least_norm.line(start, direction, limit).length

    @property
    def simplex(self) -> NoReturn:  # type: ignore[override]
        """There is none: raise a TypeError."""
        raise self.no_box()

    @cached_property
    def attainable_set(self) -> SupportedSet:  # type: ignore[override]
        """The set without a list of facets; a ValueError if it has no volume."""
        self.check_volume()
        return SupportedSet(self.least_norm, self.center, self.extent)

    def no_box(self) -> TypeError:
        return TypeError(
            'the effectors of this problem are vectors in sets, not numbers within bounds: there '
            'are margin, contains, sample, section, projection, scale and prioritize'
        )


def problem_with(sets: Sequence[Mapping[str, Any]], **given: Any) -> VectoredProblem:
    """Return the problem of the entries of a file; a ValueError names what is wrong.

    Each set has one of `SHAPES`: an interval its ends, a sector or cone its half angle [rad] and
    the `radius`, a disc its radius.  `least` is the least component along the axis.
    """
    if not isinstance(sets, Sequence) or not all(isinstance(each, Mapping) for each in sets):
        raise ValueError(f'sets: expected a list of {", ".join(SHAPES)}, got {sets!r}')
    found = list[ConvexSet]()
    for i, each in enumerate(sets):
        shape = next((name for name in SHAPES if name in each), '')
        known = {'sector': {'radius', 'least'}, 'cone': {'radius', 'least'}}.get(shape, set())
        try:
            if not shape or {*each} - known - {shape} or ('radius' in known) > ('radius' in each):
                raise ValueError(
                    f'expected one of {", ".join(SHAPES)}, with the radius of a sector or cone, '
                    f'got {dict(each)}'
                )
            if shape == 'interval':
                found.append(Interval(*map(float, each[shape])))
            elif shape == 'disc':
                found.append(Sector(pi, float(each[shape])))
            else:
                least = float(each.get('least', 0.0))
                given_size = float(each[shape]), float(each['radius']), SHAPES[shape]
                found.append(Sector(*given_size, least))
        except (TypeError, ValueError) as error:
            raise ValueError(f'sets[{i}]: {error}') from None
    return VectoredProblem(sets=found, **given)


AllocationProblem.with_sets = staticmethod(problem_with)


def component_names(names: Sequence[str], sets: Sequence[ConvexSet]) -> list[str]:
    """Return a name for each component: of a sector's, with its number, such as ``3.1``."""
    return [
        name if each.size == 1 else f'{name}.{k + 1}'
        for name, each in zip(names, sets, strict=True) for k in range(each.size)
    ]
