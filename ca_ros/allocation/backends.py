"""What solves the programs of the exact allocator; the only choice of the algorithm."""

from ca_ros.allocation.box_backend import BoxBackend, BoxKernel, BoxNumpy
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.sets_backend import SetsKernel, SetsNumpy
from ca_ros.kernel import chosen, warn_if_missing
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.box import Box

Backend = BoxBackend | SetsNumpy | SetsKernel


def backend_of(problem: AllocationProblem, settings: ExactSettings) -> Backend:
    """Return the backend of a problem: for a box or for convex sets, in C or in NumPy.

    NumPy does what the kernel was not built for, or has no room for.  Raises a ValueError if the
    problem's admissible set has no volume, or a setting does not suit the problem.
    """
    if isinstance(problem.sets, Box):
        kernel = chosen(problem.n, len(problem.axes))
        if kernel is not None:
            return BoxKernel(kernel, problem, settings)
        warn_if_missing()
        return BoxNumpy(problem, settings)
    backend = SetsNumpy(problem, settings)
    if backend.engine == 'NumPy':
        warn_if_missing()
    made = backend.kernel()
    return backend if made is None else SetsKernel(made, backend)
