"""The limits that the package is to meet on the paper's vehicle, and whether a run met them."""

from collections.abc import Iterator

import pandas as pd

from benchmarks.contenders import BASELINE, POLICIES
from benchmarks.parts import SETS, SIDES
from benchmarks.sizes import Sizes
from benchmarks.timing import Key, ratio
from ca_ros.studies.tables import number, table

UNIT = 'over the clipped pseudo-inverse'


def limits(rows: pd.DataFrame, results: pd.DataFrame, sizes: Sizes) -> str:
    """Return the table of all limits for the rows of a run and their summary."""
    lines = []
    for what, limit, cases in _limits(rows, results, sizes):
        measured = {case: value for case, value in cases.items() if value is not None}
        worst = max(measured, key=measured.__getitem__, default=None)
        words = f'{what} (worst: {worst})' if worst and len(cases) > 1 else what
        found, verdict = 'not measured', ''
        if worst is not None:
            found = number(measured[worst])
            verdict = 'met' if measured[worst] <= limit else '**missed**'
        lines.append((words, number(limit), found, verdict))
    return table(('what', 'at most', 'measured', ''), lines)


def _limits(
    rows: pd.DataFrame, results: pd.DataFrame, sizes: Sizes
) -> Iterator[tuple[str, float, dict[str, float | None]]]:
    """Yield what is limited, the limit, and the values of some cases."""

    def over(
        other: str, *kinds: str, name: str = 'exact', part: str = 'calls', n: int = 6,
        column: str = 'time',
    ) -> dict[str, float | None]:
        """Return the time of a contender over that of another one, by kind of wrenches."""
        return {
            kind: ratio(rows, Key(part, kind, name, n), Key(part, kind, other, n), column)
            for kind in kinds
        }

    yield f'`exact` {UNIT}, on a flight', 1.0, over(BASELINE, 'flight')
    yield f'`exact` {UNIT}, uniform', 1.2, over(BASELINE, 'uniform')
    policies = {name: over(BASELINE, 'boundary', name=name) for name in ('exact', *POLICIES)}
    boundary = {name: values['boundary'] for name, values in policies.items()}
    yield f'all policies of `exact` {UNIT}, on the boundary', 1.5, boundary
    calls = results.loc['calls'].xs('exact', level='contender')
    tails = dict(zip(calls.index.get_level_values(0), calls['p99'] / calls['p50'], strict=True))
    yield '99th percentile of `exact` over its median', 3.0, tails
    yield '`exact` over reused DAQP', 0.5, over('daqp_reused', *SETS)
    yield "`exact` over DAQP's one-shot call, on a flight", 1.0, over('daqp', 'flight')
    yield '`exact` over hierarchical DAQP', 0.5, over('daqp_hierarchical', *SETS)
    yield '`exact` over OSQP', 1.0, over('osqp', *SETS)
    growth = {
        f'{n}, {kind}': over('daqp_reused', kind, part='rotors', n=n)[kind] for kind in SETS
        for n in sizes.rotors
    }
    yield '`exact` over reused DAQP, all numbers of rotors', 0.5, growth
    # A third for most wrenches; a second plane, whose code is cold, serves two in a thousand.
    for percentile, column, share in (
        ('median', 'p50', 1.0 / 3.0), ('99.9th percentile', 'p999', 0.8),
    ):
        what = f'{percentile} of `exact` in C over that of'
        for rival, words, limit, kinds in (
            ('daqp_reused', 'reused DAQP', 1.0, SIDES[:2]),
            ('daqp_hierarchical', 'hierarchical DAQP', share, SIDES[2:]),
        ):
            yield f'{what} {words}', limit, over(rival, *kinds, part='C', column=column)
    many, few = (Key('rotors', 'flight', 'exact', n) for n in (32, 6))
    yield '32 rotors over 6, `exact` on a flight', 4.0, {'': ratio(rows, many, few)}
    loop, largest = Key('batches', 'one by one', 'daqp_reused', 6), max(sizes.batches)
    for cores, limit in (('', 15.0), (', two cores', 27.0)):
        batch = Key('batches', f'{largest}{cores}', 'exact', 6)
        what = f'`exact` in a batch of {largest}{cores} over reused DAQP in a loop'
        yield what, 1.0 / limit, {'': ratio(rows, batch, loop)}
    for axes, limit in (('4 axes', 0.2), ('6 axes', 0.2)):
        key = Key('set-up', axes, 'exact', 16)
        time = 1e3 * float(results.loc[key, 'time']) if key in results.index else None
        yield f'audit and set-up of `exact`, 16 rotors, {axes} [ms]', limit, {'': time}


def node_ratio(rows: pd.DataFrame, rate: str, metric: str) -> float | None:
    """Return the median over blocks of a metric of the node over that of the echo node."""
    part = rows[(rows['part'] == 'node') & (rows['wrenches'] == rate)]
    if part.empty:
        return None
    values = part.pivot_table(metric, 'repetition', 'contender')
    return float((values['allocator'] / values['echo']).median())
