"""The file benchmark.md: the tables of a benchmark."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ca_ros.evaluation.benchmark.loads import LOADS
from ca_ros.evaluation.benchmark.measurements import UNIT
from ca_ros.evaluation.benchmark.timing import TURN
from ca_ros.evaluation.environment import STALL
from ca_ros.evaluation.judge import WRONG
from ca_ros.evaluation.tables import microseconds, number, table

Metrics = Mapping[str, Any]

MARK = ' ✗'
"""Beside a time for which wrong answers were given."""


def document(found: Metrics) -> str:
    """Return benchmark.md for a run as in benchmark.json."""
    parts = [
        '# Benchmark',
        summary(found),
        '## Percentiles and spread',
        *_percentiles(found),
        *(['## Number of rotors', *_growth(found)] if found['growth'] else []),
        '## Batches',
        *_batches(found),
        '## Closed loop',
        _closed_loop(found['closed_loop']),
        '## The node',
        *_node(found['node']),
        '## Made with',
        '\n'.join(f'- {line}' for line in _made_with(found)),
        '## Limitations',
        '\n'.join(f'- {line}' for line in _limitations(found)),
    ]
    return '\n\n'.join(parts) + '\n'


def summary(found: Metrics) -> str:
    """Return what matters most: what is promised, and the times per call."""
    settings, around = found['settings'], found['environment']
    quick = ', a **quick** one: each number rests on little' if settings['quick'] else ''
    parts = [
        f'Medians of one run on `{settings["vehicle"]}`{quick}; load of the machine when it began '
        f'{around["load_average"][0]:g}, on {around["machine"]["cores"]} cores.'
    ]
    if found['promises']:
        rows = [
            (
                each['what'],
                f'{"at least" if each["at_least"] else "at most"} {each["limit"]:g}',
                '' if each['measured'] is None else number(each['measured']),
                {True: 'met', False: '**missed**', None: 'not measured'}[each['met']],
            )
            for each in found['promises']
        ]
        parts = ['## What is promised', *parts, table(('promise', 'limit', 'measured', ''), rows)]
    return '\n\n'.join([*parts, '## Times per call', *_calls(found)])


def _calls(found: Metrics) -> list[str]:
    rows = []
    for name in found['contenders']:
        own = {load: found['calls'][load][name] for load in LOADS}
        faults = [f'{load}: {", ".join(e["faults"])}' for load, e in own.items() if e['faults']]
        excesses = [e['norm_excess'] for e in own.values() if e['norm_excess'] is not None]
        rows.append(
            (
                f'`{name}`',
                *(f'{_time(e)} ({number(e["ratio"]["median"])}x){_mark(e)}' for e in own.values()),
                number(max(e['error'] for e in own.values())),
                number(max(e['violation'] for e in own.values())),
                number(max(excesses)) if excesses else 'none right',
                '; '.join(faults) or 'nothing',
            )
        )
    errors = ('wrench error', 'violation [N]', 'norm excess [N]', 'wrong')
    parts = [
        'Microseconds per call, in brackets in units of the clipped pseudo-inverse '
        f'(`{found["settings"]["baseline"]}`); errors are the worst of all answers. '
        f'{MARK.strip()} marks a time for which answers were wrong: the wrench [N, N m], the '
        f'bounds or the least norm missed by more than {WRONG:g}, or no answer to an attainable '
        'wrench.',
        table(('contender', *(f'{load} [us]' for load in LOADS), *errors), rows),
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


def _percentiles(found: Metrics) -> list[str]:
    titles = [title for load in LOADS for title in (f'{load}: p99 [us]', 'x')]
    rows = []
    for name, about in found['contenders'].items():
        own = [found['calls'][load][name] for load in LOADS]
        words = [w for e in own for w in (microseconds(e['p99']['median']), _range(e['ratio']))]
        setup = number(1e3 * about['setup']) if 'setup' in about else ''
        rows.append((f'`{name}`', *words, setup))
    return [
        '99th percentile of single calls, its median over repetitions; the middle half of the '
        'ratios of the repetitions; the time of the set-up, once.',
        table(('contender', *titles, 'set-up [ms]'), rows),
    ]


def _growth(found: Metrics) -> list[str]:
    peer = f'the fastest peer, `{found["rival"]}`' if found['rival'] else 'no peer'
    parts = [
        "The paper's hexarotor with other numbers of rotors on its circle, which together give "
        f'the same thrust. Baseline, `exact` and {peer}.'
    ]
    for load, contenders in found['growth'].items():
        rows = [
            (f'`{name}`', *(_time(each) + _mark(each) for each in own.values()))
            for name, own in contenders.items()
        ]
        parts.append(table((f'{load} [us], rotors', *contenders['exact']), rows))
    return parts


def _batches(found: Metrics) -> list[str]:
    batch, rows = found['batch'], []
    for name, time in batch['time'].items():
        method, _, size = name.partition(' ')
        what = f'`{method}`, batches of {size}' if size else f'`{found["rival"]}`, one by one'
        rate = f'{1.0 / time["median"]:,.0f}'
        rows.append((what, str(batch['wrenches'][name]), microseconds(time['median']), rate))
    linear = ', '.join(
        f'{size}: {number(each["median"])} ({_range(each)})'
        for size, each in batch['linearity'].items()
    )
    parts = [
        table(('uniform wrenches', 'wrenches', 'us per wrench', 'wrenches per second'), rows),
        f"Time per wrench in units of the smallest size's: {linear}.",
    ]
    if 'speedup' in batch:
        parts.append(
            f'`exact` in batches of {batch["largest"]} has {number(batch["speedup"]["median"])} '
            f'({_range(batch["speedup"])}) times the throughput of the loop.'
        )
    if not batch['correct']:
        parts.append('**Answers of `exact` in the batch were wrong.**')
    return parts


def _closed_loop(loop: Metrics) -> str:
    return (
        f'{loop["duration"]:g} s of flight with `exact`, {loop["steps"]} steps of controller, '
        f'allocator and rigid body, take {loop["time"]["median"]:.3f} s '
        f'({loop["time"]["low"]:.3f} to {loop["time"]["high"]:.3f}); {UNIT} clipped '
        f'pseudo-inverses take {1e3 * loop["unit"]["median"]:.3g} ms, so that is '
        f'{number(loop["ratio"]["median"])} ({_range(loop["ratio"])}) of these units. The flight '
        f'ends {number(loop["final_error"])} m from its waypoint.'
    )


def _node(node: Metrics) -> list[str]:
    if 'absent' in node:
        return [f'Not measured: {node["absent"]}.']
    if 'error' in node:
        return [f'**Not measured: {node["error"]}.**']
    rows = [
        (
            f'{rate} Hz, {name}',
            *(microseconds(both[name][key]) for key in ('p50', 'p99', 'p99.9')),
            str(both[name]['late']),
            f'{both[name]["answered"]} of {both[name]["sent"]}',
        )
        for rate, both in node['rates'].items()
        for name in ('allocator', 'echo')
    ]
    sustained = node['sustained']
    ratios = '; '.join(
        f'{rate} Hz: p50 {number(both["ratio_p50"])}, p99 {number(both["ratio_p99"])}'
        for rate, both in node['rates'].items()
    )
    settings = ', '.join(f'{name} {value}' for name, value in node.get('settings', {}).items())
    return [
        'From a command to its motor speeds, the allocator node beside an echo node that only '
        'copies numbers.',
        table(('', 'p50 [us]', 'p99 [us]', 'p99.9 [us]', 'late', 'answered'), rows),
        f'Allocator over echo, {ratios}. Highest sustained rate: {number(sustained["allocator"])} '
        f'Hz, echo {number(sustained["echo"])} Hz, ratio {number(sustained["ratio"])}.',
        *([f'Settings: {settings}.'] if settings else []),
    ]


def _made_with(found: Metrics) -> list[str]:
    around, settings = found['environment'], found['settings']
    machine, stolen = around['machine'], around['stolen']
    return [
        f'{machine["processor"]}, {machine["cores"]} cores, {machine["system"]}; load '
        f'{around["load_average"][0]:g} before and {around["load_average_after"][0]:g} after'
        + ('' if stolen is None else f'; {stolen:.1f} s of its time went to other machines')
        + f'; a busy process was stopped for {1e3 * STALL:g} ms and more '
        f'{around["stalls"]:.1f} times a second',
        f'{_words(around["versions"], " ")}; BLAS of NumPy: {around["blas"]}',
        _words(around['threads']),
        f'clock {around["clock"]}; garbage collector {around["garbage_collector"]}',
        f'seed {settings["seed"]}; {_words(settings["plan"])}; {found["wall_time"]:.0f} s in all',
        *(
            f'`{name}`: {about["interface"]}'
            + (f'; {about["package"]} {about["version"]}' if 'package' in about else '')
            + (f'; {_words(about["settings"])}' if about.get('settings') else '')
            for name, about in found['contenders'].items()
        ),
    ]


def _limitations(found: Metrics) -> list[str]:
    lines = [
        'Times are of Python calls: called from C or C++, a solver avoids most of the interface '
        'cost measured here.',
        'Problems are small, four equations and a handful of rotors; nothing is said of others.',
        f'Contenders take turns of {TURN} calls, so caches are warm; first calls are not timed.',
        'Peers keep their state from call to call, as they would on board.',
        'Background load affects the times and percentiles more than the ratios and medians.',
    ]
    if found['settings']['quick']:
        lines.append('This was a quick run: few wrenches and few repetitions, see above.')
    return lines


def _time(own: Metrics) -> str:
    return microseconds(own['mean']['median'])


def _mark(own: Metrics) -> str:
    return '' if own['correct'] else MARK


def _range(values: Metrics) -> str:
    return f'{number(values["low"])} to {number(values["high"])}'


def _words(values: Metrics, between: str = '=') -> str:
    return ', '.join(f'{name}{between}{value}' for name, value in values.items())
