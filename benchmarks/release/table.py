"""A few answers of `exact` for each shipped vehicle and problem: test/test_answers.py has them.

``python -m release.table FILE``, in the folder above, writes them.
"""

import csv
import sys
from collections.abc import Iterator

from ca_ros import AllocationProblem, Exact, Vehicle

from .answers import PROBLEMS, VEHICLES
from .drawn import KINDS, wrenches


def rows() -> Iterator[list[str]]:
    """Yield the name, kind of wrench, status and thrusts of two answers of each kind."""
    for name in (*VEHICLES, *PROBLEMS):
        load = AllocationProblem.load if name in PROBLEMS else Vehicle.load
        allocator = Exact(load(name))
        for kind in KINDS:
            for u in wrenches(allocator.problem, kind, 2):
                answer = allocator.allocate(u)
                thrusts = [repr(thrust) for thrust in answer.thrusts.tolist()]
                yield [name, kind, answer.status.name, *thrusts]


if __name__ == '__main__':
    with open(sys.argv[1], 'w', encoding='utf-8', newline='') as file:
        csv.writer(file, lineterminator='\n').writerows(rows())
