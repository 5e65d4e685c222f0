"""The results of a benchmark: from rows, one per contender and repetition, to metrics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.contenders import BASELINE
from ca_ros.evaluation.benchmark.timing import PERCENTILES, Key
from ca_ros.evaluation.judge import faults

KEY = list(Key._fields)
ERRORS = ['error', 'violation', 'norm_excess', 'failures', 'attainable']
QUARTILES = {'_low': 0.25, '': 0.5, '_high': 0.75}


def summarize(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the metrics of rows from `measure` and `rounds`, one row per `Key`.

    The columns are the median over repetitions and the ends of the interquartile range of the time
    (``time``, ``time_low``, ``time_high``) and of the time in units of the baseline's (``ratio``
    and so on), the medians of the `PERCENTILES`, the ``slowest`` of all calls, the largest errors,
    and ``faults``.
    """
    groups = [name for name in (*KEY, 'repetition') if name != 'contender']
    unit = rows[rows['contender'] == BASELINE].set_index(groups)['time'].rename('unit')
    rows = rows.join(unit, on=groups)
    rows['ratio'] = rows['time'] / rows['unit']
    own = rows.groupby(KEY, sort=False)
    columns = {
        f'{name}{end}': own[name].quantile(share)
        for name in ('time', 'ratio')
        for end, share in QUARTILES.items()
    }
    columns |= {name: own[name].median() for name in PERCENTILES}
    columns |= {'slowest': own['worst'].max(), **{name: own[name].max() for name in ERRORS}}
    found = pd.DataFrame(columns).reset_index()
    return found.assign(faults=[faults(each) for each in found.to_dict('records')])


def fastest(results: pd.DataFrame, load: str, names: Sequence[str]) -> str | None:
    """Return the fastest of some contenders without a wrong answer on a load, None if none is."""
    own = results[(results['load'] == load) & (results['faults'] == '')].set_index('contender')
    times = own.loc[own.index.intersection(names), 'time']
    return None if times.empty else str(times.idxmin())


def ratio(rows: pd.DataFrame, one: Key, other: Key) -> float | None:
    """Return the median ratio of times within a repetition; None if one was not measured."""
    times = rows.pivot_table('time', 'repetition', KEY)
    if one not in times or other not in times:
        return None
    return float((times[one] / times[other]).median())


def records(table: pd.DataFrame) -> Any:
    """Return the rows of a table as JSON can hold them, with None for NaN."""
    return table.astype(object).where(table.notna(), None).to_dict('records')
