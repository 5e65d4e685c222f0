"""The axes of methods that treat thrust, roll, pitch and yaw differently."""

from collections.abc import Callable

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.settings import AXES


def mixer(
    method: str, problem: AllocationProblem,
    dropped: Callable[[AllocationProblem], list[int]] | None = None,
) -> tuple[dict[str, Array], Array, Array]:
    """Return the column (n,) of the pseudo-inverse for each axis: thrust per wrench.

    Rotors that cannot change their thrust, such as lost ones, have zeros, and so have the axes
    whose numbers `dropped` returns.  The thrusts (n,) of fixed rotors and the wrench (m,) that
    these give come after the columns.

    Raises a ValueError unless the axes are those of a multirotor, thrust among them.  Axes may be
    missing, because a vehicle that loses rotors can lose its yaw.
    """
    strange = [axis for axis in problem.axes if axis not in AXES]
    if strange or 'thrust' not in problem.axes:
        fault = f'not {", ".join(strange)}' if strange else 'and needs thrust'
        raise ValueError(
            f'{method} is for multirotors: it knows the axes {", ".join(AXES)}, {fault}; '
            f'this problem has {", ".join(problem.axes)}'
        )
    kept = problem.gamma * (problem.half_range > 0.0)
    if dropped is not None:
        kept[dropped(problem)] = 0.0
    inverse = np.linalg.pinv(kept)
    fixed = problem.middle * (problem.half_range == 0.0)
    return dict(zip(problem.axes, inverse.T, strict=True)), fixed, problem.gamma @ fixed
