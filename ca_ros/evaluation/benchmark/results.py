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
    found = []
    for key, own in rows.groupby(KEY, sort=False):
        worst = own[ERRORS].max()
        row = {**Key(*key)._asdict(), **_spread('time', own['time'])}
        row |= {**_spread('ratio', own['ratio']), **own[list(PERCENTILES)].median()}
        found.append({**row, 'slowest': own['worst'].max(), **worst, 'faults': faults(worst)})
    return pd.DataFrame(found)


def fastest(results: pd.DataFrame, load: str, names: Sequence[str]) -> str | None:
    """Return the fastest of some contenders without a wrong answer on a load, None if none is."""
    own = results[(results['load'] == load) & (results['faults'] == '')].set_index('contender')
    times = own.loc[own.index.intersection(names), 'time']
    return None if times.empty else str(times.idxmin())


def ratio(rows: pd.DataFrame, one: Key, other: Key) -> float | None:
    """Return the median ratio of times within a repetition; None if one was not measured."""
    times = [
        rows[(rows[KEY] == list(key)).all(axis=1)].set_index('repetition')['time']
        for key in (one, other)
    ]
    ratios = (times[0] / times[1]).dropna()
    return float(ratios.median()) if len(ratios) else None


def _spread(name: str, values: pd.Series) -> dict[str, Any]:
    quartiles = zip(('_low', '', '_high'), values.quantile([0.25, 0.5, 0.75]), strict=True)
    return {f'{name}{part}': value for part, value in quartiles}


def records(table: pd.DataFrame) -> Any:
    """Return the rows of a table as JSON can hold them, with None for NaN."""
    return table.astype(object).where(table.notna(), None).to_dict('records')
