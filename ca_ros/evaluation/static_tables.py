"""The tables of the static study in Markdown: the paper's Table 1 beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, sqrt
from typing import Any

from ca_ros.evaluation import paper
from ca_ros.evaluation.paper import ROWS
from ca_ros.evaluation.sampling import SAMPLINGS
from ca_ros.evaluation.tables import table as markdown_table

Metrics = Mapping[str, Any]

ERRORS = ('force_error', 'torque_error')


def table(found: Metrics) -> str:
    """Return the table of a study as in static.json; the paper's rows are below ours."""
    rows = []
    for name, ours in found['methods'].items():
        pairs = [(ours[key]['mean'], ours[key]['max']) for key in (*ERRORS, 'time')]
        rows.append(_row(f'`{name}`', ours['violations'], found['samples'], pairs))
        if paper.applies(found) and name in ROWS:
            row = ROWS[name]
            pairs = [row.force_error, row.torque_error, row.time]
            rows.append(_row(f'paper: {row.name}', row.violations, paper.SAMPLES, pairs))
    quantities = ('force error [N]', 'torque error [N m]', 'time [s]')
    titles = ('method', 'violations', *(f'{name}, mean / max' for name in quantities))
    return markdown_table(titles, rows)


def _row(name: str, hits: int, samples: int, pairs: list[tuple[float, float]]) -> list[str]:
    error = f' ± {standard_error(hits, samples):.0f}' if hits else ''
    return [name, f'{hits}{error} of {samples}', *(f'{a:.1e} / {b:.1e}' for a, b in pairs)]


def document(found: Metrics) -> str:
    """Return static.md for a study as in static.json."""
    samples, requested = found['samples'], found['requested']
    cut = f' (of {requested} asked for: the study was interrupted)' if samples < requested else ''
    timing = (
        'Times are of single calls.'
        if found['timing'] == 'single calls'
        else f'Wrenches were allocated in {found["timing"]}: a time is the share of one wrench in '
        'the time of its batch, much less than a call takes.'
    )
    parts = [
        '# Static study',
        f'{samples} wrenches{cut}, {SAMPLINGS[found["sampling"]]} of `{found["vehicle"]}`, '
        f'seed {found["seed"]}.',
        table(found),
        'Violations are counted before saturation, with their standard error; errors are after '
        f'it. {timing}',
        '## Further metrics',
        _more(found),
    ]
    if paper.applies(found):
        parts += [
            '## Differences from the paper',
            '\n'.join(_differences(found)),
            'What the paper leaves open, and what was tried: docs/reproduction.md.',
        ]
    machine = '- {processor}, {cores} cores, {system}\n'.format(**found['machine'])
    versions = ', '.join(f'{name} {number}' for name, number in found['versions'].items())
    return '\n\n'.join([*parts, '## Made with', f'{machine}- {versions}']) + '\n'


def _more(found: Metrics) -> str:
    rows = [
        (
            f'`{name}`',
            f'{ours["time"]["median"]:.2g}',
            f'{ours["time"]["p99"]:.2g}',
            'no thrusts' if ours['violation_max'] is None else f'{ours["violation_max"]:.2g}',
            ', '.join(f'{word} {count}' for word, count in ours['status'].items()),
        )
        for name, ours in found['methods'].items()
    ]
    titles = ('method', 'median time [s]', '99th percentile [s]', 'largest violation [N]')
    return markdown_table((*titles, 'status'), rows)


def _differences(found: Metrics) -> list[str]:
    """Return how the rows of the paper's methods differ from the paper's, one item each."""
    known = {name: ours for name, ours in found['methods'].items() if name in ROWS}
    lines = []
    for name, ours in known.items():
        compared = [_compare_counts(ours['violations'], found['samples'], ROWS[name].violations)]
        for key in ERRORS:
            mean, largest = map(_compare, ours[key].values(), getattr(ROWS[name], key))
            compared.append(f'{key.replace("_", " ")} {mean} on average, {largest} at most')
        lines.append(f'- `{name}`: {"; ".join(compared)}. {paper.why(found, name)}')
    if found['samples'] > paper.SAMPLES:
        lines.append(
            f'- Of {found["samples"]} errors the largest exceeds that of {paper.SAMPLES}, the '
            "paper's number."
        )
    if base := known.pop('pseudo_inverse', None):
        unit = ROWS['pseudo_inverse'].time[0]
        ratios = ', '.join(
            f'`{name}` {ours["time"]["median"] / base["time"]["median"]:.2g} '
            f'(paper {ROWS[name].time[0] / unit:.0f})'
            for name, ours in known.items()
        )
        lines.append(
            '- Times: another machine and another language, so compare ratios. In units of the '
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
