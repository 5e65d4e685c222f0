"""Plane sections of the admissible set, for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import HalfspaceIntersection

from ca_ros.arrays import Array
from ca_ros.evaluation.judge import FORCES
from ca_ros.problem.admissible_set import AdmissibleSet

LABELS = {
    'force_x': 'force x [N]',
    'force_y': 'force y [N]',
    'thrust': 'thrust [N]',
    'roll': r'$\tau_x$ [N m]',
    'pitch': r'$\tau_y$ [N m]',
    'yaw': r'$\tau_z$ [N m]',
}


@dataclass(frozen=True, eq=False)
class Section:
    """The admissible set where all axes but two are as in the reference, which is hover.

    Attributes
    ----------
    axes : tuple of str
        The two axes.
    rows : tuple of int
        Their components of a wrench.
    reference : (m,) array
        The wrench that the others are taken from [N, N m].
    outline : (k, 2) array
        Corners of the section, in their order.
    """

    axes: tuple[str, str]
    rows: tuple[int, int]
    reference: Array
    outline: Array

    @classmethod
    def of(cls, admissible: AdmissibleSet, horizontal: str, vertical: str) -> Section:
        """Return the section along two axes."""
        rows = tuple(admissible.problem.axes.index(axis) for axis in (horizontal, vertical))
        normals, offsets = admissible.facets
        plane = normals[:, rows]
        cutting = np.linalg.norm(plane, axis=1) > 1e-9
        slacks = offsets - normals @ admissible.reference
        halfspaces = np.column_stack([plane, -slacks])[cutting]
        # Both axes in units of their extent: a torque may be small beside a thrust.
        scale = slacks[cutting].max() / np.abs(plane[cutting]).max(axis=0)
        corners = HalfspaceIntersection(
            halfspaces * np.append(scale, 1.0), np.zeros(2)
        ).intersections
        corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))] * scale
        return cls(
            (horizontal, vertical),
            (rows[0], rows[1]),
            admissible.reference,
            corners + admissible.reference[list(rows)],
        )

    @property
    def labels(self) -> tuple[str, str]:
        """Names of the two axes with their units."""
        return LABELS[self.axes[0]], LABELS[self.axes[1]]

    def title(self, names: tuple[str, ...]) -> str:
        """Say what the other axes are at."""
        others = [
            f'{LABELS[axis].split(" [")[0]} = {self.reference[i]:.3g} '
            f'{"N" if axis in FORCES else "N m"}'
            for i, axis in enumerate(names)
            if i not in self.rows and (axis == 'thrust' or abs(self.reference[i]) > 1e-9)
        ]
        return ', '.join(others) or 'other axes at zero'

    def grid(self, steps: int) -> tuple[Array, Array]:
        """Return coordinates (steps,) that span the section, in the middle of its cells."""
        low, high = self.outline.min(axis=0), self.outline.max(axis=0)
        shares = (np.arange(steps) + 0.5) / steps
        return low[0] + shares * (high[0] - low[0]), low[1] + shares * (high[1] - low[1])

    def wrenches(self, horizontal: Array, vertical: Array) -> Array:
        """Return the wrenches (..., m) of points of the section's plane."""
        wrenches = np.tile(self.reference, (*np.shape(horizontal), 1))
        wrenches[..., self.rows[0]], wrenches[..., self.rows[1]] = horizontal, vertical
        return wrenches


def sections(admissible: AdmissibleSet, *pairs: tuple[str, str]) -> list[Section]:
    """Return the sections along those pairs of axes that the vehicle commands."""
    present = admissible.problem.axes
    return [Section.of(admissible, *pair) for pair in pairs if set(pair) <= set(present)]
