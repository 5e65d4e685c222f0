"""The static study: the methods on random wrenches of the admissible set, as in Table 1."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import Allocator
from ca_ros.arguments import natural, positive, split
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.studies.cases import Case
from ca_ros.studies.engine import add_options, chunk_size, compute
from ca_ros.studies.errors import ERRORS, columns
from ca_ros.studies.result_files import facts, write
from ca_ros.studies.static.chunks import StaticChunks, Summary, merged
from ca_ros.studies.static.plots import draw
from ca_ros.studies.static.tables import document, standard_error
from ca_ros.studies.study_cli import case_of, parser, run_command, run_function
from ca_ros.studies.wrench_metrics import energies, metrics
from ca_ros.studies.wrench_sets import SAMPLINGS

SINGLE_MAX = 10_000  # up to this number of samples each call is timed; of more samples, each batch

CHUNK, BATCH = 100, 10_000  # samples that a method allocates in turn: one by one, in a batch
KEPT = 10_000  # the first samples, for the plots and the metrics of `wrench_metrics`


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    return run_command('static_study', _study, options)


def static_study(**options: Any) -> pd.DataFrame:
    """Do the study; return a row for each wrench and method, as in static.csv.

    Parameters
    ----------
    **options
        Those of the command: ``vehicle='x8', methods='exact,direct', samples=200``.  With `out`,
        a folder, its files are written, too.

    Raises
    ------
    ValueError, CaRosError
        If an option is wrong.

    Examples
    --------
    >>> rows = static_study(methods='exact,pseudo_inverse', samples=200)
    >>> rows.groupby('method')['force_error'].max().round(2).to_dict()
    {'exact': 0.0, 'pseudo_inverse': 1.12}
    """
    return run_function(_parse, _study, options)


def _study(options: argparse.Namespace) -> tuple[pd.DataFrame, str]:
    """Do the study and write its files; return the rows, and what is printed."""
    case, allocators = case_of(options)
    options.out.mkdir(parents=True, exist_ok=True)
    batch = options.samples > SINGLE_MAX
    if not batch:
        # Calls that are timed run alone.
        options.workers = options.workers or 1
    step = BATCH if batch else CHUNK
    size, rows = chunk_size(options.samples, step), options.rows or KEPT
    drawn = options.sampling, options.seed, options.samples
    task = StaticChunks(case, list(allocators), *drawn, size, step, batch, rows)
    count = -(-options.samples // size)
    parts = compute(task, count, options, unit=' samples', unit_scale=size)
    frame, text = _write(case, allocators, parts, options)
    written = f'written: static.csv, .json, .md and plots in {options.out}'
    return frame, text.partition('\n## ')[0] + '\n' + written


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'static_study',
        'Allocate random wrenches of the admissible set by each method: static.csv, static.json, '
        'static.md and plots.',
    )
    made.add_argument('--samples', type=positive(int), default=1000, metavar='N',
        help=f'number of wrenches; of more than {SINGLE_MAX}, batches are timed, not calls')
    made.add_argument('--seed', type=natural, default=0, help='same seed, same wrenches')
    made.add_argument('--sampling', choices=SAMPLINGS, default='volume',
        help='volume: uniform in the admissible set; thrusts: uniform in the bounds of the '
        'thrusts; boundary: projected onto the boundary of the set; outside: beyond it, up to as '
        'much again')
    made.add_argument('--rows', type=positive(int), metavar='N',
        help=f'samples whose rows are in static.csv, the first ones (default: {KEPT}, the least)')
    add_options(made)
    options = made.parse_args(split(argv)[0])
    if options.rows is not None and options.rows < KEPT:
        made.error(f'--rows {options.rows}: plots and metrics need at least {KEPT}')
    return options


def _write(
    case: Case, allocators: Mapping[str, Allocator],
    parts: Sequence[tuple[list[pd.DataFrame], dict[str, Summary]]], options: argparse.Namespace,
) -> tuple[pd.DataFrame, str]:
    """Write all files; return the rows of static.csv, and static.md."""
    rows = pd.concat([rows for kept, _ in parts for rows in kept], ignore_index=True)
    methods = {name: merged([own[name] for _, own in parts]) for name in allocators}
    samples = options.samples
    found = {
        'samples': samples,
        'rows': len(rows) // len(methods),
        'judged': min(samples, KEPT),
        'seed': options.seed,
        'sampling': options.sampling,
        'timing': f'batches of {BATCH}' if options.samples > SINGLE_MAX else 'single calls',
        **facts(case, 'static_study', options),
        'methods': {
            name: _metrics(own, samples, rows[rows['method'] == name][:KEPT], case)
            for name, own in methods.items()
        },
        'left_out': case.left_out,
    }
    text = document(found)
    kept = rows.drop(columns='violation')
    write(options.out / 'static', kept, found, text)
    times = {name: own['time'] for name, own in methods.items()}
    if options.figures:
        style = options.figures, options.figure_width
        admissible = AdmissibleSet(case.problem)
        draw(options.out, admissible, allocators, rows, times, found['timing'], *style)
    return kept, text


def _metrics(own: Summary, samples: int, rows: pd.DataFrame, case: Case) -> dict[str, Any]:
    """Return the metrics of a method from its summary and its first rows."""
    violations, worst, time = own['violations'], own['violation_max'], np.array(own['time'])
    problem = case.problem
    demands = rows[columns(problem)].to_numpy()
    thrusts = rows.filter(regex=r'^f_\d+$').to_numpy()
    return {
        'violations': violations,
        'violations_standard_error': standard_error(violations, samples),
        # None for a method that had no thrusts to saturate.
        'violation_max': worst if isfinite(worst) else None,
        **{
            name: {'mean': own[name]['sum'] / samples, 'max': own[name]['max']} for name in ERRORS
            if name in own
        },
        'time': {
            'mean': float(time.mean()), 'max': float(time.max()), 'median': float(np.median(time)),
            'p99': float(np.percentile(time, 99)),
        },
        'status': own['status'],
        **metrics(problem, demands, thrusts),
        **(energies(problem, demands, thrusts) if case.flies else {}),
    }
