"""The tables of static.md: the paper's Table 1 beside ours, and the differences."""

from collections.abc import Iterator, Mapping
from math import hypot, sqrt
from typing import Any

from ca_ros.studies import paper
from ca_ros.studies.errors import ERRORS
from ca_ros.studies.paper import ROWS
from ca_ros.studies.tables import render, table
from ca_ros.studies.wrench_metrics import cells
from ca_ros.studies.wrench_sets import SAMPLINGS

Metrics = Mapping[str, Any]

UNITS = {'force_error': ' N', 'torque_error': ' N m', 'error': ''}


def document(found: Metrics) -> str:
    """Return static.md for a study as in static.json."""
    return render(
        'static.md', **found, about=SAMPLINGS[found['sampling']],
        table=table(_titles(found), _rows(found)), beyond=beyond(found['methods']),
        observations=[] if paper.applies(found) else list(_observations(found)),
        differences=_differences(found) if paper.applies(found) else [],
    )


def beyond(methods: Mapping[str, Metrics]) -> str:
    """Return the table of `wrench_metrics` by method."""
    rows = {f'`{name}`': cells(own) for name, own in methods.items()}
    titles = next(iter(rows.values()))
    return table(('method', *titles), [[name, *own.values()] for name, own in rows.items()])


def _errors(found: Metrics) -> list[str]:
    """Return the errors of a study: those of a vehicle, or of a problem without a vehicle."""
    first = next(iter(found['methods'].values()))
    return [name for name in ERRORS if name in first]


def _titles(found: Metrics) -> list[str]:
    errors = [f'{ERRORS[name]}, mean / max' for name in _errors(found)]
    return ['method', 'violations', *errors, 'time [s], mean / max']


def _observations(found: Metrics) -> Iterator[str]:
    """Yield a sentence about each method, for studies that are not the paper's."""
    for name, own in found['methods'].items():
        worst = ', '.join(f'{own[key]["max"]:.1e}{UNITS[key]}' for key in _errors(found))
        exact = own['status'].get('EXACT', 0)
        yield f'`{name}` produces {exact} of {found["samples"]} wrenches; largest error {worst}.'


def _rows(found: Metrics) -> list[list[str]]:
    """Return the rows of the methods; the paper's rows are below ours."""
    rows = []
    for name, ours in found['methods'].items():
        pairs = [(ours[key]['mean'], ours[key]['max']) for key in (*_errors(found), 'time')]
        rows.append(_row(f'`{name}`', ours['violations'], found['samples'], pairs))
        if paper.applies(found) and name in ROWS:
            row = ROWS[name]
            pairs = [row.force_error, row.torque_error, row.time]
            rows.append(_row(f'paper: {row.name}', row.violations, paper.SAMPLES, pairs))
    return rows


def _row(name: str, hits: int, samples: int, pairs: list[tuple[float, float]]) -> list[str]:
    error = f' ± {standard_error(hits, samples):.0f}' if hits else ''
    return [name, f'{hits}{error} of {samples}', *(f'{a:.1e} / {b:.1e}' for a, b in pairs)]


def _differences(found: Metrics) -> list[str]:
    """Return how the rows of the paper's methods differ from the paper's, one item each."""
    known = {name: ours for name, ours in found['methods'].items() if name in ROWS}
    lines = []
    for name, ours in known.items():
        compared = [_compare_counts(ours['violations'], found['samples'], ROWS[name].violations)]
        for key in _errors(found):
            mean, largest = map(_compare, ours[key].values(), getattr(ROWS[name], key))
            compared.append(f'{key.replace("_", " ")} {mean} on average, {largest} at most')
        lines.append(f'`{name}`: {"; ".join(compared)}. {paper.why(found, name)}')
    if found['samples'] > paper.SAMPLES:
        lines.append(
            f'Of {found["samples"]} errors the largest exceeds that of {paper.SAMPLES}, the '
            "paper's number."
        )
    if base := known.pop('pseudo_inverse', None):
        unit = ROWS['pseudo_inverse'].time[0]
        ratios = ', '.join(
            f'`{name}` {ours["time"]["median"] / base["time"]["median"]:.2g} '
            f'(paper {ROWS[name].time[0] / unit:.0f})' for name, ours in known.items()
        )
        lines.append(
            'Times: another machine and another language, so compare ratios. In units of the '
            f"pseudo-inverse's time (our medians, the paper's means): {ratios}."
        )
    return lines


def _compare_counts(ours: int, samples: int, theirs: int) -> str:
    size = paper.SAMPLES
    if ours == theirs == 0:
        return f'no violation in both, so fewer than 1 in {samples // 3 or 1} (95 %)'
    error = hypot(standard_error(ours, samples) / samples, standard_error(theirs, size) / size)
    gap = ours / samples - theirs / size
    return (
        f'{100.0 * ours / samples:.1f} % violations, {100.0 * theirs / size:.1f} % in the paper, '
        f'{abs(gap) / error if error else float("inf"):.1f} standard errors apart'
    )


def _compare(ours: float, theirs: float) -> str:
    ratio = ours / theirs
    if 0.85 < ratio < 1.15:
        return 'as in the paper'
    if ratio > 0.01:
        return f"{ratio:.2g} times the paper's"
    return f'{1.0 / ratio if ratio else float("inf"):.0e} times smaller'


def standard_error(hits: int, samples: int) -> float:
    """Return the standard error of a count among independent samples."""
    return sqrt(hits * (1.0 - hits / samples))
