"""The file static.md: the paper's Table 1 and ours side by side."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Any

from ca_ros.evaluation import paper_table
from ca_ros.evaluation.paper_table import ROWS
from ca_ros.evaluation.summary import standard_error
from ca_ros.evaluation.tables import table as markdown_table

TITLES = (
    'method',
    'violations',
    'force error [N], mean / max',
    'torque error [N m], mean / max',
    'time [s], mean / max',
)

SAMPLING = {
    'volume': 'drawn uniformly by volume in the admissible set',
    'thrusts': 'given by thrusts that are drawn uniformly in their bounds',
    'boundary': 'drawn by volume and pushed out to the boundary of the admissible set',
}


def table(figures: Mapping[str, Any]) -> str:
    """Return the table of a study as in static.json: Markdown, the paper's rows below ours."""
    side_by_side = paper_table.applies(figures)
    rows = []
    for name, ours in figures['methods'].items():
        rows.append(
            (
                f'`{name}`',
                _count(ours['violations'], figures['samples']),
                *(_pair(*_mean_max(ours[key])) for key in ('force_error', 'torque_error', 'time')),
            )
        )
        if side_by_side and name in ROWS:
            paper = ROWS[name]
            rows.append(
                (
                    f'paper: {paper.name}',
                    _count(paper.violations, paper_table.SAMPLES),
                    _pair(*paper.force_error),
                    _pair(*paper.torque_error),
                    _pair(*paper.time),
                )
            )
    return markdown_table(TITLES, rows)


def report(figures: Mapping[str, Any]) -> str:
    """Return static.md for a study as in static.json."""
    samples, requested = figures['samples'], figures['requested']
    cut = f' (of {requested} asked for: the study was interrupted)' if samples < requested else ''
    parts = [
        '# Static study',
        f'{samples} wrenches{cut}, {SAMPLING[figures["sampling"]]} of `{figures["vehicle"]}`, '
        f'seed {figures["seed"]}.',
        table(figures),
        'Violations are counted before saturation, with their standard error; errors are after '
        'it. ' + _timing(figures),
        '## Further figures',
        _more(figures),
    ]
    if paper_table.applies(figures):
        parts += [
            '## Where they differ from the paper, and why',
            _differences(figures),
            'What the paper leaves open, and what was tried: docs/reproduction.md.',
        ]
    versions = ', '.join(f'{name} {number}' for name, number in figures['versions'].items())
    parts += [
        '## Made with',
        '\n'.join(
            [
                f'- {figures["machine"]["processor"]}, {figures["machine"]["cores"]} cores, '
                f'{figures["machine"]["system"]}',
                f'- {versions}',
            ]
        ),
    ]
    return '\n\n'.join(parts) + '\n'


def _timing(figures: Mapping[str, Any]) -> str:
    if figures['timing'] == 'single calls':
        return 'Times are of single calls.'
    return (
        f'Wrenches were allocated in {figures["timing"]}: a time is the share of one wrench in '
        'the time of its batch, much less than a call takes.'
    )


def _more(figures: Mapping[str, Any]) -> str:
    titles = (
        'method',
        'median time [s]',
        '99th percentile [s]',
        'greatest violation [N]',
        'status',
    )
    rows = []
    for name, ours in figures['methods'].items():
        worst = ours['violation_max']
        status = ', '.join(f'{word} {count}' for word, count in ours['status'].items())
        time = ours['time']
        rows.append(
            (
                f'`{name}`',
                f'{time["median"]:.2g}',
                f'{time["p99"]:.2g}',
                'no thrusts' if worst is None else f'{worst:.2g}',
                status,
            )
        )
    return markdown_table(titles, rows)


def _differences(figures: Mapping[str, Any]) -> str:
    lines = []
    for name, ours in figures['methods'].items():
        if name in ROWS:
            row = ROWS[name]
            found = '; '.join(
                [
                    _compare_counts(ours['violations'], figures['samples'], row.violations),
                    *(
                        f'{key.replace("_", " ")} '
                        + _compare(_mean_max(ours[key]), getattr(row, key))
                        for key in ('force_error', 'torque_error')
                    ),
                ]
            )
            lines.append(f'- `{name}`: {found}. {paper_table.why(figures, name)}')
    if figures['samples'] > paper_table.SAMPLES:
        lines.append(
            f'- The greatest of {figures["samples"]} errors is greater than that of '
            f'{paper_table.SAMPLES}, as in the paper.'
        )
    base = figures['methods'].get('pseudo_inverse')
    if base:
        ratios = ', '.join(
            f'`{name}` {ours["time"]["median"] / base["time"]["median"]:.2g} '
            f'(paper {ROWS[name].time[0] / ROWS["pseudo_inverse"].time[0]:.0f})'
            for name, ours in figures['methods'].items()
            if name in ROWS and name != 'pseudo_inverse'
        )
        lines.append(
            '- Times: another machine and another language, so compare ratios. In units of the '
            f"pseudo-inverse's time (our medians, the paper's means): {ratios}."
        )
    return '\n'.join(lines)


def _compare_counts(ours: int, samples: int, paper: int) -> str:
    size = paper_table.SAMPLES
    if ours == paper == 0:
        return f'no violation in both, so fewer than 1 in {samples // 3 or 1} (95 %)'
    error = hypot(standard_error(ours, samples) / samples, standard_error(paper, size) / size)
    gap = ours / samples - paper / size
    return (
        f'{100.0 * ours / samples:.1f} % violations, {100.0 * paper / size:.1f} % in the paper, '
        f'{abs(gap) / error if error else float("inf"):.1f} standard errors apart'
    )


def _compare(ours: tuple[float, float], paper: tuple[float, float]) -> str:
    words = []
    for one, other in zip(ours, paper, strict=True):
        ratio = one / other
        if 0.85 < ratio < 1.15:
            words.append('as in the paper')
        elif ratio > 0.01:
            words.append(f"{ratio:.2g} times the paper's")
        else:
            words.append(f'{1.0 / ratio if ratio else float("inf"):.0e} times smaller')
    return f'{words[0]} on average, {words[1]} at most'


def _mean_max(values: Mapping[str, float]) -> tuple[float, float]:
    return values['mean'], values['max']


def _pair(mean: float, maximum: float) -> str:
    return f'{mean:.1e} / {maximum:.1e}'


def _count(hits: int, samples: int) -> str:
    error = standard_error(hits, samples)
    return f'{hits} ± {error:.0f} of {samples}' if hits else f'0 of {samples}'
