"""The file benchmark.md: the tables of a benchmark."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.call_tables import (
    MARK,
    PYTHON,
    C,
    by_contender,
    percentiles,
    spread,
    time,
    times,
)
from ca_ros.evaluation.benchmark.contenders import BASELINE
from ca_ros.evaluation.benchmark.measurements import UNIT
from ca_ros.evaluation.benchmark.setups import ROTORS, SETUPS
from ca_ros.evaluation.environment import STALL
from ca_ros.evaluation.judge import WRONG
from ca_ros.evaluation.tables import microseconds, number, table

Metrics = Mapping[str, Any]


def document(found: Metrics) -> str:
    """Return benchmark.md for a run as in benchmark.json."""
    parts = _parts(found)
    sections = [
        '# Benchmark',
        summary(found),
        '## Percentiles and spread',
        'Percentiles of single calls and the worst call of a repetition, their medians over the '
        'repetitions; the slowest of all calls, which is often one that the machine interrupted; '
        'the interquartile range of the ratios of the repetitions.',
        *percentiles(parts['calls'], PYTHON),
        '## In C',
        *_in_c(found['C'], parts.get('C')),
        *(_growth(found['rival'], parts['rotors']) if 'rotors' in parts else []),
        '## Set-up',
        *_setup(found['contenders'], parts.get('set-up')),
        '## Batches',
        _batches(parts['batches']),
        '## Closed loop',
        _closed_loop(found['flight'], parts['closed loop']),
        '## The node',
        *_node(found['node']),
        '## Made with',
        '\n'.join(f'- {line}' for line in _made_with(found)),
        '## Limitations',
        'The times are of small problems with warm caches; docs/performance.md lists all '
        'limitations.',
    ]
    return '\n\n'.join(sections) + '\n'


def summary(found: Metrics) -> str:
    """Return the most important tables: the promises, and the times per call."""
    settings, around = found['settings'], found['environment']
    quick = ', a **quick** one: each number rests on little' if settings['quick'] else ''
    parts = [
        f'Medians of one run on `{settings["vehicle"]}`{quick}; load of the machine when it began '
        f'{around["load_average"][0]:g}, on {around["machine"]["cores"]} cores.'
    ]
    if found['promises']:
        verdicts = {True: 'met', False: '**missed**', None: 'not measured'}
        rows = [
            (
                each['what'],
                f'{"at least" if each["at_least"] else "at most"} {each["limit"]:g}',
                '' if each['measured'] is None else number(each['measured']),
                verdicts[each['met']],
            )
            for each in found['promises']
        ]
        parts = ['## What is promised', *parts, table(('promise', 'limit', 'measured', ''), rows)]
    return '\n\n'.join([*parts, '## Times per call', *_calls(found)])


def _parts(found: Metrics) -> dict[Any, pd.DataFrame]:
    return dict(iter(pd.DataFrame(found['results']).groupby('part', sort=False)))


def _calls(found: Metrics) -> list[str]:
    calls = _parts(found)['calls']
    parts = [
        'Microseconds per call, in brackets in units of the clipped pseudo-inverse '
        f'(`{BASELINE}`); errors are the worst of all answers. {MARK.strip()} marks a time for '
        'which answers were wrong: the wrench [N, N m], the bounds or the least norm missed by '
        f'more than {WRONG:g}, or no answer to an attainable wrench. p99.9 and the worst call are '
        'those of the load on which they are greatest.',
        times(calls, PYTHON),
    ]
    if found['absent']:
        absent = ', '.join(f'`{name}` ({how})' for name, how in found['absent'].items())
        parts.append(f'Not installed, so not measured: {absent}.')
    about = (
        f'*{name}*, {load["wrenches"]} wrenches, {load["about"]} '
        f'(rotors saturate at {100.0 * load["saturated"]:.0f} %)'
        for name, load in found['loads'].items()
    )
    return [*parts, f'The loads: {"; ".join(about)}.']


def _in_c(about: Metrics, calls: pd.DataFrame | None) -> list[str]:
    absent = '; '.join(f'`{name}`: {why}' for name, why in about['absent'].items())
    parts = [f'Not measured: {absent}.'] if absent else []
    if calls is None:
        return parts
    interfaces = '; '.join(f'`{name}`, {what}' for name, what in about['contenders'].items())
    return [
        'Nanoseconds per call, for which the clock is read in C, in brackets in units of the '
        'clipped pseudo-inverse in C. A time of a single call has the resolution of the clock and '
        f'includes {number(1e9 * about["clock"])} ns for reading it.',
        times(calls, C),
        *percentiles(calls, C),
        *parts,
        f'A call is: {interfaces}. Compiler: {about["compiler"]}; DAQP is the library that is '
        'inside its Python package.',
    ]


def _setup(contenders: Metrics, changes: pd.DataFrame | None) -> list[str]:
    parts = []
    if changes is not None:
        cells = by_contender(changes, lambda own: (number(1e3 * own.time),)).items()
        titles = (f'{axes} [ms]' for axes in changes['load'].unique())
        parts = [
            f'{ROTORS} rotors, another of which has failed each time:',
            table(('', *titles), [(SETUPS[name][0], *own) for name, own in cells]),
        ]
    setup = [(f'`{name}`', number(1e3 * own['setup'])) for name, own in contenders.items()]
    return [*parts, 'The set-up of the contenders, once:', table(('', 'set-up [ms]'), setup)]


def _growth(rival: str | None, results: pd.DataFrame) -> list[str]:
    peer = f'the fastest peer, `{rival}`' if rival else 'no peer'
    parts = [
        '## Number of rotors',
        "The paper's hexarotor with other numbers of rotors on its circle, which together give "
        f'the same thrust. Baseline, `exact` and {peer}.',
    ]
    for load, part in results.groupby('load', sort=False):
        rows = by_contender(part, lambda own: (time(own, PYTHON),)).items()
        titles = (f'{load} [us], rotors', *map(str, part['rotors'].unique()))
        parts.append(table(titles, [(f'`{name}`', *own) for name, own in rows]))
    return parts


def _batches(results: pd.DataFrame) -> str:
    rows = []
    for each in results.assign(time=1e6 * results['time']).itertuples():
        load = f'batches of {each.load}' if each.load[0].isdecimal() else each.load
        rows.append((f'`{each.contender}`, {load}', number(each.time), f'{1e6 / each.time:,.0f}'))
    found = table(('uniform wrenches', 'us per wrench', 'wrenches per second'), rows)
    return f'On one core, unless two are named.\n\n{found}'


def _closed_loop(flight: Metrics, results: pd.DataFrame) -> str:
    exact, unit = (results[results['contender'] == name].iloc[0] for name in ('exact', BASELINE))
    return (
        f'{exact.load} of flight with `exact`, {flight["steps"]} steps of controller, allocator '
        f'and rigid body, take {exact.time:.3f} s ({spread(exact, "time")}); {UNIT} clipped '
        f'pseudo-inverses take {1e3 * unit.time:.3g} ms, so that is {number(exact.ratio)} '
        f'({spread(exact, "ratio")}) of these units. The flight ends '
        f'{number(flight["final_error"])} m from its waypoint.'
    )


def _node(node: Metrics) -> list[str]:
    if 'absent' in node:
        return [f'Not measured: {node["absent"]}.']
    if 'error' in node:
        return [f'**Not measured: {node["error"]}.**']
    rows, ratios = [], []
    for rate, both in node['rates'].items():
        for kind in ('allocator', 'echo'):
            own = both[kind]
            times = (microseconds(own[key]) for key in ('p50', 'p99', 'p99.9'))
            counts = str(own['late']), f'{own["answered"]} of {own["sent"]}'
            rows.append((f'{rate} Hz, {kind}', *times, *counts))
        ratio = {key: number(value) for key, value in both['ratio'].items()}
        ratios.append(f'{rate} Hz: p50 {ratio["p50"]}, p99 {ratio["p99"]}')
    highest = {name: number(value) for name, value in node['sustained'].items()}
    return [
        'From a command to its motor speeds, the allocator node beside an echo node that only '
        'copies numbers.',
        table(('', 'p50 [us]', 'p99 [us]', 'p99.9 [us]', 'late', 'answered'), rows),
        f'Allocator over echo, {"; ".join(ratios)}. Highest sustained rate: '
        f'{highest["allocator"]} Hz, echo {highest["echo"]} Hz, ratio {highest["ratio"]}.',
        f'Settings: {_words(node["settings"], " ")}.',
    ]


def _made_with(found: Metrics) -> list[str]:
    around, settings = found['environment'], found['settings']
    machine = around['machine']
    lines = [
        f'{machine["processor"]}, {machine["cores"]} cores, {machine["system"]}; load '
        f'{around["load_average"][0]:g} before and {around["load_average_after"][0]:g} after; '
        f'{around["stolen"]:.1f} s of its time went to other machines; a busy process was stopped '
        f'for {1e3 * STALL:g} ms and more {around["stalls"]:.1f} times a second',
        f'{_words(around["versions"], " ")}; BLAS of NumPy: {around["blas"]}',
        _words(around['threads']),
        f'seed {settings["seed"]}; {_words(settings["plan"])}; {found["wall_time"]:.0f} s in all',
    ]
    for name, about in found['contenders'].items():
        package = f'{about["package"]} {about.get("version", "")}'.strip()
        parts = (about['interface'], package, _words(about['settings']))
        lines.append(f'`{name}`: {"; ".join(filter(None, parts))}')
    return lines


def _words(values: Metrics, between: str = '=') -> str:
    return ', '.join(f'{name}{between}{value}' for name, value in values.items())
