"""Plane sections of the admissible set, for plots."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.settings import AXES

NAMES = {
    ('force_x', 'N'): 'force x', ('force_y', 'N'): 'force y',
    ('roll', 'N m'): r'$\tau_x$', ('pitch', 'N m'): r'$\tau_y$', ('yaw', 'N m'): r'$\tau_z$',
}
"""Names of the axes of a wrench in plots, by axis and unit."""


@dataclass(frozen=True, eq=False)
class Section:
    """The section of the admissible set along two axes, through the reference, which is hover.

    `rows` are the two axes' components of a wrench, `reference` (m,) has the values of the others
    [N, N m], which `title` has in words; `outline` (k, 2) are the corners of the section in order.
    """

    rows: list[int]
    reference: Array
    outline: Array
    labels: list[str]
    title: str

    def grid(self, steps: int) -> tuple[Array, Array]:
        """Return the coordinates (steps,) of cell centres that span the section."""
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        shares = (np.arange(steps) + 0.5) / steps
        return low[0] + shares * (high[0] - low[0]), low[1] + shares * (high[1] - low[1])

    def wrenches(self, horizontal: Array, vertical: Array) -> Array:
        """Return the wrenches (..., m) of points of the section's plane."""
        wrenches = np.tile(self.reference, (*np.shape(horizontal), 1))
        wrenches[..., self.rows] = np.stack([horizontal, vertical], axis=-1)
        return wrenches


def units(problem: AllocationProblem) -> dict[str, tuple[str, str]]:
    """Return name and unit of each axis."""
    pairs = zip(problem.axes, problem.axis_units, strict=True)
    return {
        axis: (NAMES.get((axis, unit), axis), unit.replace('^2', '²')) for axis, unit in pairs}


def labels(problem: AllocationProblem, axes: Sequence[str]) -> list[str]:
    """Return the names of axes with their units."""
    return ['{} [{}]'.format(*units(problem)[axis]).removesuffix(' []') for axis in axes]


def fixed(problem: AllocationProblem, drawn: Sequence[str], at: Array) -> str:
    """Return in words the values (m,) that the axes have which are not drawn."""
    words = [
        f'{axis} {value:.3g} {unit}'.strip() if abs(value) > 1e-9 else f'{axis} 0'
        for (axis, (_, unit)), value in zip(units(problem).items(), at, strict=True)
        if axis not in drawn
    ]
    return ', '.join(words).replace('_', ' ')


def sections(admissible: AdmissibleSet, *pairs: tuple[str, str]) -> list[Section]:
    """Return the sections along each pair of axes that are commanded.

    If it has none of them, and other axes than a wrench: the section along its first two axes.
    """
    problem, reference = admissible.problem, admissible.reference
    found = [pair for pair in pairs if {*pair} <= {*problem.axes}]
    if not found and not {*problem.axes} <= {*AXES} and len(problem.axes) > 1:
        found = [(problem.axes[0], problem.axes[1])]
    return [
        Section(
            [problem.axes.index(axis) for axis in pair], reference,
            admissible.section(pair).vertices, labels(problem, pair),
            fixed(problem, pair, reference),
        ) for pair in found
    ]
