"""Control allocation of multirotors: from a wrench to rotor speeds."""

from ca_ros.allocation import (
    ALLOCATORS,
    Allocation,
    AllocationBatch,
    AllocationProblem,
    Allocator,
    BetaflightMixer,
    Conventional,
    Direct,
    Exact,
    Osqp,
    PseudoInverse,
    RedistributedPseudoInverse,
    SequentialDesaturation,
    Status,
    WeightedLeastSquares,
    WeightedPseudoInverse,
    make_allocator,
)
from ca_ros.allocation.slew import SlewLimited
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.detection.acted_on import acted_on
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.errors import CaRosError
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.audit import Audit, audit
from ca_ros.settings import ParameterError, Settings, setting
from ca_ros.solver.convex_sets import Interval, Sector
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.vehicle import Vehicle

__all__ = [
    'ALLOCATORS', 'AdmissibleSet', 'Allocation', 'AllocationBatch', 'AllocationProblem',
    'Allocator', 'Audit', 'BetaflightMixer', 'CaRosError', 'Conventional', 'Direct', 'Exact',
    'FailureDetector', 'Interval', 'Osqp', 'ParameterError', 'PseudoInverse',
    'RedistributedPseudoInverse', 'Sector',
    'SequentialDesaturation', 'Settings', 'SlewLimited', 'Status', 'TiltLimited',
    'Vehicle', 'WeightedLeastSquares', 'WeightedPseudoInverse', 'acted_on', 'audit',
    'control_allocation_matrix', 'make_allocator', 'make_detector',
    'setting',
]  # fmt: skip


def __getattr__(name: str) -> str:
    """Return the version; it is looked up when it is asked for."""
    if name != '__version__':
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib.metadata import version

    return version('ca_ros')
