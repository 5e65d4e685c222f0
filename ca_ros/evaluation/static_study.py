"""The static study: the methods on random wrenches of the admissible set, as in Table 1."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from ca_ros.allocation import AllocationProblem, Allocator
from ca_ros.arguments import split
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.environment import machine, versions
from ca_ros.evaluation.judge import ERRORS, columns, evaluate
from ca_ros.evaluation.options import command, concluded, natural, parser, positive, write
from ca_ros.evaluation.sampling import SAMPLINGS, samples
from ca_ros.evaluation.static_plots import draw
from ca_ros.evaluation.static_tables import document, standard_error
from ca_ros.evaluation.wrench_metrics import metrics
from ca_ros.problem.admissible_set import AdmissibleSet

SINGLE_MAX = 10_000
"""Up to this number of samples each call is timed; of more samples, each batch."""

CHUNK, BATCH = 100, 10_000
"""Number of samples that each method allocates in turn, one by one or in a batch."""

JUDGED = 10_000
"""Number of samples, the first ones, from which the metrics of `wrench_metrics` are computed."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    return concluded('static_study', partial(_study, options))


def _study(options: argparse.Namespace) -> None:
    """Do the study, write its files and print the table; after Ctrl-C with what is done."""
    case, allocators = Case.of(options)
    rows = run(case, allocators, options)
    done = len(rows) // len(allocators)
    if done:
        text = _write(case, allocators, rows, options)
        print(text.partition('\n## ')[0])
        print(f'written: static.csv, .json, .md and plots in {options.out}')
    if done < options.samples:
        written = ', which are written' if done else ''
        raise KeyboardInterrupt(f' after {done} of {options.samples} samples{written}')


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'static_study',
        'Allocate random wrenches of the admissible set by each method: static.csv, static.json, '
        'static.md and plots.',
    )
    count = f'number of wrenches; of more than {SINGLE_MAX}, batches are timed, not calls'
    made.add_argument('--samples', type=positive(int), default=1000, metavar='N', help=count)
    made.add_argument('--seed', type=natural, default=0, help='same seed, same wrenches')
    made.add_argument(
        '--sampling',
        choices=SAMPLINGS,
        default='volume',
        help='volume: uniform in the admissible set; thrusts: uniform in the bounds of the '
        'thrusts; boundary: projected onto the boundary of the set; outside: beyond it, by up to '
        'as much again',
    )
    return made.parse_args(split(argv)[0])


def run(
    case: Case, allocators: Mapping[str, Allocator], options: argparse.Namespace
) -> pd.DataFrame:
    """Allocate random wrenches by all methods, until all are done or Ctrl-C.

    Returns
    -------
    DataFrame
        One row per sample and method, with the columns of `evaluate`; sorted by sample.
    """
    admissible, total = AdmissibleSet(case.problem), options.samples
    batch, drawn = total > SINGLE_MAX, (options.sampling, options.seed)
    size = BATCH if batch else CHUNK
    parts = []
    # Without a terminal no bar is shown.
    bar = tqdm(range(0, total, size), unit=' samples', unit_scale=size, disable=None)
    try:
        # The first call of a method fills its caches and is not timed.
        for allocator in () if batch else allocators.values():
            allocator.allocate(samples(admissible, *drawn, 0, 1)[0])
        for first in bar:
            end = min(first + size, total)
            demands = samples(admissible, *drawn, first, end)
            part = pd.concat(
                evaluate(name, allocator, admissible.problem, demands, batch)
                for name, allocator in allocators.items()
            )
            part.insert(0, 'sample', part.index + first)
            parts.append(part.sort_values('sample', kind='stable'))
    except KeyboardInterrupt:
        bar.close()
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def _write(
    case: Case,
    allocators: Mapping[str, Allocator],
    rows: pd.DataFrame,
    options: argparse.Namespace,
) -> str:
    """Write all files; return static.md."""
    out, methods = options.out, rows.groupby('method', sort=False)
    found = {
        'samples': len(rows) // len(methods),
        'requested': options.samples,
        'seed': options.seed,
        'sampling': options.sampling,
        'timing': f'batches of {BATCH}' if options.samples > SINGLE_MAX else 'single calls',
        'command': command('static_study', options),
        'vehicle': case.name,
        'changes': case.changes,
        'parameters': case.parameters,
        'methods': {name: _metrics(own, case.problem) for name, own in methods},
        'left_out': case.left_out,
        'versions': versions(),
        'machine': machine(),
    }
    text = document(found)
    write(out / 'static', rows.drop(columns='violation'), found, text)
    style = options.figures, options.figure_width
    draw(out, AdmissibleSet(case.problem), allocators, rows, found['timing'], *style)
    return text


def _metrics(own: pd.DataFrame, problem: AllocationProblem) -> dict[str, Any]:
    """Return the metrics of one method's rows."""
    demands = own[columns(problem)].to_numpy()
    thrusts = own.filter(regex=r'^f_\d+$').to_numpy()
    violations, worst = int(own['violated'].sum()), float(own['violation'].max())
    time, status = own['time'], own['status'].value_counts()
    return {
        'violations': violations,
        'violations_standard_error': standard_error(violations, len(own)),
        # None for a method that had no thrusts to saturate.
        'violation_max': worst if isfinite(worst) else None,
        **{name: _mean_max(own[name].to_numpy()) for name in ERRORS if name in own},
        'time': {
            **_mean_max(time.to_numpy()),
            'median': float(time.median()),
            'p99': float(np.percentile(time, 99)),
        },
        'status': {name: int(count) for name, count in sorted(status.items()) if count},
        **metrics(problem, demands[:JUDGED], thrusts[:JUDGED]),
    }


def _mean_max(values: Any) -> dict[str, float]:
    # Sum in the chunks of `run`: another order of summation would change the last digit.
    size = CHUNK if len(values) <= SINGLE_MAX else BATCH
    total = sum(float(values[i : i + size].sum()) for i in range(0, len(values), size))
    return {'mean': total / len(values), 'max': float(values.max())}


if __name__ == '__main__':
    raise SystemExit(main())
