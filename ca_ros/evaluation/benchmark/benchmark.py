"""The benchmark: how fast everything is, beside solvers that others have written."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.arguments import split
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.benchmark_plot import draw
from ca_ros.evaluation.benchmark.benchmark_tables import document, summary
from ca_ros.evaluation.benchmark.measurements import (
    fastest_correct_peer,
    time_batches,
    time_calls,
    time_flights,
    time_growth,
)
from ca_ros.evaluation.benchmark.node import time_node
from ca_ros.evaluation.benchmark.peers import BASELINE, Contender, baseline, method, peers
from ca_ros.evaluation.benchmark.plan import FULL, QUICK, Plan
from ca_ros.evaluation.benchmark.promises import promises
from ca_ros.evaluation.cases import Case, command, natural, parser, positive
from ca_ros.evaluation.environment import THREADS, environment, load_average, stolen
from ca_ros.evaluation.judge import AnswerError
from ca_ros.evaluation.paper import of_the_paper
from ca_ros.flight.controller import Gains
from ca_ros.flight.plots import save
from ca_ros.problem.admissible_set import AdmissibleSet


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit code, 128 and more after a signal."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    if argv is None and any(os.environ.get(name) != '1' for name in THREADS):
        # NumPy's libraries read these variables when they are loaded, which has happened.
        environ = {**os.environ, **dict.fromkeys(THREADS, '1')}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environ)
    received: list[int] = []

    def interrupt(number: int, _: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    # Shells start background processes with SIGINT ignored.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        return _measure(options)
    except KeyboardInterrupt:
        print('benchmark: interrupted; nothing is written', file=sys.stderr)
        return 128 + received[0]


def _measure(options: argparse.Namespace) -> int:
    try:
        case = Case.load(options.vehicle, options.param)
        methods = list(case.allocators(options.methods))
        options.out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    plan = QUICK if options.quick else FULL
    if options.samples:
        plan = replace(plan, wrenches=options.samples, flight=options.samples)
    # Errors in a method of the user's own are shown with their traceback.
    try:
        found = run(case, methods, plan, options)
        out = options.out / 'benchmark'
        text = json.dumps(found, indent=2) + '\n'
        out.with_suffix('.json').write_text(text, encoding='utf-8')
        out.with_suffix('.md').write_text(document(found), encoding='utf-8')
        save(draw(found), out, options.figures)
    except (AnswerError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    print(summary(found))
    print(f'written: benchmark.json, .md and plot in {options.out}')
    if 'error' in found['node']:
        print(f'benchmark: the nodes: {found["node"]["error"]}', file=sys.stderr)
        return 1
    return 0


def run(
    case: Case, methods: Sequence[str], plan: Plan, options: argparse.Namespace
) -> dict[str, Any]:
    """Measure everything; return what benchmark.json holds."""
    start, stolen_before, surroundings = time.perf_counter(), stolen() or 0.0, environment()
    admissible = AdmissibleSet(case.vehicle)
    problem = admissible.problem
    gains = Gains.from_parameters(case.parameters)
    chance = np.random.default_rng(options.seed)
    wrenches = {
        'uniform': admissible.sample(chance, plan.wrenches),
        'boundary': loads.boundary(admissible, chance, plan.wrenches),
        'flight': loads.flight(case.vehicle, gains, plan.flight),
    }
    others, absent = peers(problem)
    contenders: dict[str, Contender] = {
        BASELINE: baseline(problem),
        **{name: method(partial(case.allocator, name)) for name in methods},
        **others,
    }
    calls = {
        load: time_calls(problem, contenders, own, plan, options.seed)
        for load, own in wrenches.items()
    }
    rival = fastest_correct_peer(contenders, calls)
    # With other numbers of rotors it is the paper's vehicle, and the promises are for that one.
    paper = of_the_paper(case.parameters)
    growth = time_growth(plan, rival, options.seed) if paper else {}
    allocators = {name: case.allocator(name) for name in dict.fromkeys(['exact', *methods])}
    batch = time_batches(admissible, allocators, contenders.get(rival or ''), plan, options.seed)
    exact = case.allocator('exact')
    loop = time_flights(exact, gains, wrenches['flight'], plan, options.seed)
    node: dict[str, Any] = {'absent': 'left out by --no-nodes'}
    if not options.no_nodes:
        node = time_node(case.name, options.quick)
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
            'baseline': BASELINE,
        },
        'environment': {
            **surroundings,
            'load_average_after': load_average(),
            'stolen': stolen(since=stolen_before),
        },
        'loads': {
            load: {
                'about': about,
                'wrenches': len(wrenches[load]),
                'saturated': _saturated(exact, wrenches[load]),
            }
            for load, about in loads.LOADS.items()
        },
        'contenders': {
            name: {'kind': contender.kind, **contender.about}
            for name, contender in contenders.items()
        },
        'absent': absent,
        'calls': calls,
        'rival': rival,
        'growth': growth,
        'batch': batch,
        'closed_loop': loop,
        'node': node,
        'wall_time': time.perf_counter() - start,
    }
    found['promises'] = promises(found) if paper else []
    return found


def _saturated(exact: Allocator, wrenches: Array) -> float:
    """Return the share of wrenches at which a rotor is at a bound."""
    return float((exact.allocate_batch(wrenches).saturation != 0).any(axis=1).mean())


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'benchmark',
        'Time the methods beside the clipped pseudo-inverse and the solvers that are installed '
        '(pip install ca_ros[peers]): benchmark.json, benchmark.md and a plot.',
    )
    made.add_argument(
        '--samples',
        type=partial(positive, int),
        metavar='N',
        help=f'wrenches of each load; by default {FULL.wrenches}, with --quick {QUICK.wrenches} '
        f'and {QUICK.flight} of the flight',
    )
    made.add_argument('--seed', type=natural, default=0, help='of wrenches and order')
    made.add_argument('--quick', action='store_true', help='everything, less of it, in a minute')
    made.add_argument('--no-nodes', action='store_true', help='leave the ROS nodes out')
    return made.parse_args(split(argv)[0])


if __name__ == '__main__':
    raise SystemExit(main())
