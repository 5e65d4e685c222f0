"""The tables of the static study: the paper's Table 1 and ours side by side, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, sqrt
from typing import Any

from ca_ros.evaluation import paper
from ca_ros.evaluation.paper import ROWS
from ca_ros.evaluation.tables import table as markdown_table

Metrics = Mapping[str, Any]

ERRORS = ('force_error', 'torque_error')

SAMPLING = {
    'volume': 'drawn uniformly by volume in the admissible set',
    'thrusts': 'given by thrusts that are drawn uniformly in their bounds',
    'boundary': 'drawn by volume and pushed out to the boundary of the admissible set',
}


def table(found: Metrics) -> str:
    """Return the table of a study as in static.json: Markdown, the paper's rows below ours."""
    rows = []
    for name, ours in found['methods'].items():
        pairs = [(ours[key]['mean'], ours[key]['max']) for key in (*ERRORS, 'time')]
        count = _count(ours['violations'], found['samples'])
        rows.append((f'`{name}`', count, *map(_pair, pairs)))
        if paper.applies(found) and name in ROWS:
            row = ROWS[name]
            pairs = [row.force_error, row.torque_error, row.time]
            count = _count(row.violations, paper.SAMPLES)
            rows.append((f'paper: {row.name}', count, *map(_pair, pairs)))
    titles = (
        'method',
        'violations',
        'force error [N], mean / max',
        'torque error [N m], mean / max',
        'time [s], mean / max',
    )
    return markdown_table(titles, rows)


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
    versions = ', '.join(f'{name} {number}' for name, number in found['versions'].items())
    parts = [
        '# Static study',
        f'{samples} wrenches{cut}, {SAMPLING[found["sampling"]]} of `{found["vehicle"]}`, '
        f'seed {found["seed"]}.',
        table(found),
        'Violations are counted before saturation, with their standard error; errors are after '
        f'it. {timing}',
        '## Further metrics',
        _more(found),
    ]
    if paper.applies(found):
        parts += [
            '## Where they differ from the paper, and why',
            '\n'.join(_differences(found)),
            'What the paper leaves open, and what was tried: docs/reproduction.md.',
        ]
    parts += [
        '## Made with',
        '- {processor}, {cores} cores, {system}\n'.format(**found['machine']) + f'- {versions}',
    ]
    return '\n\n'.join(parts) + '\n'


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
    titles = ('method', 'median time [s]', '99th percentile [s]', 'greatest violation [N]')
    return markdown_table((*titles, 'status'), rows)


def _differences(found: Metrics) -> list[str]:
    """Return how the rows of the paper's methods differ from the paper's, an item each."""
    known = {name: ours for name, ours in found['methods'].items() if name in ROWS}
    lines = []
    for name, ours in known.items():
        compared = [_compare_counts(ours['violations'], found['samples'], ROWS[name].violations)]
        for key in ERRORS:
            mean, greatest = map(_compare, ours[key].values(), getattr(ROWS[name], key))
            compared.append(f'{key.replace("_", " ")} {mean} on average, {greatest} at most')
        lines.append(f'- `{name}`: {"; ".join(compared)}. {paper.why(found, name)}')
    if found['samples'] > paper.SAMPLES:
        lines.append(
            f'- The greatest of {found["samples"]} errors is greater than that of '
            f'{paper.SAMPLES}, as in the paper.'
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


def _pair(mean_max: tuple[float, float]) -> str:
    return '{:.1e} / {:.1e}'.format(*mean_max)


def _count(hits: int, samples: int) -> str:
    error = standard_error(hits, samples)
    return f'{hits} ± {error:.0f} of {samples}' if hits else f'0 of {samples}'
