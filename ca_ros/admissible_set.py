"""The admissible set: every wrench that the rotors can give within their bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation_problem import AllocationProblem
from ca_ros.arrays import Array, BoolArray
from ca_ros.prioritization import Prioritization
from ca_ros.vehicle import Vehicle


class AdmissibleSet:
    """The set A of Eq. (23): the zonotope that is the image of the box of thrusts under Gamma.

    Parameters
    ----------
    vehicle : Vehicle or AllocationProblem

    Attributes
    ----------
    zonotope : Zonotope
        Its facets.
    reference : (m,) array
        Hover if that is inside the set, otherwise the centre of the set [N, N m].

    Raises
    ------
    ValueError
        If the set has no volume: the rotors cannot command the axes independently.
    """

    def __init__(self, vehicle: Vehicle | AllocationProblem) -> None:
        self.problem = (
            vehicle if isinstance(vehicle, AllocationProblem) else AllocationProblem(vehicle)
        )
        self.zonotope = self.problem.image
        hover = self.problem.hover
        self.reference = hover if self.zonotope.margin(hover) > 0.0 else self.zonotope.center
        self._default_order = default_order(self.problem.axes)
        self._prioritizations: dict[tuple[tuple[str, ...], ...], Prioritization] = {}

    @property
    def facets(self) -> tuple[Array, Array]:
        """Outward unit normals (F, m) and offsets (F,): ``normals @ u <= offsets`` [N, N m]."""
        return self.zonotope.facets

    @property
    def center(self) -> Array:
        """Centre of symmetry (m,) [N, N m]."""
        return self.zonotope.center

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
            Least slack over the facets with unit normals [N, N m]: inside, the Euclidean distance
            to the boundary.
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
            A wrench in the set; by default `reference`.

        Returns
        -------
        (..., m) array
            `u` itself where it is in the set, otherwise the last point of the line from `about` to
            `u` that is.

        Raises
        ------
        ValueError
            If `about` is outside the set.
        """
        return self.scale_levels(u, about)[0]

    def scale_levels(self, u: ArrayLike, about: ArrayLike | None = None) -> tuple[Array, Array]:
        """Like `scale`; return also the share (...) of the way to `u`, 1 where that is inside."""
        start = self.check_reference(about)
        u = self.problem.check(u, batch=True)
        inside = self.zonotope.margin(u) >= 0.0
        levels = np.where(inside, 1.0, np.minimum(self.zonotope.reach(start, u - start), 1.0))
        return np.where(levels == 1.0, u.T, (start + levels[..., None] * (u - start)).T).T, levels

    def prioritize(self, u: ArrayLike, order: Sequence[Sequence[str]] | None = None) -> Array:
        """Bring a wrench into the set by giving up the less important axes first.

        Parameters
        ----------
        u : (..., m) array
            Wrenches [N, N m].
        order : sequence of groups of axes, optional
            By default roll and pitch together, before thrust, before yaw; lateral forces come
            last.

        Returns
        -------
        (..., m) array
            `u` itself where it is in the set, otherwise the wrench in which each group gets as
            much of its demand as is possible without taking from the groups before it.

        Raises
        ------
        ValueError
            If `order` is not a partition of the vehicle's axes.
        """
        return self.prioritize_levels(u, order)[0]

    def prioritize_levels(
        self, u: ArrayLike, order: Sequence[Sequence[str]] | None = None
    ) -> tuple[Array, Array]:
        """Like `prioritize`; return also the share (..., m) of its demand that each axis got."""
        prioritization = self.check_order(order)
        served = self.problem.check(u, batch=True)
        levels = np.ones(served.shape)
        outside = self.zonotope.margin(served) < 0.0
        if outside.any():
            served[outside], levels[outside] = prioritization(served[outside])
        return served, levels

    def check_reference(self, about: ArrayLike | None) -> Array:
        """Return the reference of `scale`; raise a ValueError if it is outside the set."""
        if about is None:
            return self.reference
        start = self.problem.check(about)
        outside = -self.zonotope.margin(start)
        if outside > self.problem.tolerance(start):
            raise ValueError(
                f'about: expected a wrench in the admissible set, got {start}, which is '
                f'{outside:.3g} outside'
            )
        return start

    def check_order(self, order: Sequence[Sequence[str]] | None) -> Prioritization:
        """Return what serves an order; raise a ValueError if that is no partition of the axes."""
        groups = self._default_order if order is None else tuple(tuple(group) for group in order)
        if groups not in self._prioritizations:
            if (
                sorted(axis for group in groups for axis in group) != sorted(self.problem.axes)
                or () in groups
            ):
                raise ValueError(
                    f'order: expected groups in which each of {", ".join(self.problem.axes)} '
                    f'stands once, got {order}'
                )
            rows = [[self.problem.axes.index(axis) for axis in group] for group in groups]
            self._prioritizations[groups] = Prioritization(self.problem, rows)
        return self._prioritizations[groups]

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Draw wrenches (size, m) [N, N m] uniformly by volume."""
        return self.zonotope.sample(rng, size)


def default_order(axes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the default order of axes: roll and pitch, then thrust, yaw, and lateral forces."""
    groups = (('roll', 'pitch'), ('thrust',), ('yaw',), ('force_x', 'force_y'))
    present = (tuple(axis for axis in group if axis in axes) for group in groups)
    return tuple(group for group in present if group)
