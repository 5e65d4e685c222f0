"""The chapters of a report: what the folders of the studies and the benchmark hold."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ca_ros.evaluation.report.markdown import html

Metrics = Mapping[str, Any]
Tiles = list[tuple[str, str]]

MIMES = {'svg': 'image/svg+xml', 'png': 'image/png'}
"""Formats of plots that can be embedded, the better one first."""

WIDE = ('slices', 'violations', 'position', 'failure', 'benchmark')
"""Plots that need the whole width."""

FACTS = ('seed', 'versions', 'machine', 'environment')
"""What a result depends on besides the parameters, as far as its JSON says it."""


class ChapterError(ValueError):
    """A folder does not hold what it should."""


def _static_tiles(found: Metrics) -> Tiles:
    name, own = _first(found)
    return [
        (f'{own["violations"]} of {found["samples"]}', f'answers of {name} break a bound'),
        (f'{own["force_error"]["max"]:.1e} N', f'greatest force error of {name}'),
        (f'{own["torque_error"]["max"]:.1e} N m', f'greatest torque error of {name}'),
        (f'{1e6 * own["time"]["median"]:.3g} µs', f'median time of {name}'),
    ]


def _dynamic_tiles(found: Metrics) -> Tiles:
    name, own = _first(found)
    settled = own['settling_time']['z']
    return [
        *_share(found['observations'].values(), "of the paper's observations hold"),
        (f'{1e3 * own["steady_state_error"]["z"]:.2f} mm', f'height error of {name} at the end'),
        (
            'never' if settled is None else f'{settled:.2f} s',
            f'until the height of {name} settles',
        ),
        (f'{100.0 * own["time_at_bound"]:.1f} %', f'of its time a rotor of {name} is at a bound'),
    ]


def _benchmark_tiles(found: Metrics) -> Tiles:
    verdicts = [each['met'] for each in found['promises'] if each['met'] is not None]
    tiles = _share(verdicts, 'promises met, of those that were measured')
    for load, own in found['calls'].items():
        if 'exact' in own:
            time = 1e6 * own['exact']['mean']['median']
            about = f'the time of a clipped pseudo-inverse: exact, {load}, {time:.3g} µs'
            tiles.append((f'{own["exact"]["ratio"]["median"]:.3g}x', about))
    return tiles


def _first(found: Metrics) -> tuple[str, Any]:
    """Return the method that the tiles are about: exact, or else the first."""
    name = 'exact' if 'exact' in found['methods'] else next(iter(found['methods']))
    return name, found['methods'][name]


def _share(verdicts: Any, what: str) -> Tiles:
    return [(f'{sum(verdicts)} of {len(verdicts)}', what)] if verdicts else []


class Kind(NamedTuple):
    """A kind of folder: its captions are of plots, by file name without suffix, in their order."""

    title: str
    program: str
    tiles: Callable[[Metrics], Tiles]
    captions: Mapping[str, str]


KINDS = {
    'static': Kind(
        'Static study',
        'static_study',
        _static_tiles,
        {
            'slices': 'What becomes of a grid of commands in sections of the admissible set. '
            'A line leads from what was commanded to what was achieved.',
            'errors': 'Share of the samples whose error is not greater.',
            'latency': 'Share of the calls that take no longer.',
            'violations': 'Where in the admissible set the pseudo-inverse violates the bounds '
            'before saturation, and how often, from the centre to the boundary.',
        },
    ),
    'dynamic': Kind(
        'Dynamic study',
        'dynamic_study',
        _dynamic_tiles,
        {
            'position': 'Position over time; on the right what is missing in the last second. '
            'The waypoint is dashed.',
            'attitude': 'Roll and pitch (Euler angles 123) and heading over time. The heading '
            'that is asked for is dashed.',
            'rotor_speeds': 'Rotor speeds over time. The bounds are dashed.',
            'failure': 'Position, tilt, rotor speeds, and the margin of the commanded wrench in '
            'the admissible set of the rotors as they are. Failure and announcement are dotted.',
        },
    ),
    'benchmark': Kind(
        'Benchmark',
        'benchmark',
        _benchmark_tiles,
        {'benchmark': 'Times per call on each load. Hollow markers: wrong answers.'},
    ),
}
"""The chapters of a report, in their order; the files of each have its name."""


def chapter(name: str, folder: Path | None) -> dict[str, Any]:
    """Read a folder.

    Parameters
    ----------
    name : str
        A name in `KINDS`.
    folder : Path or None
        None for a chapter that is absent.

    Returns
    -------
    dict
        What the template shows of it; ``start`` is None if it is absent.

    Raises
    ------
    ChapterError
        In one line that names the file and the fault.
    """
    kind = KINDS[name]
    head = {'name': name, 'title': kind.title, 'program': kind.program, 'start': None}
    if folder is None:
        return head
    file = folder / f'{name}.json'
    try:
        text = file.with_suffix('.md').read_text(encoding='utf-8')
        found = json.loads(file.read_text(encoding='utf-8'))
        if not isinstance(found, dict):
            raise ChapterError(f'{file}: expected a JSON object, as {kind.program} writes it')
        start, rest, headings = html(text, name)
        return head | {
            'start': start,
            'rest': rest,
            'headings': headings,
            'tiles': kind.tiles(found),
            'pictures': [
                (picture, caption, stem in WIDE)
                for stem, caption in kind.captions.items()
                if (picture := _embedded(folder / stem))
            ],
            'command': shlex.join(found['command']),
            'facts': _flat({key: found[key] for key in FACTS if key in found}),
            'parameters': _flat(found.get('settings', found)['parameters']),
        }
    except ChapterError:
        raise
    except OSError as error:
        raise ChapterError(
            f'{error.filename}: not there or not to be read; {kind.program} --out DIR makes it'
        ) from None
    except UnicodeDecodeError as error:
        raise ChapterError(f'{folder}: not a file of text: {error}') from None
    except (json.JSONDecodeError, RecursionError) as error:
        raise ChapterError(f'{file}: not JSON: {error}') from None
    except (KeyError, TypeError, AttributeError, ValueError, StopIteration) as error:
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
