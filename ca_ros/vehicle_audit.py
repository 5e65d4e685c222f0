"""The audit: what a vehicle's rotors, as they are, can command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ca_ros.allocation_problem import AllocationProblem
from ca_ros.arrays import Array
from ca_ros.vehicle import Vehicle
from ca_ros.zonotope import Zonotope

EXPENDABLE = ('force_y', 'force_x', 'yaw', 'pitch', 'roll')
"""The axes that are given up, in this order, for the sake of the others."""

INDEPENDENCE_MIN = 0.05
"""Least sine of the angle between what one axis needs and what the others need.

At 0.05 a command along the axis takes twenty times the thrusts that it would take alone.
"""


@dataclass(frozen=True, eq=False)
class Audit:
    """What a vehicle can command.

    Attributes
    ----------
    vehicle : Vehicle
        The vehicle with the axes that can be commanded independently; the others are left out.
    lost : tuple of str
        The axes that are lost: those left out, and those that have to yield if the vehicle is to
        hover.  The latter are still commanded, and get what the others leave.
    rank : int
        Number of axes that the rotors can command in theory.
    independence : dict
        For each of the axes asked for, the sine of the angle between its row of Gamma,
        weighted with the ranges of the rotors, and the span of the other rows: 1 is best, 0 is not
        possible.
    condition : float
        Condition number of Gamma with such rows of unit length.
    hover_margin : float
        Signed distance from hover to the boundary of the admissible set of all axes asked for
        [N, N m]; -inf if that has no volume.
    kept_hover_margin : float
        The same without the lost axes.
    spin_torque : float
        The yaw torque of least size with which the vehicle can hover, if its yaw is lost [N m].
        Hover without that torque is not possible, so the vehicle spins until drag balances it.
    authority : dict
        For each axis that is not lost, the range around hover with the other axes at rest
        [N, N m]; empty if hover is not attainable.
    """

    vehicle: Vehicle
    lost: tuple[str, ...]
    rank: int
    independence: dict[str, float]
    condition: float
    hover_margin: float
    kept_hover_margin: float
    spin_torque: float
    authority: dict[str, tuple[float, float]]

    @property
    def sound(self) -> bool:
        """Whether no axis is lost and the vehicle can hover."""
        return not self.lost and self.hover_margin > 0.0

    def __str__(self) -> str:
        """Say it in one line."""
        kept = ', '.join(
            f'{axis} {low:+.3g} to {high:+.3g}' for axis, (low, high) in self.authority.items()
        )
        lost = f'{", ".join(self.lost)} lost; ' if self.lost else ''
        if self.spin_torque:
            lost += f'hover leaves a yaw torque of {self.spin_torque:+.2g} N m: it spins; '
        hover = (
            f'hover margin {self.kept_hover_margin:.3g}'
            if self.kept_hover_margin > 0.0
            else f'cannot hover with {self.vehicle.thrust_max.sum():.3g} N at most '
            f'and a weight of {self.vehicle.weight:.3g} N'
        )
        return f'{lost}{hover}; around hover: {kept}' if kept else f'{lost}{hover}'


def audit(vehicle: Vehicle) -> Audit:
    """Find out which axes a vehicle can command, and with what reserve.

    Axes are given up, yaw before roll and pitch, until those that are left are independent, and
    then until hover is inside their admissible set; thrust is never given up.

    Parameters
    ----------
    vehicle : Vehicle
        With its rotors' health.

    Returns
    -------
    Audit
    """
    full = AllocationProblem(vehicle)
    unit = _unit_rows(full)
    singular = np.linalg.svd(unit, compute_uv=False)
    independence = dict(zip(full.axes, _independence(unit).tolist(), strict=True))
    independent = _give_up(full, _independent)
    hovering = _give_up(independent, _hovers)
    if not _hovers(hovering):
        hovering = independent
    image = _image(hovering)
    hover = -np.inf if image is None else float(image.margin(hovering.hover))
    return Audit(
        vehicle=independent.vehicle,
        lost=tuple(axis for axis in full.axes if axis not in hovering.axes),
        rank=int((singular > 1e-9).sum()),
        independence=independence,
        condition=float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf,
        hover_margin=_hover_margin(full),
        kept_hover_margin=hover,
        spin_torque=_spin_torque(full, hovering) if hover > 0.0 else 0.0,
        authority={} if image is None or hover < 0.0 else _authority(hovering, image),
    )


def _unit_rows(problem: AllocationProblem) -> Array:
    rows = problem.gamma * (problem.upper - problem.lower)
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(lengths > 0.0, lengths, 1.0)


def _independence(unit: Array) -> Array:
    """Return the distance of each row, of unit length, from the span of the others."""
    distances = []
    for i, row in enumerate(unit):
        others = np.delete(unit, i, axis=0).T
        rest = row - others @ np.linalg.lstsq(others, row, rcond=1e-12)[0]
        distances.append(np.linalg.norm(rest))
    return np.array(distances)


def _image(problem: AllocationProblem) -> Zonotope | None:
    try:
        return problem.image
    except ValueError:
        return None


def _hover_margin(problem: AllocationProblem) -> float:
    image = _image(problem)
    return -np.inf if image is None else float(image.margin(problem.hover))


def _independent(problem: AllocationProblem) -> bool:
    rows = _unit_rows(problem)
    return bool(_independence(rows).min() >= INDEPENDENCE_MIN) and _image(problem) is not None


def _hovers(problem: AllocationProblem) -> bool:
    return bool(_hover_margin(problem) > problem.tolerance(problem.hover))


def _give_up(
    problem: AllocationProblem, good: Callable[[AllocationProblem], bool]
) -> AllocationProblem:
    """Leave out axes until the problem is good: the one whose loss helps, or else the first."""
    while not good(problem):
        candidates = [_without(problem, axis) for axis in EXPENDABLE if axis in problem.axes]
        if not candidates or len(problem.axes) == 1:
            break
        problem = next(filter(good, candidates), candidates[0])
    return problem


def _without(problem: AllocationProblem, lost: str) -> AllocationProblem:
    axes = tuple(axis for axis in problem.axes if axis != lost)
    return AllocationProblem(replace(problem.vehicle, axes=axes))


def _spin_torque(full: AllocationProblem, hovering: AllocationProblem) -> float:
    """Return the yaw torque nearest to zero with which the axes of `hovering` hover [N m]."""
    if 'yaw' in hovering.axes or 'yaw' not in full.axes:
        return 0.0
    axes = tuple(axis for axis in full.axes if axis in (*hovering.axes, 'yaw'))
    with_yaw = AllocationProblem(replace(full.vehicle, axes=axes))
    tolerance = float(hovering.tolerance(hovering.hover))
    start = with_yaw.gamma @ hovering.least_norm.solve(hovering.hover, tolerance)[0]
    yaw = float(start[axes.index('yaw')])
    image = _image(with_yaw)
    if image is not None:
        unit = np.array([float(axis == 'yaw') for axis in axes])
        low, high = (yaw + sign * float(image.reach(start, sign * unit)) for sign in (-1.0, 1.0))
        yaw = min(max(low, 0.0), high)
    return yaw if abs(yaw) > 1e-9 else 0.0


def _authority(problem: AllocationProblem, image: Zonotope) -> dict[str, tuple[float, float]]:
    start, ranges = image.pull(problem.hover), {}
    for i, axis in enumerate(problem.axes):
        unit = np.eye(len(problem.axes))[i]
        ranges[axis] = (-float(image.reach(start, -unit)), float(image.reach(start, unit)))
    return ranges
