"""Measure the worst case of the kernel for every shipped vehicle; fill docs/firmware.md.

Allocates wrenches inside, on and outside of the admissible set, then searches for worse ones: it
changes the worst wrenches and keeps the worst of all.  Takes some minutes.
"""

from __future__ import annotations

import argparse
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass, field
from itertools import product
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from hard_wrenches import mutated, sampled
from pages import fill, shipped, telling

import ca_ros.kernel
from ca_ros.allocation.result import Status
from ca_ros.arrays import Array
from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.problem.problem import lengths
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle

CHUNK = 60_000
"""Wrenches of one call of the kernel."""

MEASURES = ('steps', 'pivots', 'products')

MANY = 20
"""Steps of a call of which the distance from the boundary is measured."""

POOL = 1000
"""Worst wrenches that the search mutates."""


def constant(name: str) -> int:
    """Return an integer that the C code defines."""
    folder = Path(ca_ros.kernel.__file__).parent
    text = ''.join((folder / file).read_text() for file in ('least_norm.c', 'priorities.c'))
    [value] = re.findall(rf'^#define {name} (\d+)$', text, re.MULTILINE)
    return int(value)


@dataclass(frozen=True)
class Bounds:
    """The greatest numbers of steps and pivots of a call, and of products in one of them.

    Products are multiplications and divisions, counted from the loops of the C code.
    """

    steps: int
    pivots: int
    per_step: int
    per_pivot: int

    @classmethod
    def of(cls, firmware: Firmware, fault: int) -> Bounds:
        """Return the bounds of the loops for one fault of a vehicle."""
        fields = firmware.kernels[fault].fields()
        order, group, senses = (fields[name][2] for name in ('order', 'group', 'keep_sense'))
        (n,), (m,), (slack,) = (fields[name][2] for name in ('n', 'm', 'slack'))
        n, m = int(n), int(m)
        # `ca_allocate`: attempt; then the priorities, and at worst `ca_least_norm` twice.
        relaxes = slack > (1e-5 if firmware.single else 1e-12)
        attempt = 0 if n == m else constant('ATTEMPT')
        settle = 3 if firmware.single else n
        steps = attempt + 3 * settle + (4 if relaxes else 2) * constant('STEPS')
        # `serve`: a push for the first group, for each sense, and for each other group and axis.
        sizes = [group[:m].count(i) for i in sorted(set(group[:m]))]
        variables, rows, columns = n + m + (sizes[0] > 1), m, n + 1
        turns = [variables]
        turns += [variables for axis in order[sizes[0] : m] if senses[int(axis)]]
        for size in sizes[1:]:
            if size > 1:
                variables, rows, columns = variables + 1 + 2 * size, rows + 2 * size, columns + 1
                turns.append(variables)
            turns += [variables] * size
        pivots = sum(1 + constant('PIVOTS_PER_VARIABLE') * count for count in turns)
        return cls(steps, pivots, _step(n, m, n + m * relaxes), rows * (columns + 4))

    def products(self, steps: int, pivots: int) -> int:
        """Return how many products some steps and pivots take at most."""
        return steps * self.per_step + pivots * self.per_pivot


def _step(n: int, m: int, count: int) -> int:
    """Return the greatest number of products of a Newton step with `count` actuators."""
    definite = m * (m + 1) * (m + 2) // 6 + m * m
    residuals = 2 * (n * m + m * m)
    normal = count // 2 * m * (m + 3) // 2 + definite
    spanned = count * (2 * m * m - m) + 3 * m * m
    in_span = count * (m * m + m * (m + 1) // 2) + definite + m * m
    factors = 3 * count * m * (m + 1) // 2 + m * m * (m + 1) + m
    solution = 4 * m * m + count * m
    search = 2 * (count * m + m + 8 * count + 1)
    solves = normal + spanned + in_span + factors + solution
    return count * m + count + m + residuals + solves + search + 4 * m * m + 2 * m


@dataclass
class Worst:
    """The greatest numbers found for one vehicle and precision, with their wrenches."""

    steps: int = 0
    pivots: int = 0
    products: int = 0
    inexact: int = 0
    distance: float = 0.0
    examples: dict[str, str] = field(default_factory=dict)

    def meet(self, firmware: Firmware, fault: int, bounds: Bounds, u: Array) -> Array:
        """Allocate wrenches (N, m); return their measures (N, 3)."""
        demands = np.ascontiguousarray(u, firmware.dtype)
        size = len(demands)
        work: Any = np.empty((size, 2), np.int32)
        status = np.empty(size, np.int8)
        thrusts = np.empty((size, firmware.problem.n), firmware.dtype)
        levels = np.empty(size, firmware.dtype)
        firmware.kernels[fault].allocate_batch(demands, thrusts, status, levels, work)
        found: Array = np.column_stack([work, work @ [bounds.per_step, bounds.per_pivot]])
        inexact = status == Status.INEXACT
        many = demands[found[:, 0] > MANY].astype(float)
        if len(many):
            margins = np.abs(firmware.faults[fault].problem.image.margin(many))
            distances = margins / np.maximum(1.0, lengths(many))
            self.distance = max(self.distance, float(distances.max()))
        self.inexact += int(inexact.sum())
        for name, column in zip(MEASURES, found.T, strict=True):
            if column.max() > getattr(self, name):
                setattr(self, name, int(column.max()))
                self._note(name, firmware, fault, demands[column.argmax()])
        if inexact.any():
            self._note('inexact', firmware, fault, demands[inexact.argmax()])
        return found

    def _note(self, name: str, firmware: Firmware, fault: int, u: Array) -> None:
        self.examples[name] = f'{firmware.faults[fault].constant} {u.tolist()}'


def measure(firmware: Firmware, size: int, generations: int) -> tuple[Worst, Worst, Bounds]:
    """Return the worst cases of the sample and of the search, and the greatest bounds of a fault.

    Of the wrenches a fifth is for vehicles that have lost a rotor.
    """
    sample, searched = Worst(), Worst()
    limits = [Bounds.of(firmware, fault) for fault in range(len(firmware.faults))]
    for fault, (case, bounds) in enumerate(zip(firmware.faults, limits, strict=True)):
        rng = np.random.default_rng(fault)
        share = 0.8 if fault == 0 else 0.2 / (len(firmware.faults) - 1)
        pools = [np.empty((0, len(case.problem.axes)))] * len(MEASURES)
        ranks = [np.empty(0)] * len(MEASURES)
        for chunk in range(ceil(share * size / CHUNK) + ceil(share * generations)):
            if chunk * CHUNK < share * size:
                u = sampled(case.problem, firmware.precision, rng, CHUNK)
                found = sample.meet(firmware, fault, bounds, u)
            else:
                u = np.vstack([mutated(case.problem, pool, rng) for pool in pools])
                found = searched.meet(firmware, fault, bounds, u)
            for k in range(len(MEASURES)):
                # Of equals any is kept: so the search moves on where all are the same.
                pool, rank = np.vstack([pools[k], u]), np.append(ranks[k], found[:, k])
                best = np.argsort(rng.random(len(rank)) - rank)[:POOL]
                pools[k], ranks[k] = pool[best], rank[best]
    return sample, searched, Bounds(*np.max([astuple(limit) for limit in limits], axis=0).tolist())


def row(task: tuple[str, str, int, int]) -> tuple[list[str], str]:
    """Return the row of one vehicle and precision, and the wrenches of its worst cases."""
    name, precision, size, generations = task
    firmware = Firmware.make(
        faults_of(Vehicle.load(name), ['single']), checked(read(name)), precision
    )
    sample, searched, bounds = measure(firmware, size, generations)
    most = max(sample.products, searched.products)
    distance = max(sample.distance, searched.distance)
    counts = max(sample.steps, searched.steps), bounds.steps
    counts += max(sample.pivots, searched.pivots), bounds.pivots
    products = most, bounds.products(bounds.steps, bounds.pivots)
    cells = [
        *(f'`{name}`', precision, *map(str, counts), *(f'{each / 1e3:.0f}' for each in products)),
        *(f'{distance:.0e}' if distance else '', str(sample.inexact + searched.inexact)),
    ]
    return cells, f'{name} {precision}: {sample}\n    search: {searched}'


SHOWN = [('`hexarotor`', 'double'), ('`hexarotor`', 'single'), ('`octorotor`', 'single')]
SHOWN += [('`rov`', 'double')]

TITLES = (
    *('vehicle', 'precision', 'steps', 'bound', 'pivots', 'bound', 'thousand products', 'bound'),
    *(f'distance, over {MANY} steps', 'inexact'),
)


def main() -> None:
    """Fill the table, and print the wrenches of the worst cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--size', type=int, default=10_000_000, help='wrenches for each row')
    parser.add_argument('--generations', type=int, default=100, help='of the search')
    options = parser.parse_args()
    tasks = [
        (*each, options.size, options.generations)
        for each in product(shipped(), ('double', 'single'))
    ]
    rows = []
    with ProcessPoolExecutor() as pool:
        for cells, words in pool.map(row, tasks):
            rows.append(cells)
            print(words, flush=True)
    found = telling('worst_case', TITLES, rows, lambda row: tuple(row[:2]) in SHOWN, words=2)
    fill('firmware.md', worst_case=found)


if __name__ == '__main__':
    main()
