"""Control allocation of multirotors: from a wrench to rotor speeds."""

from ca_ros.allocation import (
    ALLOCATORS,
    Allocation,
    AllocationProblem,
    Allocator,
    Status,
    make_allocator,
)
from ca_ros.allocation.allocator import takes_settings
from ca_ros.allocation.slew import SlewLimited
from ca_ros.errors import CaRosError
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.audit import Audit, audit
from ca_ros.problem.files import load_problem
from ca_ros.settings import ParameterError, Settings, setting
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.vehicle import Vehicle

__all__ = [
    'ALLOCATORS',
    'AdmissibleSet',
    'Allocation',
    'AllocationProblem',
    'Allocator',
    'Audit',
    'CaRosError',
    'ParameterError',
    'Settings',
    'SlewLimited',
    'Status',
    'Vehicle',
    'audit',
    'control_allocation_matrix',
    'load_problem',
    'make_allocator',
    'setting',
    'takes_settings',
]
