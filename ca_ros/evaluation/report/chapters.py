"""The chapters of a report: the results in the folders of the studies and the benchmark."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ca_ros.errors import CaRosError
from ca_ros.evaluation.report.markdown import html

Metrics = Mapping[str, Any]
Tiles = Iterator[tuple[str, str]]

MIMES = {'svg': 'image/svg+xml', 'png': 'image/png'}
"""Formats of plots that can be embedded, the better one first."""

WIDE = ('slices', 'violations', 'position', 'failure', 'benchmark')
"""Plots that need the whole width."""

FACTS = ('seed', 'versions', 'machine', 'environment')
"""Keys of the JSON files on which a result depends, beside the parameters."""

FAULTS = (AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""Errors caused by unexpected contents of files."""


class ChapterError(CaRosError):
    """A folder does not hold the results of its program."""


def _static_tiles(found: Metrics) -> Tiles:
    name, own = _first(found)
    yield f'{own["violations"]} of {found["samples"]}', f'answers of {name} violate a bound'
    for key, unit in (('force_error', ' N'), ('torque_error', ' N m'), ('error', '')):
        if key in own:
            words = f'largest {key.replace("_", " ")} of {name}'
            yield f'{own[key]["max"]:.1e}{unit}', words
    yield f'{1e6 * own["time"]["median"]:.3g} µs', f'median time of {name}'


def _dynamic_tiles(found: Metrics) -> Tiles:
    name, own = _first(found)
    yield from _share(found['observations'].values(), "of the paper's observations hold")
    error, settled = own['steady_state_error']['z'], own['settling_time']['z']
    yield f'{1e3 * error:.2f} mm', f'height error of {name} at the end'
    time = 'never' if settled is None else f'{settled:.2f} s'
    yield time, f'until the height of {name} settles'
    yield f'{100.0 * own["time_at_bound"]:.1f} %', f'of the time a rotor of {name} is at a bound'


def _benchmark_tiles(found: Metrics) -> Tiles:
    verdicts = [each['met'] for each in found['promises'] if each['met'] is not None]
    yield from _share(verdicts, 'of the measured promises met')
    for each in found['results']:
        if (each['part'], each['contender']) == ('calls', 'exact'):
            time = f'{each["load"]}, {1e6 * each["time"]:.3g} µs'
            yield f'{each["ratio"]:.3g}x', f'the time of a clipped pseudo-inverse: exact, {time}'


def _first(found: Metrics) -> tuple[str, Any]:
    """Return the method that the tiles are about: exact, or else the first."""
    first, *_ = found['methods']
    name = 'exact' if 'exact' in found['methods'] else first
    return name, found['methods'][name]


def _share(verdicts: Collection[bool], what: str) -> Tiles:
    if verdicts:
        yield f'{sum(verdicts)} of {len(verdicts)}', what


class Kind(NamedTuple):
    """A kind of folder: title, program, tiles, and the captions of its plots in their order."""

    title: str
    program: str
    tiles: Callable[[Metrics], Tiles]
    captions: Mapping[str, str]


STATIC = {
    'slices': 'Commands on a grid in sections of the admissible set, and the wrenches achieved.',
    'errors': 'Share of the samples with at most this error.',
    'latency': 'Share of the calls that take at most this time.',
    'violations': 'Where in the admissible set the pseudo-inverse violates the bounds before '
    'saturation, and how often, from the centre to the boundary.',
}
DYNAMIC = {
    'position': 'Position over time; on the right the error in the last second. The waypoint is '
    'dashed.',
    'attitude': 'Roll and pitch (Euler angles 123) and heading over time. The commanded heading '
    'is dashed.',
    'rotor_speeds': 'Rotor speeds over time. The bounds are dashed.',
    'failure': 'Position, tilt, rotor speeds, and the margin of the commanded wrench in the '
    'admissible set of the rotors as they are. Failure and announcement are dotted.',
}
BENCHMARK = {'benchmark': 'Times per call on each load. Hollow markers: wrong answers.'}

KINDS = {
    'static': Kind('Static study', 'static_study', _static_tiles, STATIC),
    'dynamic': Kind('Dynamic study', 'dynamic_study', _dynamic_tiles, DYNAMIC),
    'benchmark': Kind('Benchmark', 'benchmark', _benchmark_tiles, BENCHMARK),
}
"""The chapters of a report, in their order; the files of each have its name."""


def chapter(name: str, folder: Path | None) -> dict[str, Any]:
    """Return the template's variables for a chapter; ``start`` is None without a folder.

    Raises a ChapterError in one line that names the file and the fault.
    """
    kind = KINDS[name]
    head = {'name': name, 'title': kind.title, 'program': kind.program, 'start': None}
    if folder is None:
        return head
    file = folder / f'{name}.json'
    try:
        found = json.loads(file.read_text(encoding='utf-8'))
        text = file.with_suffix('.md').read_text(encoding='utf-8')
        start, rest, headings = html(text, name)
        return head | {
            'start': start,
            'rest': rest,
            'headings': headings,
            'tiles': list(kind.tiles(found)),
            'pictures': [
                (picture, caption, stem in WIDE)
                for stem, caption in kind.captions.items()
                if (picture := _embedded(folder / stem))
            ],
            'command': shlex.join(found['command']),
            'facts': _flat({key: found[key] for key in FACTS if key in found}),
            'parameters': _flat(found.get('settings', found)['parameters']),
        }
    except OSError as error:
        raise ChapterError(
            f'{error.filename}: cannot be read; {kind.program} --out DIR writes it'
        ) from None
    except FAULTS as error:
        raise ChapterError(
            f'{file}: not written by this version of {kind.program}: {error!r}'
        ) from None


def _flat(tree: Mapping[str, Any], prefix: str = '') -> list[tuple[str, str]]:
    rows = []
    for key, value in tree.items():
        if isinstance(value, dict):
            rows += _flat(value, f'{prefix}{key}: ')
        else:
            words = ', '.join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f'{prefix}{key}', words))
    return rows


def _embedded(stem: Path) -> str | None:
    """Return a plot as a data URI, None if there is none."""
    for suffix, mime in MIMES.items():
        if (file := stem.with_suffix(f'.{suffix}')).is_file():
            return f'data:{mime};base64,{base64.b64encode(file.read_bytes()).decode()}'
    return None
