"""What the folders of the studies and the benchmark have to say."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ca_ros.evaluation.report.markdown import html

Figures = Mapping[str, Any]

MIMES = {'svg': 'image/svg+xml', 'png': 'image/png'}
"""Formats of figures that can be embedded, the better one first."""


@dataclass(frozen=True)
class Kind:
    """A kind of folder: what is looked for in it.

    Attributes
    ----------
    title : str
    program : str
        The executable that makes it.
    captions : dict of str to str
        Of figures, by file name without suffix, in the order in which they are shown.
    wide : tuple of str
        Those that need the whole width.
    tiles : function
        From its JSON to the numbers at its head and what they are.
    options : function
        From its JSON to the options that its program was run with.
    parameters : function
        From its JSON to the vehicle's parameters.
    """

    title: str
    program: str
    captions: Mapping[str, str]
    wide: tuple[str, ...]
    tiles: Callable[[Figures], list[tuple[str, str]]]
    options: Callable[[Figures], list[str]]
    parameters: Callable[[Figures], Figures] = itemgetter('parameters')


@dataclass(frozen=True)
class Chapter:
    """A chapter of the report; `start` is None for what is absent."""

    name: str
    title: str
    program: str
    start: Markup | None = None
    rest: Markup | None = None
    headings: list[tuple[str, str]] = field(default_factory=list)
    tiles: list[tuple[str, str]] = field(default_factory=list)
    pictures: list[tuple[str, str, bool]] = field(default_factory=list)
    command: str = ''
    facts: list[tuple[str, str]] = field(default_factory=list)
    parameters: list[tuple[str, str]] = field(default_factory=list)


class ContentsError(ValueError):
    """A folder does not hold what it should."""


def chapter(name: str, folder: Path | None) -> Chapter:
    """Read a folder.

    Parameters
    ----------
    name : str
        A name in `KINDS`, which its files have too.
    folder : Path or None
        None for a chapter that is absent.

    Raises
    ------
    ContentsError
        In one line that names the file and the fault.
    """
    kind = KINDS[name]
    if folder is None:
        return Chapter(name, kind.title, kind.program)
    file = folder / f'{name}.json'
    try:
        text = file.with_suffix('.md').read_text(encoding='utf-8')
        figures = json.loads(file.read_text(encoding='utf-8'))
        if not isinstance(figures, dict):
            raise ContentsError(f'{file}: expected a JSON object, as {kind.program} writes it')
        start, rest, headings = html(text, name)
        return Chapter(
            name,
            kind.title,
            kind.program,
            start,
            rest,
            headings,
            kind.tiles(figures),
            [
                (_embedded(folder / stem), caption, stem in kind.wide)
                for stem, caption in kind.captions.items()
                if _picture(folder / stem)
            ],
            shlex.join([kind.program, *kind.options(figures)]),
            _flat({key: figures[key] for key in FACTS if key in figures}),
            _flat(kind.parameters(figures)),
        )
    except ContentsError:
        raise
    except OSError as error:
        raise ContentsError(
            f'{error.filename}: not there or not to be read; {kind.program} --out DIR makes it'
        ) from None
    except UnicodeDecodeError as error:
        raise ContentsError(f'{folder}: not a file of text: {error}') from None
    except (json.JSONDecodeError, RecursionError) as error:
        raise ContentsError(f'{file}: not JSON: {error}') from None
    except (KeyError, TypeError, AttributeError, ValueError, StopIteration) as error:
        raise ContentsError(
            f'{file}: not written by this version of {kind.program}: {error!r}'
        ) from None


FACTS = ('seed', 'versions', 'machine', 'environment')
"""What a result depends on besides the parameters, as far as its JSON says it."""


def _flat(tree: Mapping[str, Any], prefix: str = '') -> list[tuple[str, str]]:
    rows = []
    for key, value in tree.items():
        if isinstance(value, dict):
            rows += _flat(value, f'{prefix}{key}: ')
        else:
            words = ', '.join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f'{prefix}{key}', words))
    return rows


def _picture(stem: Path) -> Path | None:
    files = (stem.with_suffix(f'.{suffix}') for suffix in MIMES)
    return next((file for file in files if file.is_file()), None)


def _embedded(stem: Path) -> str:
    """Return a picture as a data URI."""
    file = _picture(stem)
    assert file is not None
    data = base64.b64encode(file.read_bytes()).decode()
    return f'data:{MIMES[file.suffix[1:]]};base64,{data}'


def _first(figures: Figures) -> tuple[str, Any]:
    """Return the method that the tiles are about: exact, or else the first."""
    methods = figures['methods']
    name = 'exact' if 'exact' in methods else next(iter(methods))
    return name, methods[name]


def _static_tiles(figures: Figures) -> list[tuple[str, str]]:
    name, found = _first(figures)
    return [
        (f'{found["violations"]} of {figures["samples"]}', f'answers of {name} break a bound'),
        (f'{found["force_error"]["max"]:.1e} N', f'greatest force error of {name}'),
        (f'{found["torque_error"]["max"]:.1e} N m', f'greatest torque error of {name}'),
        (f'{1e6 * found["time"]["median"]:.3g} µs', f'median time of {name}'),
    ]


def _static_options(figures: Figures) -> list[str]:
    return [
        *_common(figures),
        '--samples',
        str(figures['requested']),
        '--seed',
        str(figures['seed']),
        '--sampling',
        figures['sampling'],
    ]


def _dynamic_tiles(figures: Figures) -> list[tuple[str, str]]:
    name, found = _first(figures)
    verdicts = figures['observations'].values()
    height, settled = found['steady_state_error']['z'], found['settling_time']['z']
    tiles = [
        (f'{1e3 * height:.2f} mm', f'height error of {name} at the end'),
        (
            'never' if settled is None else f'{settled:.2f} s',
            f'until the height of {name} settles',
        ),
        (
            f'{100.0 * found["time_at_bound"]:.1f} %',
            f'of its time a rotor of {name} is at a bound',
        ),
    ]
    if verdicts:
        tiles.insert(
            0, (f'{sum(verdicts)} of {len(verdicts)}', "of the paper's observations hold")
        )
    return tiles


def _dynamic_options(figures: Figures) -> list[str]:
    over_ros = ['--ros'] if figures['flown'] != 'offline' else []
    duration = ['--duration', f'{figures["duration"]:g}']
    return [*_common(figures), *duration, *figures['failures'], *over_ros]


def _benchmark_tiles(figures: Figures) -> list[tuple[str, str]]:
    verdicts = [each['met'] for each in figures['promises'] if each['met'] is not None]
    tiles = []
    if verdicts:
        kept = f'{sum(verdicts)} of {len(verdicts)}'
        tiles.append((kept, 'promises met, of those that were measured'))
    for load, own in figures['calls'].items():
        if 'exact' in own:
            ratio, time = own['exact']['ratio']['median'], own['exact']['mean']['median']
            about = f'the time of a clipped pseudo-inverse: exact, {load}, {1e6 * time:.3g} µs'
            tiles.append((f'{ratio:.3g}x', about))
    return tiles


def _benchmark_options(figures: Figures) -> list[str]:
    settings, node = figures['settings'], figures['node']
    options = [*_common(settings), '--seed', str(settings['seed'])]
    if (samples := settings['plan']['wrenches']) == settings['plan']['flight']:
        options += ['--samples', str(samples)]
    options += ['--quick'] if settings['quick'] else []
    return options + (['--no-nodes'] if 'absent' in node else [])


def _common(figures: Figures) -> list[str]:
    options = ['--vehicle', str(figures['vehicle']), '--methods', ','.join(figures['methods'])]
    return options + [word for change in figures['changes'] for word in ('-p', change)]


KINDS = {
    'static': Kind(
        'Static study',
        'static_study',
        {
            'slices': 'What becomes of a grid of commands in sections of the admissible set. '
            'A line leads from what was commanded to what was achieved.',
            'errors': 'Share of the samples whose error is not greater.',
            'latency': 'Share of the calls that take no longer.',
            'violations': 'Where in the admissible set the pseudo-inverse violates the bounds '
            'before saturation, and how often, from the centre to the boundary.',
        },
        ('slices', 'violations'),
        _static_tiles,
        _static_options,
    ),
    'dynamic': Kind(
        'Dynamic study',
        'dynamic_study',
        {
            'position': 'Position over time; on the right what is missing in the last second. '
            'The waypoint is dashed.',
            'attitude': 'Roll and pitch (Euler angles 123) and heading over time. The heading '
            'that is asked for is dashed.',
            'rotor_speeds': 'Rotor speeds over time. The bounds are dashed.',
            'failure': 'Position, tilt, rotor speeds, and the margin of the commanded wrench in '
            'the admissible set of the rotors as they are. Failure and announcement are dotted.',
        },
        ('position', 'failure'),
        _dynamic_tiles,
        _dynamic_options,
    ),
    'benchmark': Kind(
        'Benchmark',
        'benchmark',
        {
            'benchmark': 'Times per call on each load. Hollow markers: wrong answers.',
        },
        ('benchmark',),
        _benchmark_tiles,
        _benchmark_options,
        lambda figures: figures['settings']['parameters'],
    ),
}
"""The chapters of a report, in their order; the files of each have its name."""
