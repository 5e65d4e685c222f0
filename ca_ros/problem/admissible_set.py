"""The admissible set: all wrenches that the rotors can produce within their bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.prioritization import (
    REVERSAL,
    REVERSALS,
    Prioritization,
    default_order,
    groups_of,
)
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.solver.zonotope import Zonotope
from ca_ros.vehicle.vehicle import Vehicle

REACHED = 1e-9
"""How far a reference may be outside the set, relative to its distance from the centre."""


class AdmissibleSet:
    """The set A of Eq. (23): the image of the box of thrusts under Gamma, a zonotope.

    Parameters
    ----------
    vehicle : Vehicle or AllocationProblem

    Attributes
    ----------
    reference : (m,) array
        The reference of the problem, hover for a vehicle, if it is inside the set; otherwise the
        centre of the set [N, N m].

    Raises
    ------
    ValueError
        If the set has no volume: the rotors cannot command the axes independently.
    """

    def __init__(self, vehicle: Vehicle | AllocationProblem) -> None:
        self.problem = problem = problem_of(vehicle)
        if not problem.spans:
            raise problem.no_volume()
        self.reference = problem.reference if problem.reference_inside else problem.center
        self._prioritizations: dict[object, Prioritization] = {}

    @property
    def zonotope(self) -> Zonotope:
        """The set as a zonotope; its facets are computed at the first access."""
        return self.problem.image

    @property
    def facets(self) -> tuple[Array, Array]:
        """Outward unit normals (F, m) and offsets (F,): ``normals @ u <= offsets`` [N, N m]."""
        return self.zonotope.facets

    @property
    def center(self) -> Array:
        """Centre of symmetry (m,) [N, N m]."""
        return self.problem.center

    @property
    def volume(self) -> float:
        """Volume of the set; [N (N m)^3] for the usual four axes."""
        return self.zonotope.volume

    def margin(self, u: ArrayLike) -> Array:
        """Return the signed distance of wrenches to the boundary, positive inside.

        Parameters
        ----------
        u : (..., m) array
            Wrenches [N, N m].

        Returns
        -------
        (...) array
            Least slack over the facets with unit normals [N, N m].  Inside the set it is the
            Euclidean distance to the boundary.
        """
        return self.zonotope.margin(self.problem.check(u, batch=True))

    def contains(self, u: ArrayLike, tolerance: float = 0.0) -> BoolArray:
        """Tell which wrenches (..., m) lie in the set, up to `tolerance` in the margin."""
        return self.margin(u) >= -tolerance

    def scale(self, u: ArrayLike, about: ArrayLike | None = None) -> Array:
        """Bring a wrench into the set along the straight line to a reference.

        Parameters
        ----------
        u : (..., m) array
            Wrenches [N, N m].
        about : (m,) array, optional
            The reference, a wrench in the set; by default `reference`.

        Returns
        -------
        (..., m) array
            `u` if it is in the set, otherwise the last point in the set on the line from `about`
            to `u`.

        Raises
        ------
        ValueError
            If `about` is outside the set.
        """
        return self.scale_levels(u, about)[0]

    def scale_levels(self, u: ArrayLike, about: ArrayLike | None = None) -> tuple[Array, Array]:
        """Like `scale`, but also return the share (...) of the way to `u`, at most 1."""
        u = self.problem.check(u, batch=True)
        served, levels = self._serve(self.check_reference(about), u)
        return served, levels.min(axis=-1)

    def prioritize(
        self,
        u: ArrayLike,
        order: Sequence[Sequence[str]] | None = None,
        reversal: str = REVERSAL,
    ) -> Array:
        """Bring a wrench into the set by giving up the less important axes first.

        With the default order, roll and pitch get as much of their demand as possible, with their
        ratio kept.  Then the sign of yaw is kept: yaw is not reversed, does not exceed its demand
        and does not change without a demand, as long as a deviation of thrust can prevent this.
        Then thrust gets as close to its demand as possible, and then yaw.  See `Prioritization`
        for other orders.

        Parameters
        ----------
        u : (..., m) array
            Wrenches [N, N m].
        order : sequence of groups of axes, optional
            The most important first, such as ``['roll pitch', 'thrust', 'yaw']``; by default
            `ORDER`.  Axes that the vehicle does not command are ignored.
        reversal : 'prevent', 'avoid' or 'allow'
            How much thrust may deviate so that no axis after the first group is reversed.
            'prevent': as much as necessary.  'avoid': at most from its demand to hover.  'allow':
            not at all.

        Returns
        -------
        (..., m) array
            `u` if it is in the set, otherwise the wrench that is served.

        Raises
        ------
        ValueError
            If `order` does not name each of the vehicle's axes once, or `reversal` is unknown.
        """
        return self.prioritize_levels(u, order, reversal)[0]

    def prioritize_levels(
        self,
        u: ArrayLike,
        order: Sequence[Sequence[str]] | None = None,
        reversal: str = REVERSAL,
    ) -> tuple[Array, Array]:
        """Like `prioritize`, but also return the share (..., m) of its demand that each axis gets.

        The share is relative to hover: 0 for an axis that is reversed or does not change, 1 for an
        axis that gets all of its demand or more.
        """
        return self._serve(self.check_order(order, reversal), self.problem.check(u, batch=True))

    def _serve(self, serve: Prioritization, u: Array) -> tuple[Array, Array]:
        """Return the served wrenches and levels for wrenches (..., m)."""
        served, levels = u.copy(), np.ones(u.shape)
        if u.ndim == 1:
            # For a single wrench, computing all facets would take too long.
            if self.problem.attains_unbounded(u):
                return served, levels
            answer = serve(u)
            if answer.reached and self.problem.attains(u):
                return served, levels
            return answer.wrenches, answer.levels
        outside = self.zonotope.margin(served) < 0.0
        if outside.any():
            served[outside], levels[outside], _ = serve(served[outside])
        return served, levels

    def check_reference(self, about: ArrayLike | None) -> Prioritization:
        """Return the scaling about a reference; raise a ValueError if it is outside the set."""
        start = self.reference if about is None else self.problem.check(about)
        way = start - self.problem.center
        if self.problem.reach(self.problem.center, way, 1.0) < 1.0 - REACHED:
            raise ValueError(f'about: expected a wrench in the admissible set, got {start}')
        everything = [list(range(len(self.problem.axes)))]
        return Prioritization(self.problem, everything, start, begin=start)

    def check_order(
        self, order: Sequence[Sequence[str]] | None, reversal: str = REVERSAL
    ) -> Prioritization:
        """Return the prioritization of an order; raise a ValueError if an argument is wrong."""
        key = (None if order is None else tuple(map(tuple, order))), reversal
        if key not in self._prioritizations:
            if reversal not in REVERSALS:
                raise ValueError(
                    f'reversal: expected one of {", ".join(REVERSALS)}, got {reversal!r}'
                )
            axes = self.problem.axes
            groups = default_order(axes) if order is None else groups_of(order, axes)
            rows = [[axes.index(axis) for axis in group] for group in groups]
            self._prioritizations[key] = Prioritization(self.problem, rows, reversal=reversal)
        return self._prioritizations[key]

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw wrenches (size, m) [N, N m] uniformly by volume."""
        return self.zonotope.sample(rng, size)
