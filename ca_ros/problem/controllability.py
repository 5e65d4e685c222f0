"""Which axes of a problem the rotors can control: independence, hover, axes to give up."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import TypeVar

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem, thrust_sets
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle

EXPENDABLE = ('force_y', 'force_x', 'yaw', 'pitch', 'roll')  # see `expendable`

INDEPENDENCE_MIN = 0.05
"""Least sine of the angle between the row of one axis (`unit_rows`) and the span of the others.

At 0.05 a command along the axis takes twenty times the thrusts that it would take alone.
"""

SIDE_FORCE_MIN = 1e-6  # least force that counts, as a share of the weight

DEPENDENT = 1e-6  # singular value below which a pseudo-inverse has too few digits

STATED_CHOICES_MAX = 2000  # facet candidates up to which facets answer questions of hover: 1 ms

Axes = tuple[str, ...]
Part = TypeVar('Part', bound=AllocationProblem)


def lift(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and the greatest mass that the rotors lift, torques ignored [kg]."""
    sets, directions = thrust_sets(vehicle)
    up = directions[:, 2]
    ends = np.array([-sets.support(-up), sets.support(up)])
    least, most = ((ends + vehicle.buoyancy) / vehicle.gravity).tolist()
    return least, most


def unit_rows(problem: AllocationProblem) -> Array:
    """Return Gamma (m, n) with columns weighted by the ranges of the thrusts, in rows of length 1.

    Rows of zeros stay.
    """
    rows = problem.gamma * (problem.upper - problem.lower)
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(lengths > 0.0, lengths, 1.0)


def independence(rows: Array) -> Array:
    """Return the distance (m,) of each of the `unit_rows` (m, n) from the span of the others."""
    found = _distances(rows)
    if found is not None:
        return found
    return np.array([_distance(rows, i) for i in range(len(rows))])


def _distance(rows: Array, i: int) -> float:
    """Return the distance of one of the `unit_rows` from the span of the others."""
    others = np.delete(rows, i, axis=0).T
    rest = rows[i] - others @ np.linalg.lstsq(others, rows[i], rcond=1e-12)[0]
    return float(np.linalg.norm(rest))


def _distances(rows: Array) -> Array | None:
    """Return `_distance` of all `unit_rows` (m,); None if one may be below `DEPENDENT`."""
    left, singular, _ = np.linalg.svd(rows, full_matrices=False)
    if rows.shape[0] > rows.shape[1] or singular[-1] <= DEPENDENT:
        return None
    # The columns of the pseudo-inverse have the inverse of the distance as length.
    return np.asarray(1.0 / np.linalg.norm(left / singular, axis=1), float)


def expendable(axes: Sequence[str]) -> list[str]:
    """Return the axes that may be given up, in this order: those that `exact` serves last."""
    others = [axis for axis in axes if axis not in AXES]
    return [*reversed(others), *(axis for axis in EXPENDABLE if axis in axes)]


def independent_part(problem: Part) -> Part:
    """Return the problem without the axes that the effectors cannot control independently."""
    return _part(problem, lambda part: part.interior.independence >= INDEPENDENCE_MIN, _dependent)


def _dependent(problem: AllocationProblem, candidates: Sequence[str]) -> str:
    """Return the first candidate that the other axes determine; the first one if none is.

    An axis that is independent of all others stays.  Other axes follow the candidates, but not
    those that are `kept_axes` of the problem.
    """
    rows = unit_rows(problem)
    others = [axis for axis in problem.axes if axis not in (*candidates, *problem.kept_axes)]
    return next(
        (axis for axis in [*candidates, *others]
         if _distance(rows, problem.axes.index(axis)) < INDEPENDENCE_MIN), candidates[0])


def holding_part(problem: Part) -> Part:
    """Return the problem without axes that prevent hover, or another reference.

    It is unchanged if no choice of axes allows it.
    """
    # No choice of axes lifts what the thrust alone does not.
    if problem.interior.has_reference or (
            'thrust' in problem.axes and not problem.part(('thrust',)).interior.has_reference):
        return problem
    found = _part(problem, lambda part: part.interior.has_reference)
    return found if found.interior.has_reference else problem


def _part(
    problem: Part, good: Callable[[Part], bool],
    first: Callable[[Part, Sequence[str]], str] = lambda _, candidates: candidates[0],
) -> Part:
    """Return the problem without the axes that are given up until it is good.

    An axis whose removal suffices is preferred; `first` chooses among the candidates if there is
    none.
    """

    @cache
    def part(axes: Axes) -> Part:
        return problem if axes == problem.axes else problem.part(axes)

    axes = problem.axes
    while len(axes) > 1 and not good(part(axes)):
        candidates = expendable(axes)
        parts = (_without(axes, lost) for lost in candidates)
        found = next((each for each in parts if good(part(each))), None)
        axes = _without(axes, first(part(axes), candidates)) if found is None else found
    return part(axes)


def _without(axes: Axes, lost: str) -> Axes:
    return tuple(axis for axis in axes if axis != lost)


def spin_torque(full: VehicleProblem, kept: Sequence[str], thrusts: Array) -> float:
    """Return the yaw torque nearest to zero with which some axes hover [N m].

    `kept`: these axes.  `thrusts` (n,): with which they hover [N].
    """
    if 'yaw' in kept or 'yaw' not in full.axes:
        return 0.0
    axes = tuple(axis for axis in full.axes if axis in (*kept, 'yaw'))
    with_yaw = full.part(axes)
    start = with_yaw.gamma @ thrusts
    yaw = np.where(np.array(axes) == 'yaw', start, 0.0)
    if with_yaw.interior.has_volume:
        yaw = yaw * (1.0 - with_yaw.reach(start, -yaw, 1.0))
    return float(yaw.sum()) if np.abs(yaw).max() > 1e-9 else 0.0


def side_force(problem: VehicleProblem, thrusts: Array) -> Array:
    """Return the force (2,) along x and y that hover with thrusts (n,) leaves [N].

    It is zero where the force is an axis of the problem.
    """
    force = problem.wrenches[:2] @ thrusts
    # What an allocation serves is served to rounding.
    served = [axis in problem.axes for axis in ('force_x', 'force_y')]
    least = SIDE_FORCE_MIN * abs(problem.vehicle.weight)
    return np.where(served | (np.abs(force) <= least), 0.0, force)


def authority(problem: AllocationProblem) -> dict[str, tuple[float, float]]:
    """Return the range of each axis with the others at hover, or at another reference."""
    ways = np.diag(problem.extent)
    if problem.program.facet_choices <= STATED_CHOICES_MAX:
        ends = problem.box.attainable_set.reach(problem.reference, np.concatenate([-ways, ways]))
    else:
        ends = np.array([problem.reach(problem.reference, way) for way in (*-ways, *ways)])
    low, high = (ends.reshape(2, -1) * [[-1.0], [1.0]] * problem.extent).tolist()
    return dict(zip(problem.axes, zip(low, high, strict=True), strict=True))
