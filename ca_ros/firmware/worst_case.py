"""The worst case of an exported kernel: the bounds of its loops, and the worst wrenches found.

A search allocates wrenches inside, on and outside of the admissible set, then changes the worst
ones, and keeps the worst of all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ca_ros.kernel
from ca_ros.allocation.result import Status
from ca_ros.arrays import Array
from ca_ros.firmware.firmware import Firmware
from ca_ros.problem.problem import AllocationProblem

CHUNK = 60_000  # wrenches of one call of the kernel
POOL = 1000  # worst wrenches that the search mutates

SIZE, GENERATIONS = 600_000, 20  # wrenches, and mutations of the worst, of `found`


HUGE = {'single': 11.0, 'double': 90.0}  # decimal exponents of the largest wrenches


def sampled(
    problem: AllocationProblem, precision: str, rng: np.random.Generator, size: int
) -> Array:
    """Return about `size` wrenches (N, m) of all kinds."""
    n, m, count = problem.n, len(problem.axes), size // 12
    sides = problem.box.attainable_set.sides

    def given_by(ways: Array) -> Array:
        return (problem.middle + problem.half_range * ways) @ problem.gamma.T

    def powers(low: float, high: float, columns: int = 1) -> Array:
        """Return random numbers of either sign and any order of magnitude."""
        sign = rng.choice([-1.0, 1.0], (count, columns))
        return sign * 10.0 ** rng.uniform(low, high, (count, columns))

    def on_boundary(bound: float) -> Array:
        """Return wrenches on facets; a thrust that is free in one is at a bound by chance."""
        outward = np.sign(sides[rng.integers(len(sides), size=count)])
        free = rng.uniform(-1.0, 1.0, (count, n))
        free = np.where(rng.random((count, n)) < bound, np.sign(free), free)
        return given_by(np.where(outward, rng.choice([-1.0, 1.0], (count, 1)) * outward, free))

    anything = rng.uniform(-1.0, 1.0, (count, n))
    at_bounds = np.where(rng.random((count, n)) < 0.5, np.sign(anything), anything)
    facets, edges, vertices = on_boundary(0.0), on_boundary(0.5), on_boundary(1.0)
    some = np.where(rng.random((count, 1)) < 0.5, facets, edges)
    start = np.where(rng.random((count, 1)) < 0.5, problem.center, problem.reference)
    noise, extent = rng.standard_normal((count, m)), problem.extent
    axes = np.eye(m)[rng.integers(m, size=count)]
    return np.vstack([
        given_by(anything), given_by(at_bounds), facets, edges, vertices,
        problem.center + (1.0 + powers(-13.0, -3.0)) * (some - problem.center),
        vertices + powers(-13.0, -3.0) * noise * extent,
        start + rng.uniform(1.0, 3.0, (count, 1)) * (some - start),
        powers(-3.0, 3.0) * problem.reference + powers(-16.0, -1.0) * noise * extent,
        start + powers(-3.0, 3.0) * axes * extent,
        start + powers(-6.0, 2.0, m) * (rng.random((count, m)) < 0.5) * extent,
        powers(0.0, HUGE[precision]) * noise * extent,
    ])  # fmt: skip


def mutated(problem: AllocationProblem, pool: Array, rng: np.random.Generator) -> Array:
    """Return a changed copy of each wrench of a pool (N, m), for each of five kinds of changes."""
    size, m = pool.shape
    other = pool[rng.permutation(size)]
    axes = np.eye(m)[rng.integers(m, size=size)]
    noise = rng.standard_normal((size, m)) * 10.0 ** rng.uniform(-14.0, 0.5, (size, 1))
    return np.vstack([
        pool + noise * problem.extent, pool + axes * noise * problem.extent,
        problem.center + (1.0 + noise[:, :1]) * (pool - problem.center),
        pool + rng.uniform(-0.5, 1.5, (size, 1)) * (other - pool), np.where(axes, other, pool),
    ])  # fmt: skip


def constant(name: str) -> int:
    """Return an integer that the C code defines."""
    folder = Path(ca_ros.kernel.__file__).parent
    files = 'least_norm.c', 'priorities.c', 'facet.c'
    text = ''.join((folder / file).read_text() for file in files)
    [value] = re.findall(rf'^#define {name} (\d+)$', text, re.MULTILINE)
    return int(value)


class Bounds(NamedTuple):
    """The greatest numbers of Newton steps and of simplex pivots of a call.

    `wide`: of the pivots, those of the second run of single precision, in double precision.
    """

    steps: int
    pivots: int
    wide: int

    @classmethod
    def greatest(cls, firmware: Firmware) -> Bounds:
        """Return the greatest bounds over the faults of a vehicle."""
        limits = [cls.of(firmware, fault) for fault in range(len(firmware.faults))]
        return cls(*np.max(limits, axis=0).tolist())

    @classmethod
    def of(cls, firmware: Firmware, fault: int) -> Bounds:
        """Return the bounds of the loops for one fault of a vehicle."""
        fields = firmware.kernels[fault].fields()
        order, group, senses = (fields[name][2] for name in ('order', 'group', 'keep_sense'))
        (n,), (m,), (slack,) = (fields[name][2] for name in ('n', 'm', 'slack'))
        n, m = int(n), int(m)
        planes, every = constant('PLANES'), constant('STEPS')
        relax = every if slack > (1e-5 if firmware.single else 1e-12) else 0
        attempt = 0 if n == m else constant('ATTEMPT')
        settle = 2 * (3 if firmware.single else n)
        # `solve` in exact.c. If u is proven to be unattainable: the planes, the priorities and
        # their thrusts. If not: the priorities, their thrusts and `insist`.
        proven = planes * (1 + attempt) + settle + max(1, relax) + every + settle
        insists = settle + 1 + every + settle + settle + every + settle + relax
        steps = attempt + max(proven, insists)
        # `serve`: a push for the first group, and one to its line; for each sense, and for each
        # other group and axis; three for a limit on airmode.
        sizes = [group[:m].count(i) for i in sorted(set(group[:m]))]
        variables = n + m + 2 * (sizes[0] > 1)
        turns = [variables] * (1 + (sizes[0] > 1) + 3 * (fields['thrust'][2][0] >= 0))
        turns += [variables for axis in order[sizes[0] : m] if senses[int(axis)]]
        for size in sizes[1:]:
            if size > 1:
                variables += 1 + 2 * size
                turns.append(variables)
            turns += [variables] * size
        # `ca_serve_within`: the same pushes, each with at most as many pivots as rows and columns.
        within = sum(
            2 + count - n + rows for count in turns for rows in range(1, planes + 1))
        # To begin in the middle, each axis of the first group moves to its line, and is fixed.
        starts = [n + m + 1] * sizes[0]
        once, begin = (
            sum(1 + constant('PIVOTS_PER_VARIABLE') * count for count in each)
            for each in (turns, starts))
        # A second run is in double precision.
        return cls(steps, (1 + firmware.single) * once + begin + within,
                   (once + begin) * firmware.single)


class Call(NamedTuple):
    """A call: the fault, the wrench (m,) of all axes [N, N m], and what it takes."""

    fault: int
    wrench: Array
    steps: int
    pivots: int


@dataclass
class Worst:
    """The greatest numbers found for one vehicle and precision.

    - `count`: of all wrenches
    - `calls`: those with the most ``steps`` and the most ``pivots``
    """

    steps: int = 0
    pivots: int = 0
    inexact: int = 0
    count: int = 0
    calls: dict[str, Call] = field(default_factory=dict)

    def at_bounds(self, bounds: Bounds, counts: list[int]) -> int:
        """Return the instructions of a call that reaches the bounds of its loops.

        `counts` are those of the `calls`; a step and a pivot count as in the one with the most.
        """
        taken = dict(zip(self.calls, counts, strict=True))
        return sum(
            -(-getattr(bounds, name) * count // getattr(self.calls[name], name))
            for name, count in taken.items()
        )

    def meet(self, firmware: Firmware, fault: int, u: Array) -> Array:
        """Allocate wrenches (N, m); return their steps and pivots (N, 2)."""
        demands = np.ascontiguousarray(u, firmware.dtype)
        size = len(demands)
        work: Any = np.empty((size, 2), np.int32)
        status, levels = np.empty(size, np.int8), np.empty(size, firmware.dtype)
        thrusts = np.empty((size, firmware.problem.n), firmware.dtype)
        firmware.kernels[fault].allocate_batch(demands, thrusts, status, levels, work)
        for k, name in enumerate(('steps', 'pivots')):
            i = int(np.argmax(work[:, k]))
            if work[i, k] > getattr(self, name):
                setattr(self, name, int(work[i, k]))
                wrench = np.zeros(len(firmware.problem.axes), firmware.dtype)
                wrench[firmware.rows[fault]] = demands[i]
                self.calls[name] = Call(fault, wrench, *work[i].tolist())
        self.count += size
        self.inexact += int((status == Status.INEXACT).sum())
        return work


def measure(
    firmware: Firmware, size: int, generations: int, both: Worst | None = None
) -> tuple[Worst, Worst, Bounds]:
    """Return the worst cases of the sample and of the search, and the greatest bounds of a fault.

    Of the wrenches a fifth is for vehicles that have lost a rotor, if there are any.  `both` takes
    the place of the two.
    """
    sample, searched = both or Worst(), both or Worst()
    for fault, case in enumerate(firmware.faults):
        rng = np.random.default_rng(fault)
        others = len(firmware.faults) - 1
        share = 0.2 / others if fault else 0.8 if others else 1.0
        pools = [np.empty((0, len(case.problem.axes)))] * 2
        ranks = [np.empty(0)] * 2
        for chunk in range(ceil(share * size / CHUNK) + ceil(share * generations)):
            if chunk * CHUNK < share * size:
                u = sampled(case.problem, firmware.precision, rng, CHUNK)
                found = sample.meet(firmware, fault, u)
            else:
                u = np.vstack([mutated(case.problem, pool, rng) for pool in pools])
                found = searched.meet(firmware, fault, u)
            for k in range(2):
                # Of equals any is kept: so the search moves on where all are the same.
                pool, rank = np.vstack([pools[k], u]), np.append(ranks[k], found[:, k])
                best = np.argsort(rng.random(len(rank)) - rank)[:POOL]
                pools[k], ranks[k] = pool[best], rank[best]
    return sample, searched, Bounds.greatest(firmware)


def found(firmware: Firmware, size: int = SIZE, generations: int = GENERATIONS) -> Worst:
    """Return the worst of the sample and of the search together."""
    return measure(firmware, size, generations, Worst())[0]
