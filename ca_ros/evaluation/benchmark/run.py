"""A run of the benchmark, from the vehicle to the figures."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.batches import time_batches
from ca_ros.evaluation.benchmark.calls import fastest_correct_peer, time_calls
from ca_ros.evaluation.benchmark.closed_loop_time import time_flights
from ca_ros.evaluation.benchmark.contenders import BASELINE, Contender, baseline, method, peers
from ca_ros.evaluation.benchmark.environment import environment, load_average, stolen
from ca_ros.evaluation.benchmark.growth import grow
from ca_ros.evaluation.benchmark.node import time_node
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.promises import promises
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.paper_table import of_the_paper
from ca_ros.flight.controller import Gains
from ca_ros.problem.admissible_set import AdmissibleSet


def run(
    case: Case, methods: list[str], plan: Plan, seed: int, quick: bool, nodes: bool
) -> dict[str, Any]:
    """Measure everything; return what benchmark.json holds.

    Parameters
    ----------
    case : Case
    methods : list of str
        Names, or ``module:Class``.
    plan : Plan
    seed : int
        Of wrenches and of the order of the contenders.
    quick : bool
        Whether the plan is the quick one.
    nodes : bool
        Whether the nodes are measured too.
    """
    start, stolen_before, surroundings = time.perf_counter(), stolen() or 0.0, environment()
    admissible = AdmissibleSet(case.vehicle)
    problem = admissible.problem
    gains = Gains.from_parameters(case.parameters)
    chance = np.random.default_rng(seed)
    wrenches = {
        'uniform': loads.uniform(admissible, chance, plan.wrenches),
        'boundary': loads.boundary(admissible, chance, plan.wrenches),
        'flight': loads.flight(case.vehicle, gains, plan.flight),
    }
    others, absent = peers(problem)
    contenders: dict[str, Contender] = {
        BASELINE: baseline(problem),
        **{name: method(partial(case.allocator, name)) for name in methods},
        **others,
    }
    calls = {}
    for load, own in wrenches.items():
        with _progress(f'calls, {load}', plan.repetitions) as update:
            calls[load] = time_calls(problem, contenders, own, plan, seed, update)
    rival = fastest_correct_peer(contenders, calls)
    # With other numbers of rotors it is the paper's vehicle, and the promises are for that one.
    paper = of_the_paper(case.parameters)
    growth = {}
    if paper:
        with _progress('rotors', 2 * plan.repetitions) as update:
            growth = grow(plan, rival, seed, update)
    with _progress('batches', plan.rounds) as update:
        allocators = {name: case.allocator(name) for name in dict.fromkeys(['exact', *methods])}
        batch = time_batches(
            admissible, allocators, contenders.get(rival or ''), plan, seed, update
        )
    with _progress('closed loop', plan.rounds) as update:
        exact = case.allocator('exact')
        loop = time_flights(exact, gains, wrenches['flight'], plan, seed, update)
    with _progress('nodes', 1):
        node = time_node(case.name, quick) if nodes else {'absent': 'left out by --no-nodes'}
    figures: dict[str, Any] = {
        'settings': {
            'vehicle': case.name,
            'changes': case.changes,
            'parameters': case.parameters,
            'methods': methods,
            'seed': seed,
            'quick': quick,
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
                'saturated': _saturated(exact.allocate_batch(wrenches[load]).saturation),
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
    figures['promises'] = [promise.figures() for promise in promises(figures) if paper]
    return figures


def _saturated(saturation: Any) -> float:
    """Return the share of wrenches at which a rotor is at a bound."""
    return float((saturation != 0).any(axis=1).mean())


@contextmanager
def _progress(what: str, repetitions: int) -> Iterator[Callable[[], Any]]:
    with tqdm(total=repetitions, desc=what, disable=not sys.stderr.isatty()) as bar:
        yield bar.update
