"""The audit: what a vehicle's rotors, as they are, can command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.prioritization import Prioritization
from ca_ros.problem.problem import AllocationProblem
from ca_ros.schema import ParameterError
from ca_ros.vehicle.parameters import VEHICLE
from ca_ros.vehicle.vehicle import Vehicle

LOST_AXES = VEHICLE['allocation.lost_axes'].choices

EXPENDABLE = ('force_y', 'force_x', 'yaw', 'pitch', 'roll')
"""The axes that are given up, in this order, for the sake of the others."""

INDEPENDENCE_MIN = 0.05
"""Least sine of the angle between what one axis needs and what the others need.

At 0.05 a command along the axis takes twenty times the thrusts that it would take alone.
"""


CHOICES_TOLD = 2000
"""Choices of rotors up to which facets take a millisecond, and the audit states the margin."""


@dataclass(frozen=True, eq=False)
class Audit:
    """What a vehicle can command.

    Attributes
    ----------
    asked : AllocationProblem
        Of all axes that are asked for.
    problem : AllocationProblem
        Of the axes that can be commanded independently; the others are left out.
    kept : AllocationProblem
        Of the axes that are not lost.
    hovers, keeps_hovering : bool
        Whether hover is inside the admissible set of `asked`, and of `kept`.
    rank : int
        Number of axes that the rotors can command in theory.
    independence : dict
        For each of the axes asked for, the sine of the angle between its row of Gamma,
        weighted with the ranges of the rotors, and the span of the other rows: 1 is best, 0 is not
        possible.
    condition : float
        Condition number of Gamma with such rows of unit length.
    """

    asked: AllocationProblem
    problem: AllocationProblem
    kept: AllocationProblem
    hovers: bool
    keeps_hovering: bool
    rank: int
    independence: dict[str, float]
    condition: float

    @property
    def lost(self) -> tuple[str, ...]:
        """The axes that are left out, and those that have to yield if the vehicle is to hover.

        The latter are still commanded, and get what the others leave.
        """
        return tuple(axis for axis in self.asked.axes if axis not in self.kept.axes)

    @cached_property
    def hover_margin(self) -> float:
        """Signed distance from hover to the boundary of the admissible set of `asked` [N, N m].

        It is -inf if that set has no volume.
        """
        return _hover_margin(self.asked)

    @cached_property
    def kept_hover_margin(self) -> float:
        """The same for `kept`."""
        return _hover_margin(self.kept)

    @cached_property
    def spin_torque(self) -> float:
        """The yaw torque that hover leaves where yaw is lost: the vehicle spins [N m]."""
        return _spin_torque(self.asked, self.kept) if self.keeps_hovering else 0.0

    @cached_property
    def authority(self) -> dict[str, tuple[float, float]]:
        """For each axis of `kept`, the range around hover with the other axes at rest [N, N m].

        It is empty if hover is not attainable.
        """
        return _authority(self.kept) if self.keeps_hovering else {}

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the axes of `problem`; its `lost_axes` is drop if it is not sound."""
        return self.problem.vehicle

    @property
    def sound(self) -> bool:
        """Whether no axis is lost and the vehicle can hover."""
        return not self.lost and self.hovers

    def __str__(self) -> str:
        """Say it in one line."""
        parts = [f'{", ".join(axes)} lost ({why})' for axes, why in self._losses() if axes]
        if self.spin_torque:
            parts.append(f'hover leaves a yaw torque of {self.spin_torque:+.2g} N m: it spins')
        if self.keeps_hovering:
            if self.kept.facet_choices <= CHOICES_TOLD:
                parts.append(f'hover margin {self.kept_hover_margin:.3g} [N, N m]')
            ranges = (f'{axis} {self.ends(axis)} {unit(axis)}' for axis in self.authority)
            parts.append(f'around hover: {", ".join(ranges)}')
        else:
            parts.append(self.why_no_hover())
        return '; '.join(parts)

    def _losses(self) -> list[tuple[list[str], str]]:
        """Return the lost axes by cause."""
        asked, least = len(self.independence), min(self.independence.values())
        dependent = (
            f'independence {least:.2g}, at least {INDEPENDENCE_MIN:g} is needed'
            if self.rank == asked
            else f'the allocation matrix has rank {self.rank} for {asked} axes'
        )
        kept = self.vehicle.axes
        return [
            ([axis for axis in self.lost if axis not in kept], dependent),
            ([axis for axis in self.lost if axis in kept], 'given up for hover'),
        ]

    def ends(self, axis: str) -> str:
        """Return the range of an axis around hover, in words without the unit."""
        low, high = self.authority[axis]
        return f'{low:+.3g} to {high:+.3g}'

    def why_no_hover(self) -> str:
        """Say why the vehicle cannot hover: its mass beside what the rotors lift [kg]."""
        least, most = lift(self.vehicle)
        mass = f'{self.vehicle.mass:.4g} kg'
        if self.vehicle.mass >= most:
            return f'cannot hover: {mass} on rotors that lift {most:.4g} kg'
        if self.vehicle.mass <= least:
            return f'cannot hover: {mass} on rotors that lift at least {least:.4g} kg'
        return f'cannot hover: rotors that lift {most:.4g} kg cannot hold {mass} level'


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
    hovering = _give_up(independent, lambda problem: problem.hovers)
    if not hovering.hovers:
        hovering = independent
    if len(hovering.axes) < len(full.axes) or not full.hovers:
        # Whoever goes on with what is left has seen the audit.
        independent.vehicle = replace(independent.vehicle, lost_axes='drop')
    return Audit(
        asked=full,
        problem=independent,
        kept=hovering,
        hovers=full.hovers,
        keeps_hovering=hovering.hovers,
        rank=int((singular > 1e-9).sum()),
        independence=independence,
        condition=float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf,
    )


def accept(vehicle: Vehicle, lost_axes: str | None = None) -> Audit:
    """Audit a vehicle, and refuse it unless it can command every axis and hover.

    Python, nodes and studies all refuse here.

    Parameters
    ----------
    vehicle : Vehicle
    lost_axes : 'refuse' or 'drop', optional
        'drop' refuses nothing: lost axes are given up.  By default what the vehicle says, which is
        the parameter ``allocation.lost_axes`` of its file.

    Returns
    -------
    Audit

    Raises
    ------
    ParameterError
        If the vehicle is refused; it says why, and what 'drop' would do.
    """
    choice = vehicle.lost_axes if lost_axes is None else lost_axes
    if choice not in LOST_AXES:
        raise ParameterError(f'lost_axes: expected one of {", ".join(LOST_AXES)}, got {choice!r}')
    report = audit(vehicle)
    if choice == 'refuse' and not report.sound:
        without = f'without {", ".join(report.lost)}' if report.lost else 'as it is'
        flies = '' if report.keeps_hovering else ', although it cannot hover'
        raise ParameterError(
            f'allocation.lost_axes: this vehicle is refused: {report} '
            f"('drop' accepts it {without}{flies})"
        )
    return report


def lift(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and the greatest mass that the rotors lift, torques aside [kg]."""
    up = vehicle.rotor_axes[:, 2]
    ends = np.sort([up * vehicle.thrust_min, up * vehicle.thrust_max], axis=0)
    least, most = ends.sum(axis=1) / vehicle.gravity
    return float(least), float(most)


def unit(axis: str) -> str:
    """Return the unit of a component of the wrench."""
    return 'N m' if axis in ('roll', 'pitch', 'yaw') else 'N'


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


def _hover_margin(problem: AllocationProblem) -> float:
    return float(problem.image.margin(problem.hover)) if problem.spans else -np.inf


def _independent(problem: AllocationProblem) -> bool:
    return problem.spans and bool(_independence(_unit_rows(problem)).min() >= INDEPENDENCE_MIN)


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


def _spin_torque(asked: AllocationProblem, kept: AllocationProblem) -> float:
    """Return the yaw torque nearest to zero with which the axes of `kept` hover [N m]."""
    if 'yaw' in kept.axes or 'yaw' not in asked.axes:
        return 0.0
    axes = tuple(axis for axis in asked.axes if axis in (*kept.axes, 'yaw'))
    with_yaw = AllocationProblem(replace(asked.vehicle, axes=axes))
    place = axes.index('yaw')
    if with_yaw.spans:
        rows = [row for row in range(len(axes)) if row != place]
        yaw = float(Prioritization(with_yaw, [rows, [place]])(with_yaw.hover)[0][place])
    else:
        tolerance = float(kept.tolerance(kept.hover))
        thrusts = kept.least_norm.solve(kept.hover, tolerance).thrusts
        yaw = float(with_yaw.gamma[place] @ thrusts)
    return yaw if abs(yaw) > 1e-9 else 0.0


def _authority(problem: AllocationProblem) -> dict[str, tuple[float, float]]:
    units = dict(zip(problem.axes, np.eye(len(problem.axes)), strict=True))
    return {
        axis: (-problem.reach(problem.hover, -unit), problem.reach(problem.hover, unit))
        for axis, unit in units.items()
    }
