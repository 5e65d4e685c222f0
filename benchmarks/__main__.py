"""Run the benchmark: ``python -m benchmarks --out DIR`` writes results.csv, .md and .png."""

import argparse
import os
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks import parts
from benchmarks.contenders import BASELINE, CONTENDERS, POLICIES, method, set_up
from benchmarks.in_c import compiled
from benchmarks.page import page
from benchmarks.plot import draw
from benchmarks.sizes import FULL, QUICK, Sizes
from benchmarks.timing import summarize
from ca_ros.errors import CaRosError
from ca_ros.figures import save
from ca_ros.parameter_files import load
from ca_ros.settings import flat
from ca_ros.studies.cases import Case, methods_of
from ca_ros.studies.result_files import machine, versions
from ca_ros.studies.tables import listed

THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""Number of threads of linear algebra libraries."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit code."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks', description=__doc__)
    add = parser.add_argument
    add('--vehicle', default='hexarotor', help='a shipped vehicle or problem, or a YAML file')
    add('--methods', default='paper', metavar='A,B', help='as in the studies')
    add('--seed', type=int, default=0, help='of wrenches and order')
    add('--quick', action='store_true', help='measure less, in a minute')
    add('--no-nodes', action='store_true', help='leave the ROS nodes out')
    add('--out', type=Path, default=Path('out/benchmark'), metavar='DIR')
    options = parser.parse_args(argv)
    if argv is None and any(os.environ.get(name) != '1' for name in THREADS):
        # They read the variables when they are loaded, so restart.
        environ = {**os.environ, **dict.fromkeys(THREADS, '1')}
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environ)
    try:
        rows, results, text = run(options, QUICK if options.quick else FULL)
    except (CaRosError, ValueError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    options.out.mkdir(parents=True, exist_ok=True)
    rows.to_csv(options.out / 'results.csv', index=False, lineterminator='\n')
    (options.out / 'results.md').write_text(text, encoding='utf-8')
    save(draw(results), options.out / 'results', ['png'])
    print(f'{text}\nwritten: results.csv, .md and .png in {options.out}')
    return 0


def run(options: argparse.Namespace, sizes: Sizes) -> tuple[pd.DataFrame, pd.DataFrame, str]:
    """Measure everything; return rows, their summary, and the page."""
    start, load = time.perf_counter(), os.getloadavg()[0]
    methods = methods_of(options.methods)
    case = Case.load(options.vehicle, methods=methods)
    shared = sizes, options.seed
    sets = parts.drawn(case.parameters, case.problem, *shared)
    own = {name: method(partial(case.allocator, name)) for name in methods}
    contenders = {BASELINE: CONTENDERS[BASELINE], **own, **POLICIES, **CONTENDERS}
    calls, absent = set_up(contenders, case.problem)
    rows = [parts.time_calls(case.problem, calls, sets, *shared)]
    rival = 'daqp_reused' if 'daqp_reused' in calls else None
    in_c, absent_in_c, compiler = compiled(case.problem)
    if in_c:
        sided = parts.by_side(case.problem, sets, *shared)
        rows.append(parts.time_calls(case.problem, in_c, sided, *shared, 'C'))
    if paper := of_the_paper(case.parameters):
        rows += [parts.time_rotors(rival, *shared), parts.time_setups(*shared)]
        rows.append(parts.time_unattainable(*shared))
    rows.append(parts.time_batches(case, rival, calls.get(rival or ''), *shared))
    if case.flies and not options.no_nodes and find_spec('rclpy'):
        from benchmarks.latency import measure_nodes

        rows.append(measure_nodes(options.vehicle, sizes))
    table = pd.concat(rows, ignore_index=True)
    results = summarize(table[table['part'] != 'node'], BASELINE)
    peers = {name: each.about for name, each in contenders.items() if name in calls}
    facts: dict[str, Any] = {
        'vehicle': f'`{case.name}`, seed {options.seed}, {sizes}', 'machine': listed(machine()),
        'load': f'{load:.2f} before, {os.getloadavg()[0]:.2f} after, on {os.cpu_count()} cores',
        'versions': listed(versions()), 'C': compiler,
        'absent': listed({**absent, **absent_in_c}, ': ') or 'nothing',
        **{f'`{name}`': about for name, about in peers.items() if about},
        'time': f'{time.perf_counter() - start:.0f} s in all',
    }
    about = {'paper': paper, 'facts': facts}
    return table, results, page(table, results, sizes, about)


def of_the_paper(parameters: Mapping[str, Any]) -> bool:
    """Return whether parameters are those of the paper's vehicle, with any method and gains."""
    return all(
        parameters.get(name) == value for name, value in flat(load('hexarotor')).items()
        if name.startswith(('vehicle.', 'rotors.')) or name == 'allocation.axes'
    )


if __name__ == '__main__':
    raise SystemExit(main())
