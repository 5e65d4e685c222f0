"""Fill the table of docs/performance.md that splits the boundary load: `exact` beside DAQP."""

from pathlib import Path
from time import perf_counter_ns

import numpy as np
from marks import filled

from ca_ros import AdmissibleSet, Status, Vehicle, make_allocator
from ca_ros.evaluation.benchmark.loads import boundary, ring
from ca_ros.evaluation.benchmark.peers import daqp_reused
from ca_ros.problem.vehicle_problem import VehicleProblem

ROTORS = (4, 6, 8, 12, 16, 24, 32)
WRENCHES, ROUNDS = 900, 15


def least_times(calls, wrenches):
    """Return the least time of each call for each wrench, (calls, wrenches) [ns]."""
    times = np.full((len(calls), len(wrenches)), np.inf)
    for _ in range(ROUNDS):
        for row, call in zip(times, calls, strict=True):
            for i, u in enumerate(wrenches):
                begin = perf_counter_ns()
                call(u)
                row[i] = min(row[i], perf_counter_ns() - begin)
    return times


def row(n):
    """Return the row of the table for n rotors."""
    problem = VehicleProblem(Vehicle.from_parameters(ring(n)))
    wrenches = boundary(AdmissibleSet(problem), np.random.default_rng(0), WRENCHES)
    exact, daqp = make_allocator('exact', problem), daqp_reused(problem)
    both = np.array([
        exact.allocate(u).status is Status.EXACT and daqp(u) is not None for u in wrenches])
    ours, theirs = least_times([exact.allocate, daqp], wrenches)
    ratios = [ours[part].mean() / theirs[part].mean() for part in (both, ~both)]
    whole = np.median(ours) / np.median(theirs)
    return f'| {n} | {both.mean():.0%} | {ratios[0]:.2f} | {ratios[1]:.2f} | {whole:.2f} |'


lines = ['| rotors | both serve exactly | mean of these | mean of the others | median of all |',
         '| ---: | ---: | ---: | ---: | ---: |', *map(row, ROTORS)]
page = Path(__file__).with_name('performance.md')
page.write_text(filled(page.read_text(encoding='utf-8'), 'boundary', '\n'.join(lines)),
                encoding='utf-8')
