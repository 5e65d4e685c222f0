"""The inside of the admissible set: whether there is one, and where the reference lies in it."""

from functools import cached_property

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.programs import BoxProgram, SetsProgram
from ca_ros.solver.zonotope import decomposition

INSIDE = 0.99  # greatest share of the way to the boundary at which a line may begin


class Interior:
    """The inside of the set of all wrenches of a program, and a reference (m,) [N, N m]."""

    def __init__(self, program: BoxProgram | SetsProgram, reference: Array) -> None:
        self._program, self._sets, self._reference = program, program.sets, reference

    @cached_property
    def _decomposition(self) -> tuple[Array, Array, Array, Array] | None:
        return decomposition(self._program.matrix * self._sets.half_range)

    @property
    def has_volume(self) -> bool:
        """Whether there is an inside: the effectors can control the axes independently."""
        return self._decomposition is not None

    @property
    def independence(self) -> float:
        """The least sine of the angle between an axis and the span of the others; 0 if dependent.

        An axis is its row of the matrix, with columns weighted by the ranges of the effectors.
        """
        if self._decomposition is None:
            return 0.0
        _, left, singular, _ = self._decomposition
        # The columns of the pseudo-inverse have the inverse of the distance as length.
        rows, inverse = np.square(left * singular), np.square(left / singular)
        return float((rows.sum(axis=1) * inverse.sum(axis=1)).max() ** -0.5)

    @cached_property
    def has_reference(self) -> bool:
        """Whether the reference is inside the set, not on its boundary."""
        program, middle = self._program, self._sets.middle
        begin = program.matrix @ middle
        way = self._reference - begin
        beyond = 1.0 + program.reference_rounding
        # Most references are inside or outside by far, which is cheaper to see.
        outside = np.abs(begin + beyond * way - program.center) >= program.extent
        if outside.any() or self._decomposition is None:
            return False
        # Of one axis, the range is the set.
        if len(way) == 1 or self.has_reference_near_middle:
            return True
        # A plane that the set does not cross is cheaper than the way to the boundary: that of the
        # multipliers of the least shares of the half ranges.
        sizes, left, singular, _ = self._decomposition
        normal = left @ (way / sizes @ left / singular**2) / sizes
        most = float(self._sets.support(normal @ program.matrix) - normal @ begin)
        return bool(beyond * (normal @ way) < most) and program.reach(begin, way, 2.0) > beyond

    @cached_property
    def has_reference_near_middle(self) -> bool:
        """Whether the reference is for sure at most `INSIDE` of the way to the boundary.

        It is if the least shares of the half ranges that lead there are within the bounds.
        """
        if self._decomposition is None:
            return False
        # Singular values are greater than 1e-9, so rounding changes less than 1e-3 of the way.
        sizes, left, singular, right = self._decomposition
        middle = self._sets.middle
        way = (self._reference - self._program.matrix @ middle) / INSIDE
        thrusts = middle + self._sets.half_range * ((way / sizes @ left / singular) @ right)
        return bool((self._sets.project(thrusts) == thrusts).all())
