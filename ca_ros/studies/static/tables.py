"""The tables of static.md, as Table 1 of the paper."""

from collections.abc import Iterator, Mapping
from math import sqrt
from typing import Any

from ca_ros.studies.errors import ERRORS
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
        observations=list(_observations(found)),
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
    """Yield a sentence about each method."""
    for name, own in found['methods'].items():
        worst = ', '.join(f'{own[key]["max"]:.1e}{UNITS[key]}' for key in _errors(found))
        exact = own['status'].get('EXACT', 0)
        yield f'`{name}` produces {exact} of {found["samples"]} wrenches; largest error {worst}.'


def _rows(found: Metrics) -> list[list[str]]:
    rows = []
    for name, own in found['methods'].items():
        hits, samples = own['violations'], found['samples']
        error = f' ± {standard_error(hits, samples):.0f}' if hits else ''
        pairs = [(own[key]['mean'], own[key]['max']) for key in (*_errors(found), 'time')]
        cells = (f'{mean:.1e} / {most:.1e}' for mean, most in pairs)
        rows.append([f'`{name}`', f'{hits}{error} of {samples}', *cells])
    return rows


def standard_error(hits: int, samples: int) -> float:
    """Return the standard error of a count among independent samples."""
    return sqrt(hits * (1.0 - hits / samples))
