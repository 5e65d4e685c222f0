"""Tests of nodes: a ROS graph per test, with processes and nodes, lockstep and faults."""

from ca_ros.process.diagnostics import counts
from ca_ros.testing.faults import FaultProxy
from ca_ros.testing.graph import BEST_EFFORT, RELIABLE, Diagnostics, Graph, Parameters
from ca_ros.testing.lockstep import Lockstep, six, wrench
from ca_ros.testing.processes import DEADLINE, executable

__all__ = [
    'BEST_EFFORT', 'DEADLINE', 'RELIABLE', 'Diagnostics', 'FaultProxy', 'Graph', 'Lockstep',
    'Parameters', 'counts', 'executable', 'six', 'wrench',
]  # fmt: skip
