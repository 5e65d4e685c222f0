"""The exact allocator of vectors in convex sets in C, as an extension module that may be missing.

`vectored.h` is its public header, and `vectored_module.c` binds it.
"""

import re
from collections.abc import Mapping
from functools import cache, cached_property
from math import prod
from os import environ
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.kernel import extension
from ca_ros.solver.convex_sets import ConvexSets
from ca_ros.solver.least_norm_over_sets import Line, SetsNewton, SetsSolution


def chosen(components: int, axes: int) -> Any:
    """Return the module for a problem; None if NumPy is to do its work (`CA_ROS_KERNEL`)."""
    module = None if environ.get('CA_ROS_KERNEL') == 'numpy' else extension('vectored')
    fits = module is not None and components <= module.N and axes <= module.M
    return module if fits else None


def padded(module: Any, fields: Mapping[str, Array | float]) -> dict[str, tuple[str, str, Array]]:
    """Return the fields of `ca_vectored` in their order: name to (type, dimensions, numbers).

    The numbers have the size that the module has for them; zeros fill them up.
    """
    numbers = _filled(module, fields)
    return {
        name: ('ca_real', dimensions, numbers[first : first + prod(shape)].reshape(shape))
        for name, (dimensions, shape, first) in _layout(module).items()
    }


def _filled(module: Any, fields: Mapping[str, Array | float]) -> Array:
    """Return the numbers of `ca_vectored`, one field after the other."""
    layout = _layout(module)
    _, shape, first = layout[[*layout][-1]]
    numbers = np.zeros(first + prod(shape))
    for name, (_, shape, first) in layout.items():
        given = np.asarray(fields[name], float)
        if given.ndim < 2:
            numbers[first : first + given.size] = given
        else:
            place = numbers[first : first + prod(shape)].reshape(shape)
            place[tuple(slice(size) for size in given.shape)] = given
    return numbers


@cache
def _layout(module: Any) -> dict[str, tuple[str, list[int], int]]:
    """Return the dimensions of the fields of a module, in C and as a shape, and their places."""
    found, first = {}, 0
    for name, dimensions in module.FIELDS.items():
        letters = re.findall(r'\[CA_([MN])\]', dimensions)
        shape = [getattr(module, letter) for letter in letters]
        found[name] = dimensions, shape, first
        first += prod(shape)
    return found


def structure(module: Any, fields: Mapping[str, Array | float]) -> Any:
    """Return a `Vectored` of an extension module."""
    return module.Vectored(_filled(module, fields))


def fields_of(newton: SetsNewton, **policy: Array | float) -> dict[str, Array | float]:
    """Return the fields of `ca_vectored` for a solver; without a policy it only solves."""
    m, n = newton.matrix.shape
    most = np.maximum(np.abs(newton.sets.lower), np.abs(newton.sets.upper))
    none: dict[str, Array | float] = {
        'slack': 0.0, 'policy': 0.0, 'reference': np.zeros(m), 'begin': np.zeros(m),
        'on_reference': 1.0, 'resting': np.zeros(n), 'extent': np.ones(m), 'middle': np.zeros(n),
        'order': np.zeros(m), 'group': np.zeros(m), 'sense': np.zeros(m),
        'line_begin': np.zeros(m),
    }
    return none | newton.sets.fields() | {
        'axes': m, 'matrix': newton.matrix, 'weight': newton.weights,
        'preferred': newton.preferred, 'basis': newton.basis, 'rates': newton.rates,
        'coordinates': newton.coordinates,
        'start': newton.coordinates @ newton.matrix @ newton.preferred,
        'span': np.linalg.norm(newton.coordinates, 2), 'greatest': newton.greatest,
        'terms': np.linalg.norm(np.abs(newton.matrix) @ most),
    } | policy


class KernelNewton(SetsNewton):
    """`SetsNewton` in C: the same to rounding, and faster."""

    engine = 'C'

    def __init__(self, module: Any, *given: Any) -> None:
        super().__init__(*given)
        self._module, self._given = module, given
        self.prioritizes = self.sets.n + len(self.matrix) <= module.N

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        # A module cannot be copied.
        return sets_newton, self._given

    @cached_property
    def _fields(self) -> dict[str, Array | float]:
        return fields_of(self)

    @cached_property
    def _kernel(self) -> Any:
        return self.with_policy()

    def with_policy(self, **policy: Array | float) -> Any:
        """Return a `Vectored` of the extension module; see `fields_of`."""
        return structure(self._module, self._fields | policy)

    def solve(self, wrenches: Array) -> SetsSolution:
        size, (m, n) = len(wrenches), self.matrix.shape
        points, multipliers = np.empty((size, n)), np.empty((size, m))
        status, levels = np.empty(size, np.int8), np.empty(size)
        wrenches = np.ascontiguousarray(wrenches, float)
        if size:
            self._kernel.solve_batch(wrenches, points, status, levels, multipliers)
        return SetsSolution(points, multipliers, status == 0, status < 0)

    def line(self, begin: Array, way: Array, end: float = np.inf) -> Line:
        point, normal = np.empty(self.sets.n), np.empty(len(begin))
        begin, way = np.ascontiguousarray(begin, float), np.ascontiguousarray(way, float)
        length, most = self._kernel.line(begin, way, point, normal, end)
        return Line(point, length, most, normal)


def sets_newton(
    matrix: Array, sets: ConvexSets, weights: Array | None = None, preferred: Array | None = None
) -> SetsNewton:
    """Return a `SetsNewton`: in C where it is built and large enough."""
    module = chosen(sets.n, len(matrix))
    given = matrix, sets, weights, preferred
    return SetsNewton(*given) if module is None else KernelNewton(module, *given)


def priorities(solver: SetsNewton, fields: Mapping[str, Array]) -> Any:
    """Return a `Vectored` that prioritizes; None if NumPy is to do it."""
    return solver.with_policy(**fields) if solver.prioritizes else None
