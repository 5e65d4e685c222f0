"""The admissible set: all wrenches that the rotors can produce within their bounds."""

from collections.abc import Sequence
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, BoolArray, constant
from ca_ros.problem.prioritization import (
    AXIS_REVERSAL,
    AXIS_REVERSALS,
    airmode_limits,
    default_order,
    groups_of,
)
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.sets_prioritization import PRIORITIZATIONS, AnyPrioritization
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.settings import Numbers, ParameterError
from ca_ros.solver.polytope import Polytope, ordered
from ca_ros.solver.zonotope import Zonotope
from ca_ros.vehicle.vehicle import Vehicle

REACHED = 1e-9  # how far outside a reference may be, over its distance from the centre


class AdmissibleSet:
    """The set A of Eq. (23): the image of the box of thrusts under Gamma, a zonotope.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem

    Raises
    ------
    ValueError
        If the set has no volume: the rotors cannot control the axes independently.

    Examples
    --------
    >>> inside = AdmissibleSet(Vehicle.load('hexarotor'))
    >>> inside.contains([[9.81, 1.0, 0.0, 0.0], [9.81, 3.0, 0.0, 0.0]])
    array([ True, False])
    """

    def __init__(self, problem: Vehicle | AllocationProblem) -> None:
        self.problem = problem_of(problem)
        self.problem.check_volume()
        self._prioritizations: dict[object, AnyPrioritization] = {}

    def __repr__(self) -> str:
        """Return the problem of the set, in one line."""
        return f'AdmissibleSet: {self.problem.described}'

    @cached_property
    def reference(self) -> Array:
        """The problem's reference if it is inside the set, else the centre (m,) [N, N m]."""
        problem = self.problem
        return problem.reference if problem.interior.has_reference else self.center

    @property
    def zonotope(self) -> Zonotope:
        """The set as a zonotope; its facets are computed at the first access."""
        self.problem.check_volume()
        return self.problem.box.attainable_set

    @property
    def facets(self) -> tuple[Array, Array]:
        """Outward unit normals (F, m) and offsets (F,): ``normals @ u <= offsets`` [N, N m]."""
        return self.zonotope.facets

    @property
    def center(self) -> Array:
        """A wrench inside (m,), the centre of symmetry if no effector is a vector [N, N m]."""
        return self.problem.gamma @ self.problem.middle

    @property
    def volume(self) -> float:
        """Volume of the set; [N (N m)^3] for the usual four axes."""
        return self.zonotope.volume

    @cached_property
    def vertices(self) -> Array:
        """The vertices (V, m) of the set [N, N m]."""
        return constant(self.zonotope.vertices)

    def section(self, axes: Sequence[str], at: ArrayLike | None = None) -> Polytope:
        """Cut the set: fix all axes but `axes`, which stay in their order.

        The polytope is empty if no wrench of the set has the fixed values; of three or more axes,
        also without volume.  Raises a ValueError if an axis is unknown or repeated, or `at` is not
        a wrench.

        `at` (m,): a wrench with the values of the other axes; by default `reference` [N, N m].
        """
        rows = self._rows(axes)
        wrench = self.reference if at is None else self.problem.check(at)
        return Polytope(tuple(axes), ordered(self.problem.attainable_set.section(rows, wrench)))

    def projection(self, axes: Sequence[str]) -> Polytope:
        """Project the set to `axes`: let all other axes be anything that is attainable.

        Raises a ValueError if an axis is unknown or repeated.
        """
        rows = self._rows(axes)
        return Polytope(tuple(axes), ordered(self.problem.attainable_set.shadow(rows)))

    def authority(self, u: ArrayLike) -> dict[str, tuple[float, float]]:
        """Return the ends of each axis, by its name, while the others stay at u [N, N m].

        The ends are NaN if the other axes cannot have their values.

        `u` (m,): a wrench, as of hover or a manoeuvre [N, N m].
        """
        wrench = self.problem.check(u)
        found = {}
        for axis in self.problem.axes:
            ends = self.section([axis], wrench).vertices
            found[axis] = (nan, nan) if len(ends) == 0 else (float(ends[0, 0]), float(ends[-1, 0]))
        return found

    def _rows(self, axes: Sequence[str]) -> list[int]:
        known = self.problem.axes
        if isinstance(axes, str) or not axes or len(set(axes)) < len(axes) or set(axes) - {*known}:
            raise ValueError(f'axes: expected different ones of {", ".join(known)}, got {axes!r}')
        return [known.index(axis) for axis in axes]

    def margin(self, u: ArrayLike) -> Array:
        """Return the signed distance (...) of wrenches (..., m) to the boundary [N, N m].

        It is the least slack over the facets with unit normals.  Inside the set it is positive,
        and the Euclidean distance to the boundary.
        """
        return self.problem.attainable_set.margin(self.problem.check(u, batch=True))

    def contains(self, u: ArrayLike, tolerance: float = 0.0) -> BoolArray:
        """Tell which wrenches (..., m) lie in the set, up to `tolerance` in the margin."""
        return self.problem.attainable_set.contains(self.problem.check(u, batch=True), tolerance)

    def scale(self, u: ArrayLike, scale_reference: ArrayLike | None = None) -> Array:
        """Bring wrenches (..., m) into the set along the straight line to a reference [N, N m].

        The result is `u` if it is in the set, otherwise the last point in the set on the line from
        the reference to `u`.  Raises a ValueError if `scale_reference` is outside the set.

        `scale_reference` (m,): a wrench in the set; by default `reference` [N, N m].
        """
        u, start = self.problem.check(u, batch=True), self.reference
        if scale_reference is not None:
            start = self.check_reference(scale_reference)
        everything = [list(range(len(self.problem.axes)))]
        serve = self._prioritization(everything, start, begin=start)
        return self._serve(serve, u)[0]

    def prioritize(
        self, u: ArrayLike, order: Sequence[Sequence[str]] | None = None,
        axis_reversal: str = AXIS_REVERSAL, airmode_limit: Numbers = 1.0,
    ) -> Array:
        """Bring wrenches (..., m) into the set, less important axes given up first [N, N m].

        With the default order, roll and pitch get as much of their demand as possible, with their
        ratio kept.  Then the sign of yaw is kept: yaw is not reversed, does not exceed its demand
        and does not change without a demand, as long as a deviation of thrust can prevent this.
        Then thrust gets as close to its demand as possible, and then yaw.  See `Prioritization`
        for other orders, and `PrioritiesSettings` for the arguments.

        The result is `u` if it is in the set, otherwise the wrench that is served.  Raises a
        ValueError if `order` does not name each of the vehicle's axes once, or `axis_reversal`
        is unknown.
        """
        return self.prioritize_levels(u, order, axis_reversal, airmode_limit)[0]

    def prioritize_levels(
        self, u: ArrayLike, order: Sequence[Sequence[str]] | None = None,
        axis_reversal: str = AXIS_REVERSAL, airmode_limit: Numbers = 1.0,
    ) -> tuple[Array, Array]:
        """Like `prioritize`, but also return the share (..., m) of its demand that each axis gets.

        The share is relative to hover: 0 for an axis that is reversed or does not change, 1 for an
        axis that gets all of its demand or more.
        """
        serve = self.check_order(order, axis_reversal, airmode_limit)
        return self._serve(serve, self.problem.check(u, batch=True))

    def _serve(self, serve: AnyPrioritization, u: Array) -> tuple[Array, Array]:
        """Return the served wrenches and levels for wrenches (..., m)."""
        served, levels = u.copy(), np.ones(u.shape)
        if u.ndim == 1:
            # For a single wrench, computing all facets would take too long.
            if self.problem.program.attains(u):
                return served, levels
            answer = serve(u)
            return answer.wrenches, answer.levels
        outside = ~self.contains(served)
        if outside.any():
            answers = serve(served[outside])
            served[outside], levels[outside] = answers.wrenches, answers.levels
        return served, levels

    def check_reference(self, scale_reference: ArrayLike) -> Array:
        """Return a reference (m,) of `scale`; raise a ValueError if it is outside the set."""
        start = self.problem.check(scale_reference, name='scale_reference')
        if self.problem.reach(self.center, start - self.center, 1.0) < 1.0 - REACHED:
            raise ParameterError(f'scale_reference: expected an attainable wrench, got {start}')
        return start

    def check_order(
        self, order: Sequence[Sequence[str]] | None, axis_reversal: str = AXIS_REVERSAL,
        airmode_limit: Numbers = 1.0,
    ) -> AnyPrioritization:
        """Return the prioritization of an order; raise a ValueError if an argument is wrong."""
        limits = airmode_limits(airmode_limit)
        key = (None if order is None else tuple(map(tuple, order))), axis_reversal, limits
        if key not in self._prioritizations:
            if axis_reversal not in AXIS_REVERSALS:
                raise ValueError(
                    f'axis_reversal: expected one of {", ".join(AXIS_REVERSALS)}, '
                    f'got {axis_reversal!r}'
                )
            axes = self.problem.axes
            groups = default_order(axes) if order is None else groups_of(order, axes)
            rows = [[axes.index(axis) for axis in group] for group in groups]
            self._prioritizations[key] = self._prioritization(
                rows, axis_reversal=axis_reversal, airmode_limit=limits)
        return self._prioritizations[key]

    def _prioritization(
        self, groups: Sequence[Sequence[int]], *given: Any, **named: Any
    ) -> AnyPrioritization:
        """Return how this kind of problem serves groups of axes; see `Prioritization`."""
        kind = PRIORITIZATIONS[self.problem.program.kernel]
        return kind(self.problem, groups, *given, **named)

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw wrenches (size, m) [N, N m] uniformly by volume."""
        if not isinstance(rng, np.random.Generator):
            raise TypeError(f'rng: expected a numpy.random.Generator, got {rng!r}')
        if size < 0:
            raise ValueError(f'size: expected a number of wrenches, got {size}')
        return self.problem.attainable_set.sample(rng, size)
