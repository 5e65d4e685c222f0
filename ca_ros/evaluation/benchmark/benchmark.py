"""The benchmark: how fast everything is, compared with the solvers of others."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.arguments import split
from ca_ros.errors import CaRosError
from ca_ros.evaluation.benchmark.benchmark_plot import draw
from ca_ros.evaluation.benchmark.benchmark_tables import document
from ca_ros.evaluation.benchmark.c_contenders import compiled
from ca_ros.evaluation.benchmark.contenders import BASELINE, CONTENDERS, POLICIES, method, set_up
from ca_ros.evaluation.benchmark.loads import LOADS, WAYPOINTS, drawn
from ca_ros.evaluation.benchmark.measurements import (
    time_batches,
    time_calls,
    time_flights,
    time_rotors,
)
from ca_ros.evaluation.benchmark.plan import FULL, QUICK, Plan
from ca_ros.evaluation.benchmark.promises import promises
from ca_ros.evaluation.benchmark.results import fastest, records, summarize
from ca_ros.evaluation.benchmark.setups import time_setups
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.environment import THREADS, environment, load_average, stolen
from ca_ros.evaluation.options import command, concluded, natural, parser, positive, write
from ca_ros.evaluation.paper import of_the_paper
from ca_ros.flight.figures import save
from ca_ros.problem.admissible_set import AdmissibleSet


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    if argv is None and any(os.environ.get(name) != '1' for name in THREADS):
        # The libraries of NumPy read these variables when they are loaded, so restart.
        environ = {**os.environ, **dict.fromkeys(THREADS, '1')}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environ)
    return concluded('benchmark', partial(_benchmark, options))


def _benchmark(options: argparse.Namespace) -> None:
    """Measure, write all files, and print the most important tables."""
    case, allocators = Case.of(options)
    plan = QUICK if options.quick else FULL
    if options.samples:
        plan = replace(plan, wrenches=options.samples, flight=options.samples)
    found, rows = run(case, list(allocators), plan, options)
    text, out = document(found), options.out / 'benchmark'
    write(out, rows, found, text)
    save(draw(pd.DataFrame(found['results']), options.figure_width), out, options.figures)
    print(text.partition('\n## Percentiles')[0])
    print(f'written: benchmark.csv, .json, .md and plot in {options.out}')
    if 'error' in found['node']:
        raise CaRosError(f'the nodes: {found["node"]["error"]}')


def run(
    case: Case, methods: Sequence[str], plan: Plan, options: argparse.Namespace
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Measure everything; return what benchmark.json and benchmark.csv hold."""
    start, stolen_before, surroundings = time.perf_counter(), stolen(), environment()
    shared = plan, options.seed
    wrenches = drawn(case.parameters, case.problem, *shared)
    own = {name: method(partial(case.allocator, name)) for name in methods}
    policies = POLICIES if 'exact' in own else {}
    contenders = {BASELINE: CONTENDERS[BASELINE], **own, **policies, **CONTENDERS}
    admissible = AdmissibleSet(case.problem)
    problem = admissible.problem
    calls, about, absent = set_up(contenders, problem)
    parts = [time_calls(problem, calls, wrenches, *shared)]
    peers = [name for name, each in about.items() if each['kind'] == 'peer']
    rival = fastest(summarize(parts[0]), 'uniform', peers)
    in_c, about_c = compiled(problem)
    if in_c:
        parts.append(time_calls(problem, in_c, wrenches, *shared, 'C'))
    # The other numbers of rotors and the promises are those of the paper's vehicle.
    paper = of_the_paper(case.parameters)
    if paper:
        parts += [time_rotors(plan, rival, options.seed), time_setups(*shared)]
    allocators = {name: case.allocator(name) for name in dict.fromkeys(['exact', *methods])}
    loop = (rival, calls[rival]) if rival else None
    many = admissible.sample(np.random.default_rng(options.seed), max(plan.batches))
    parts.append(time_batches(many, allocators, loop, *shared))
    exact, flight = allocators['exact'], None
    if case.flies:
        flights, flown = time_flights(case.controller(), exact, wrenches['flight'], *shared)
        parts.append(flights)
        error = flown.position_error(WAYPOINTS[0])
        flight = {'steps': len(flown.time), 'final_error': error}
    rows = pd.concat(parts, ignore_index=True)
    found: dict[str, Any] = {
        'command': command('benchmark', options),
        'settings': {
            'vehicle': case.name,
            'changes': case.changes,
            'parameters': case.parameters,
            'methods': methods,
            'seed': options.seed,
            'quick': options.quick,
            'plan': asdict(plan),
        },
        'loads': {
            name: {
                'about': load.about,
                'wrenches': len(wrenches[name]),
                'saturated': float(exact.allocate_batch(wrenches[name]).saturation.any(1).mean()),
            }
            for name, load in LOADS.items()
            if name in wrenches
        },
        'contenders': about,
        'absent': absent,
        'C': about_c,
        'results': records(summarize(rows)),
        'rival': rival,
        'flight': flight,
        'left_out': case.left_out,
        'node': _nodes(case, options),
    }
    surroundings |= {'load_average_after': load_average(), 'stolen': stolen(since=stolen_before)}
    found |= {'environment': surroundings, 'wall_time': time.perf_counter() - start}
    return found | {'promises': promises(found, rows) if paper else []}, rows


def _nodes(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """Return the metrics of the nodes; 'absent' or 'error' with the reason if there are none."""
    if not case.flies:
        return {'absent': 'a problem without a vehicle has no rotor speeds'}
    if options.no_nodes:
        return {'absent': 'left out by --no-nodes'}
    if find_spec('rclpy') is None:
        return {'absent': 'rclpy is not installed'}
    from ca_ros.evaluation.latency.latency import measure_nodes

    try:
        return measure_nodes(case.name, options.quick)
    except CaRosError as error:
        return {'error': str(error)}


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'benchmark',
        'Time the methods beside the clipped pseudo-inverse and the solvers that are installed '
        '(pip install ca_ros[peers]): benchmark.csv, benchmark.json, benchmark.md and a plot.',
    )
    count = (
        f'wrenches of each load; by default {FULL.wrenches}, with --quick {QUICK.wrenches} '
        f'and {QUICK.flight} of the flight'
    )
    made.add_argument('--samples', type=positive(int), metavar='N', help=count)
    made.add_argument('--seed', type=natural, default=0, help='of wrenches and order')
    made.add_argument('--quick', action='store_true', help='measure less, in a minute')
    made.add_argument('--no-nodes', action='store_true', help='leave the ROS nodes out')
    return made.parse_args(split(argv)[0])


if __name__ == '__main__':
    raise SystemExit(main())
