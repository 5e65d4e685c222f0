"""The control allocation problem: the data that every allocator and every check uses."""

from __future__ import annotations

from functools import cached_property
from math import comb, hypot

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, constant
from ca_ros.solver.dual_newton import DualNewton
from ca_ros.solver.simplex import Simplex
from ca_ros.solver.zonotope import Zonotope, spans
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.vehicle import Vehicle

EXACT_TOLERANCE = 1e-12
"""Residual of an exact allocation, relative to max(1, |u|)."""

ABSURD = 1e100
"""Greatest number that a wrench may have; larger ones are errors of the caller [N, N m]."""


HOVER_ROUNDING = 1e-12
"""Distance of hover to the boundary that counts as inside, as a share of the range."""


def lengths(vectors: Array) -> Array:
    """Return the Euclidean lengths (...) of vectors (..., m), faster than NumPy for short ones."""
    if vectors.ndim == 1:
        return np.sqrt(vectors.dot(vectors))
    return np.sqrt(np.einsum('...i,...i->...', vectors, vectors))


class AllocationProblem:
    """Find f with u = Gamma f and f_min <= f <= f_max (Problem 1, Eqs. (8) and (10)).

    A problem needs no audit: it may also be made of a vehicle that allocators refuse because it
    cannot command every axis or hover.

    Attributes
    ----------
    vehicle : Vehicle
    axes : tuple of str
        Names of the m components of u.
    gamma : (m, n) array
        Control allocation matrix.
    lower, upper : (n,) arrays
        Bounds of the thrusts [N].
    hover : (m,) array
        The wrench that carries the vehicle's weight, without torque [N, N m].
    middle, half_range : (n,) arrays
        Middles and half lengths of the ranges of thrust [N].
    center : (m,) array
        The wrench of the middles: the centre of the admissible set [N, N m].
    extent : (m,) array
        Half of the range of each component [N, N m].
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.axes = vehicle.axes
        self.gamma = constant(control_allocation_matrix(vehicle))
        self.lower = vehicle.thrust_min
        self.upper = vehicle.thrust_max
        self._shape = (len(self.axes),)
        self.hover = constant([vehicle.weight * (axis == 'thrust') for axis in self.axes])
        self.middle = constant((self.lower + self.upper) / 2.0)
        self.half_range = constant((self.upper - self.lower) / 2.0)
        self.center = constant(self.gamma @ self.middle)
        self.extent = constant(np.abs(self.gamma * self.half_range).sum(axis=1))

    @cached_property
    def simplex(self) -> Simplex:
        """The simplex method with thrusts and axes, relative to their middles and half ranges.

        Raises
        ------
        ValueError
            If the admissible set has no volume.
        """
        if not self.spans:
            raise self.no_volume()
        return Simplex(self.gamma * self.half_range / self.extent[:, None])

    def scaled(self, u: Array) -> Array:
        """Return wrenches (..., m) as the rows of `simplex`."""
        return (u - self.center) / self.extent

    def reach(self, start: Array, direction: Array, limit: float = np.inf) -> float:
        """Return the greatest t <= limit for which ``start + t direction`` is attainable.

        Parameters
        ----------
        start, direction : (m,) arrays
            `start` is in the admissible set [N, N m].
        limit : float
        """
        line = self.simplex.copy()
        rows = range(len(self.lower), len(self.lower) + len(self.axes))
        for v, goal in zip(rows, self.scaled(start).tolist(), strict=True):
            line.push(v, goal)
            line.release(v)
        way = direction / self.extent
        size = float(np.abs(way).max()) or 1.0
        length = line.add_ray(rows, (way / size).tolist())
        line.push(length, limit * size)
        return line.value[length] / size

    @cached_property
    def hovers(self) -> bool:
        """Whether hover is inside the admissible set, not on its boundary."""
        if not self.spans:
            return False
        # If all thrusts can change a little in both directions, so can the wrench.
        room = 2.0 * HOVER_ROUNDING * self.half_range
        thrusts = self.least_norm.unbounded(self.hover)
        if np.all((self.lower + room < thrusts) & (thrusts < self.upper - room)):
            return True
        way = self.hover - self.center
        return self.reach(self.center, way, 2.0) > 1.0 + HOVER_ROUNDING

    @property
    def n(self) -> int:
        """Number of rotors."""
        return self.vehicle.n

    def attains(self, u: Array) -> bool:
        """Tell whether a wrench (m,) is attainable, up to `tolerance`."""
        return self.least_norm.solve(u, float(self.tolerance(u))).attained

    def attains_unbounded(self, u: Array) -> bool:
        """Tell whether the pseudo-inverse of a wrench (m,) satisfies the bounds."""
        thrusts = self.least_norm.unbounded(u)
        return bool((thrusts == self.clip(thrusts)).all())

    @cached_property
    def image(self) -> Zonotope:
        """The admissible set A of Eq. (23).

        Raises
        ------
        ValueError
            If it has no volume: the rotors cannot command the axes independently.
        """
        if not self.spans:
            raise self.no_volume()
        return Zonotope(self.center, self.gamma * self.half_range)

    @property
    def facet_choices(self) -> int:
        """Number of choices of m - 1 rotors; each may span a facet of `image`."""
        return comb(len(self.lower), len(self.axes) - 1)

    @cached_property
    def spans(self) -> bool:
        """Whether the admissible set has a volume."""
        return spans(self.gamma * self.half_range)

    def no_volume(self) -> ValueError:
        """Return the error of a problem whose admissible set has no volume."""
        return ValueError(
            'the admissible set has no volume: the rotors cannot command '
            f'{", ".join(self.axes)} independently (see ca_ros.audit)'
        )

    @cached_property
    def least_norm(self) -> DualNewton:
        """The quadratic program of Eqs. (20)-(22)."""
        return DualNewton(self.gamma, self.lower, self.upper)

    def multipliers(self, u: Array) -> Array:
        """Return the multipliers (m,) of that program for a wrench (m,) in the admissible set."""
        return self.least_norm.solve(u, float(self.tolerance(u)))[1]

    def check(self, u: ArrayLike, batch: bool = False) -> Array:
        """Return wrenches as an (m,) array of floats, or (..., m) if `batch`.

        Raises
        ------
        ValueError
            If the shape is wrong or a component is not finite.
        """
        try:
            wrench = np.array(u, float)
        except (TypeError, ValueError):
            raise ValueError(
                f'wrench: expected {len(self.axes)} numbers ({", ".join(self.axes)}), got {u!r}'
            ) from None
        if wrench.shape == self._shape:
            # For a single wrench, math.hypot is faster than NumPy.
            if hypot(*wrench.tolist()) <= ABSURD:
                return wrench
        elif not (batch and wrench.shape[-1:] == self._shape):
            expected = f'(..., {len(self.axes)})' if batch else f'({len(self.axes)},)'
            raise ValueError(
                f'wrench: expected shape {expected} ({", ".join(self.axes)}), got {wrench.shape}'
            )
        sound = np.abs(wrench) <= ABSURD
        if not sound.all():
            bad = np.argwhere(~sound)[0]
            raise ValueError(
                f'wrench: {self.axes[bad[-1]]} is {wrench[tuple(bad)]}, expected finite numbers '
                f'up to {ABSURD:g}'
            )
        return wrench

    def clip(self, thrusts: Array) -> Array:
        """Return thrusts (..., n) within their bounds, Eq. (13)."""
        return np.minimum(np.maximum(thrusts, self.lower), self.upper)

    def residual(self, demands: Array, thrusts: Array) -> Array:
        """Return demands (..., m) minus the wrenches that thrusts (..., n) give [N, N m]."""
        # Unlike a matrix product, einsum gives the same digits for any number of wrenches.
        return demands - np.einsum('...j,kj->...k', thrusts, self.gamma)

    def violation(self, thrusts: Array) -> Array:
        """Return how far thrusts (..., n) are outside their bounds at most, (...) [N]."""
        return np.abs(thrusts - self.clip(thrusts)).max(axis=-1)

    def least(self, multipliers: Array) -> Array:
        """Return the least-norm thrusts (..., n) for multipliers (..., m) [N]."""
        return self.clip(multipliers @ self.gamma)

    def tolerance(self, u: Array) -> Array:
        """Return the residual (...) up to which wrenches (..., m) count as exact [N, N m]."""
        return EXACT_TOLERANCE * np.maximum(1.0, lengths(u))
