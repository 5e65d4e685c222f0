"""Errors of answers, computed from the problem's data."""

from time import perf_counter_ns

import numpy as np
import pandas as pd

from ca_ros.allocation import AllocationProblem, Allocator, Status
from ca_ros.arrays import Array
from ca_ros.errors import CaRosError

VIOLATION = 1e-9  # thrusts that are further outside their bounds than this violate them [N]
COLUMNS = {'roll': 'tau_x', 'pitch': 'tau_y', 'yaw': 'tau_z'}  # columns that are not named as axes

ERRORS = {
    'force_error': 'force error [N]', 'torque_error': 'torque error [N m]',
    'error': 'error of all axes',
}
"""Titles of the errors: force and torque of a wrench, one of axes in other units."""


def columns(problem: AllocationProblem) -> list[str]:
    """Return the names of the columns of u."""
    pairs = zip(problem.axes, problem.axis_units, strict=True)
    return [COLUMNS.get(axis, axis) if unit == 'N m' else axis for axis, unit in pairs]


def errors(problem: AllocationProblem, demands: Array, thrusts: Array) -> dict[str, Array]:
    """Return the errors (N,) of thrusts (N, n) for wrenches (N, m), by the keys of `ERRORS`."""
    residual = problem.residual(demands, thrusts)
    units = np.array(problem.axis_units)
    parts = {'error': units == units}
    if {*problem.axis_units} <= {'N', 'N m'}:
        parts = {'force_error': units == 'N', 'torque_error': units == 'N m'}
    return {name: np.linalg.norm(residual[:, part], axis=1) for name, part in parts.items()}


def evaluate(
    name: str, allocator: Allocator, problem: AllocationProblem, demands: Array, batch: bool
) -> pd.DataFrame:
    """Allocate wrenches (N, m) [N, N m] and measure the errors of the answers.

    A batch is one call, whose time is divided equally; otherwise wrenches are allocated one by
    one.  Returns one row per wrench: the columns of static.csv but ``sample``, and ``violation``,
    the largest violation of the bounds by the method's thrusts before saturation [N].  Raises an
    CaRosError if the answers are not thrusts of the vehicle's rotors.
    """
    whole = batch and hasattr(allocator, 'allocate_batch')
    call = allocator.allocate_batch if whole else allocator.allocate
    answers, times = [], []
    for u in [demands] if whole else demands:
        start = perf_counter_ns()
        answers.append(call(u))
        times.append((perf_counter_ns() - start) / 1e9 / (len(demands) if whole else 1))
    try:
        used = ('thrusts', 'violation', 'status')
        parts = [np.array([getattr(each, part) for each in answers]) for part in used]
    except AttributeError:
        raise CaRosError(f'{name}: allocate has to return an Allocation') from None
    thrusts = parts[0].astype(float).reshape(-1, parts[0].shape[-1])
    if thrusts.shape != (len(demands), problem.n) or not np.isfinite(thrusts).all():
        raise CaRosError(
            f'{name}: expected finite thrusts of {problem.n} rotors for each wrench, got an array '
            f'of shape {thrusts.shape}'
        )
    outside = problem.violation(thrusts)
    violation = np.maximum(parts[1].astype(float).ravel(), outside)
    status = np.broadcast_to(parts[2].astype(np.int8).ravel(), outside.shape)
    return pd.DataFrame(
        {
            'method': name, **dict(zip(columns(problem), demands.T, strict=True)),
            **{f'f_{i + 1}': column for i, column in enumerate(thrusts.T)},
            'violated': (violation > VIOLATION).astype(np.int8),
            **errors(problem, demands, thrusts), 'time': np.broadcast_to(times, outside.shape),
            'status': pd.Categorical.from_codes(status, [each.name for each in Status]),
            'violation': violation,
        }
    )
