"""The allocator node: wrenches in, rotor speeds out."""

from __future__ import annotations

import sys

from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.executable import run
from ca_ros.nodes.problem_allocator import ProblemAllocatorNode, names_problem, parse_problem


def main() -> int:
    """Run the node, of a vehicle or of a problem without one."""
    about = 'Allocate command/wrench to command/motor_speed.'
    if names_problem(sys.argv[1:]):
        return run('allocator', ProblemAllocatorNode, about, parse=parse_problem)
    return run('allocator', AllocatorNode, about)


if __name__ == '__main__':
    raise SystemExit(main())
