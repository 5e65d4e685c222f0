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
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.benchmark_plot import draw
from ca_ros.evaluation.benchmark.benchmark_tables import document, summary
from ca_ros.evaluation.benchmark.c_contenders import compiled
from ca_ros.evaluation.benchmark.contenders import BASELINE, CONTENDERS, POLICIES, method, set_up
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
from ca_ros.evaluation.judge import AnswerError
from ca_ros.evaluation.options import command, natural, parser, positive, write
from ca_ros.evaluation.paper import of_the_paper
from ca_ros.flight.controller import Gains
from ca_ros.flight.plots import save
from ca_ros.problem.admissible_set import AdmissibleSet


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    if argv is None and any(os.environ.get(name) != '1' for name in THREADS):
        # The libraries of NumPy read these variables when they are loaded, so restart.
        environ = {**os.environ, **dict.fromkeys(THREADS, '1')}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environ)
    try:
        case, allocators = Case.of(options)
    except (ValueError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    plan = QUICK if options.quick else FULL
    if options.samples:
        plan = replace(plan, wrenches=options.samples, flight=options.samples)
    # Errors in a method of the user's own are shown with their traceback.
    try:
        found, rows = run(case, list(allocators), plan, options)
        out = options.out / 'benchmark'
        write(out, rows, found, document(found))
        save(draw(pd.DataFrame(found['results'])), out, options.figures)
    except (AnswerError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('benchmark: interrupted; nothing is written', file=sys.stderr)
        return 130
    print(summary(found))
    print(f'written: benchmark.csv, .json, .md and plot in {options.out}')
    if 'error' in found['node']:
        print(f'benchmark: the nodes: {found["node"]["error"]}', file=sys.stderr)
        return 1
    return 0


def run(
    case: Case, methods: Sequence[str], plan: Plan, options: argparse.Namespace
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Measure everything; return what benchmark.json and benchmark.csv hold."""
    start, stolen_before, surroundings = time.perf_counter(), stolen(), environment()
    admissible = AdmissibleSet(case.vehicle)
    gains, chance = Gains.from_parameters(case.parameters), np.random.default_rng(options.seed)
    wrenches = {
        'uniform': admissible.sample(chance, plan.wrenches),
        'boundary': loads.boundary(admissible, chance, plan.wrenches),
        'flight': loads.flight(case.vehicle, gains, plan.flight),
    }
    own = {name: method(partial(case.allocator, name)) for name in methods}
    policies = POLICIES if 'exact' in own else {}
    contenders = {BASELINE: CONTENDERS[BASELINE], **own, **policies, **CONTENDERS}
    problem, shared = admissible.problem, (plan, options.seed)
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
        parts.append(time_rotors(plan, rival, options.seed))
        parts.append(time_setups(*shared))
    allocators = {name: case.allocator(name) for name in dict.fromkeys(['exact', *methods])}
    loop = (rival, calls[rival]) if rival else None
    parts.append(time_batches(admissible, allocators, loop, *shared))
    exact = allocators['exact']
    flights, flown = time_flights(exact, gains, wrenches['flight'], *shared)
    rows = pd.concat([*parts, flights], ignore_index=True)
    saturated = {
        load: float((exact.allocate_batch(demands).saturation != 0).any(axis=1).mean())
        for load, demands in wrenches.items()
    }
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
            load: {'about': text, 'wrenches': len(wrenches[load]), 'saturated': saturated[load]}
            for load, text in loads.LOADS.items()
        },
        'contenders': about,
        'absent': absent,
        'C': about_c,
        'results': records(summarize(rows)),
        'rival': rival,
        'flight': {
            'steps': len(flown.time),
            'final_error': flown.position_error(loads.WAYPOINTS[0]),
        },
        'node': _nodes(case, options),
    }
    surroundings |= {'load_average_after': load_average(), 'stolen': stolen(since=stolen_before)}
    found |= {'environment': surroundings, 'wall_time': time.perf_counter() - start}
    found['promises'] = promises(found, rows) if paper else []
    return found, rows


def _nodes(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """Return the metrics of the nodes; 'absent' or 'error' with the reason if there are none."""
    if options.no_nodes:
        return {'absent': 'left out by --no-nodes'}
    if find_spec('rclpy') is None:
        return {'absent': 'rclpy is not installed'}
    from ca_ros.evaluation.latency.client import LatencyError
    from ca_ros.evaluation.latency.latency import measure_nodes

    try:
        return measure_nodes(case.name, options.quick)
    except LatencyError as error:
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
