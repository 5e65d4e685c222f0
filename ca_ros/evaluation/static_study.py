"""The static study: the methods on random wrenches of the admissible set, as in Table 1."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from ca_ros.allocation import Allocator
from ca_ros.arguments import split
from ca_ros.evaluation.cases import Case, command, interrupts, natural, parser, positive
from ca_ros.evaluation.environment import machine, versions
from ca_ros.evaluation.judge import AnswerError, evaluate
from ca_ros.evaluation.sampling import SAMPLINGS, samples
from ca_ros.evaluation.static_plots import draw
from ca_ros.evaluation.static_tables import document, standard_error, table
from ca_ros.problem.admissible_set import AdmissibleSet

SINGLE_MAX = 10_000
"""Up to so many samples each call is timed; of more, each batch."""

CHUNK, BATCH = 100, 10_000
"""Samples between two looks for an interrupt, allocated one by one or in a batch."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    try:
        case = Case.load(options.vehicle, options.param)
        allocators = case.allocators(options.methods)
        options.out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        print(f'static_study: {error}', file=sys.stderr)
        return 1
    with interrupts() as stop:
        # Errors in a method of the user's own are shown with their traceback.
        try:
            rows = run(case, allocators, options.samples, options.seed, options.sampling, stop)
            done = len(rows) // len(allocators)
            if done:
                found = summarize(case, rows, options)
                _write(case, allocators, rows, found, options)
        except (AnswerError, OSError) as error:
            print(f'static_study: {error}', file=sys.stderr)
            return 1
    if done:
        print(table(found))
        print(f'written: static.csv, .json, .md and plots in {options.out}')
    if done < options.samples:
        print(
            f'static_study: interrupted after {done} of {options.samples} samples'
            + (', which are written' if done else ''),
            file=sys.stderr,
        )
        return 128 + stop[0]
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'static_study',
        'Allocate random wrenches of the admissible set by each method: static.csv, static.json, '
        'static.md and plots.',
    )
    made.add_argument(
        '--samples',
        type=partial(positive, int),
        default=1000,
        metavar='N',
        help=f'number of wrenches; of more than {SINGLE_MAX}, batches are timed, not calls',
    )
    made.add_argument('--seed', type=natural, default=0, help='same seed, same wrenches')
    made.add_argument(
        '--sampling',
        choices=SAMPLINGS,
        default='volume',
        help='volume: uniform in the admissible set; thrusts: uniform in the bounds of the '
        'thrusts; boundary: pushed out to the boundary of the set',
    )
    return made.parse_args(split(argv)[0])


def run(
    case: Case,
    allocators: Mapping[str, Allocator],
    total: int,
    seed: int,
    sampling: str,
    stop: Sequence[int] = (),
) -> pd.DataFrame:
    """Allocate random wrenches by all methods.

    Parameters
    ----------
    case : Case
    allocators : mapping of str to Allocator
    total, seed : int
        Number of wrenches, and what they are drawn from.
    sampling : str
        A name in `SAMPLINGS`.
    stop : sequence
        Not empty once the study is to end.

    Returns
    -------
    DataFrame
        A row a sample and method, as of `evaluate`; all methods of one sample, then of the next.
    """
    admissible = AdmissibleSet(case.vehicle)
    batch = total > SINGLE_MAX
    if not batch:
        # The first call of a method sets up its caches and is not timed.
        for allocator in allocators.values():
            allocator.allocate(samples(admissible, sampling, seed, 0, 1)[0])
    parts = []
    with tqdm(total=total, unit=' samples', disable=not sys.stderr.isatty()) as bar:
        for first in range(0, total, BATCH if batch else CHUNK):
            if stop:
                break
            end = min(first + (BATCH if batch else CHUNK), total)
            demands = samples(admissible, sampling, seed, first, end)
            part = pd.concat(
                evaluate(name, allocator, admissible.problem, demands, batch)
                for name, allocator in allocators.items()
            )
            part.insert(0, 'sample', part.index + first)
            parts.append(part.sort_values('sample', kind='stable'))
            bar.update(end - first)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def summarize(case: Case, rows: pd.DataFrame, options: argparse.Namespace) -> dict[str, Any]:
    """Return what static.json holds."""
    methods = rows.groupby('method', sort=False)
    return {
        'samples': len(rows) // len(methods),
        'requested': options.samples,
        'seed': options.seed,
        'sampling': options.sampling,
        'timing': f'batches of {BATCH}' if options.samples > SINGLE_MAX else 'single calls',
        'command': command('static_study', options),
        'vehicle': case.name,
        'changes': case.changes,
        'parameters': case.parameters,
        'methods': {name: _metrics(own) for name, own in methods},
        'versions': versions(),
        'machine': machine(),
    }


def _metrics(own: pd.DataFrame) -> dict[str, Any]:
    """Return the metrics of one method's rows."""
    violations, worst = int(own['violated'].sum()), float(own['violation'].max())
    time, status = own['time'].to_numpy(), own['status'].value_counts()
    return {
        'violations': violations,
        'violations_standard_error': standard_error(violations, len(own)),
        # None for a method that had no thrusts at all to saturate.
        'violation_max': worst if isfinite(worst) else None,
        'force_error': _mean_max(own['force_error'].to_numpy()),
        'torque_error': _mean_max(own['torque_error'].to_numpy()),
        'time': {
            **_mean_max(time),
            'median': float(np.median(time)),
            'p99': float(np.percentile(time, 99)),
        },
        'status': {name: int(count) for name, count in sorted(status.items()) if count},
    }


def _mean_max(values: Any) -> dict[str, float]:
    # In pieces as they were allocated: another order of the sum has another last digit.
    size = CHUNK if len(values) <= SINGLE_MAX else BATCH
    total = sum(float(values[i : i + size].sum()) for i in range(0, len(values), size))
    return {'mean': total / len(values), 'max': float(values.max())}


def _write(
    case: Case,
    allocators: Mapping[str, Allocator],
    rows: pd.DataFrame,
    found: Mapping[str, Any],
    options: argparse.Namespace,
) -> None:
    """Write all files."""
    out = options.out
    rows.drop(columns='violation').to_csv(out / 'static.csv', index=False, lineterminator='\n')
    (out / 'static.json').write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    (out / 'static.md').write_text(document(found), encoding='utf-8')
    draw(out, AdmissibleSet(case.vehicle), allocators, rows, found['timing'], options.figures)


if __name__ == '__main__':
    raise SystemExit(main())
