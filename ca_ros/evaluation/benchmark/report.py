"""The file benchmark.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ca_ros.evaluation.benchmark.accuracy import WRONG
from ca_ros.evaluation.benchmark.closed_loop_time import UNIT
from ca_ros.evaluation.benchmark.environment import STALL
from ca_ros.evaluation.benchmark.loads import LOADS
from ca_ros.evaluation.benchmark.plan import WORDS
from ca_ros.evaluation.benchmark.timing import TURN
from ca_ros.evaluation.tables import microseconds, number, table

Figures = Mapping[str, Any]

MARK = ' ✗'
"""Beside a time for which wrong answers were given."""


def report(figures: Figures) -> str:
    """Return benchmark.md for a run as in benchmark.json."""
    parts = [
        '# Benchmark',
        summary(figures),
        '## Percentiles and spread',
        _percentiles(figures),
        *(['## Number of rotors', _growth(figures)] if figures['growth'] else []),
        '## Batches',
        _batches(figures),
        '## Closed loop',
        _closed_loop(figures['closed_loop']),
        '## The node',
        _node(figures['node']),
        '## Made with',
        _made_with(figures),
        '## Limitations',
        _limitations(figures),
    ]
    return '\n\n'.join(parts) + '\n'


def summary(figures: Figures) -> str:
    """Return what matters most: what is promised, and the times per call."""
    parts = ['## Times per call', _calls(figures)]
    if figures['promises']:
        return '\n\n'.join(['## What is promised', _promises(figures), *parts])
    return '\n\n'.join([_about(figures), *parts])


def _promises(figures: Figures) -> str:
    rows = []
    for promise in figures['promises']:
        measured, met = promise['measured'], promise['met']
        rows.append(
            (
                promise['what'],
                f'{"at least" if promise["at_least"] else "at most"} {promise["limit"]:g}',
                '' if measured is None else number(measured),
                {True: 'met', False: '**missed**', None: 'not measured'}[met],
            )
        )
    return f'{_about(figures)}\n\n' + table(('promise', 'limit', 'measured', ''), rows)


def _about(figures: Figures) -> str:
    settings = figures['settings']
    quick = ', a **quick** one: each figure rests on little' if settings['quick'] else ''
    return (
        f'Medians of one run on `{settings["vehicle"]}`{quick}; load of the machine when it began '
        f'{figures["environment"]["load_average"][0]:g}, on '
        f'{figures["environment"]["machine"]["cores"]} cores.'
    )


def _calls(figures: Figures) -> str:
    calls, rows = figures['calls'], []
    for name in figures['contenders']:
        own = [calls[load][name] for load in LOADS]
        faults = '; '.join(
            f'{load}: {", ".join(each["faults"])}'
            for load, each in zip(LOADS, own, strict=True)
            if each['faults']
        )
        excesses = [each['norm_excess'] for each in own if each['norm_excess'] is not None]
        rows.append(
            (
                f'`{name}`',
                *(
                    f'{microseconds(each["mean"]["median"])} ({number(each["ratio"]["median"])}x)'
                    + ('' if each['correct'] else MARK)
                    for each in own
                ),
                number(max(each['error'] for each in own)),
                number(max(each['violation'] for each in own)),
                number(max(excesses)) if excesses else 'none right',
                faults or 'nothing',
            )
        )
    titles = (
        'contender',
        *(f'{load} [us]' for load in LOADS),
        'wrench error',
        'violation [N]',
        'norm excess [N]',
        'wrong',
    )
    parts = [
        'Microseconds per call, in brackets in units of the clipped pseudo-inverse '
        f'(`{figures["settings"]["baseline"]}`); errors are the worst of all answers. '
        f'{MARK.strip()} marks a time for which answers were wrong: the wrench [N, N m], the '
        f'bounds or the least norm missed by more than {WRONG:g}, or no answer to an attainable '
        'wrench.',
        table(titles, rows),
    ]
    if figures['absent']:
        absent = ', '.join(f'`{name}` ({how})' for name, how in figures['absent'].items())
        parts.append(f'Not installed, so not measured: {absent}.')
    parts.append(
        'The loads: '
        + '; '.join(
            f'*{name}*, {load["wrenches"]} wrenches, {load["about"]} '
            f'(rotors saturate at {100.0 * load["saturated"]:.0f} %)'
            for name, load in figures['loads'].items()
        )
        + '.'
    )
    return '\n\n'.join(parts)


def _percentiles(figures: Figures) -> str:
    calls, rows = figures['calls'], []
    for name, about in figures['contenders'].items():
        row = [f'`{name}`']
        for load in LOADS:
            own = calls[load][name]
            row += [microseconds(own['p99']['median']), _range(own['ratio'])]
        setup = about.get('setup')
        row.append('' if setup is None else number(1e3 * setup))
        rows.append(row)
    titles = ['contender']
    for load in LOADS:
        titles += [f'{load}: p99 [us]', 'x']
    return (
        '99th percentile of single calls, its median over repetitions; the middle half of the '
        'ratios of the repetitions; the time of the set-up, once.\n\n'
        + table([*titles, 'set-up [ms]'], rows)
    )


def _growth(figures: Figures) -> str:
    growth, parts = figures['growth'], []
    for load, contenders in growth.items():
        rotors = list(next(iter(contenders.values())))
        rows = [
            (
                f'`{name}`',
                *(
                    microseconds(each['mean']['median']) + ('' if each['correct'] else MARK)
                    for each in own.values()
                ),
            )
            for name, own in contenders.items()
        ]
        parts.append(table((f'{load} [us], rotors', *rotors), rows))
    return (
        "The paper's hexarotor with other numbers of rotors on its circle, which together give "
        'the same thrust. Baseline, `exact` and '
        + (f'the fastest peer, `{figures["rival"]}`' if figures['rival'] else 'no peer')
        + '.\n\n'
        + '\n\n'.join(parts)
    )


def _batches(figures: Figures) -> str:
    batch, rows = figures['batch'], []
    for name, time in batch['time'].items():
        method, _, size = name.partition(' ')
        rows.append(
            (
                f'`{method}`, batches of {size}' if size else f'`{figures["rival"]}`, one by one',
                str(batch['wrenches'][name]),
                microseconds(time['median']),
                f'{1.0 / time["median"]:,.0f}',
            )
        )
    linear = ', '.join(
        f'{size}: {number(each["median"])} ({_range(each)})'
        for size, each in batch['linearity'].items()
    )
    lines = [
        table(('uniform wrenches', 'wrenches', 'us per wrench', 'wrenches per second'), rows),
        f"Time per wrench in units of the smallest size's: {linear}.",
    ]
    if 'speedup' in batch:
        lines.append(
            f'`exact` in batches of {batch["largest"]} has {number(batch["speedup"]["median"])} '
            f'({_range(batch["speedup"])}) times the throughput of the loop.'
        )
    if not batch['correct']:
        lines.append('**Answers of `exact` in the batch were wrong.**')
    return '\n\n'.join(lines)


def _closed_loop(loop: Figures) -> str:
    return (
        f'{loop["duration"]:g} s of flight with `exact`, {loop["steps"]} steps of controller, '
        f'allocator and rigid body, take {loop["time"]["median"]:.3f} s '
        f'({loop["time"]["low"]:.3f} to {loop["time"]["high"]:.3f}); {UNIT} clipped '
        f'pseudo-inverses take {1e3 * loop["unit"]["median"]:.3g} ms, so that is '
        f'{number(loop["ratio"]["median"])} ({_range(loop["ratio"])}) of these units. The flight '
        f'ends {number(loop["final_error"])} m from its waypoint.'
    )


def _node(node: Figures) -> str:
    if 'absent' in node:
        return f'Not measured: {node["absent"]}.'
    if 'error' in node:
        return f'**Not measured: {node["error"]}.**'
    rows = [
        (
            f'{rate} Hz, {name}',
            *(microseconds(own[key]) for key in ('p50', 'p99', 'p99.9')),
            str(own['late']),
            f'{own["answered"]} of {own["sent"]}',
        )
        for rate, both in node['rates'].items()
        for name, own in ((name, both[name]) for name in ('allocator', 'echo'))
    ]
    sustained = node['sustained']
    ratios = '; '.join(
        f'{rate} Hz: p50 {number(both["ratio_p50"])}, p99 {number(both["ratio_p99"])}'
        for rate, both in node['rates'].items()
    )
    settings = ', '.join(f'{name} {value}' for name, value in node.get('settings', {}).items())
    return '\n\n'.join(
        [
            'From a command to its motor speeds, the allocator node beside an echo node that '
            'only copies numbers.',
            table(('', 'p50 [us]', 'p99 [us]', 'p99.9 [us]', 'late', 'answered'), rows),
            f'Allocator over echo, {ratios}. Highest sustained rate: '
            f'{number(sustained["allocator"])} Hz, echo {number(sustained["echo"])} Hz, ratio '
            f'{number(sustained["ratio"])}.',
            *([f'Settings: {settings}.'] if settings else []),
        ]
    )


def _made_with(figures: Figures) -> str:
    around, settings = figures['environment'], figures['settings']
    machine = around['machine']
    versions = [f'{name} {number}' for name, number in around['versions'].items()]
    plan = ', '.join(f'{WORDS[name]} {_plain(value)}' for name, value in settings['plan'].items())
    stolen = around['stolen']
    lines = [
        f'{machine["processor"]}, {machine["cores"]} cores, {machine["system"]}; load '
        f'{around["load_average"][0]:g} before and {around["load_average_after"][0]:g} after'
        + ('' if stolen is None else f'; {stolen:.1f} s of its time went to other machines')
        + f'; a busy process stood still for {1e3 * STALL:g} ms and more '
        f'{around["stalls"]:.1f} times a second',
        f'{", ".join(versions)}; BLAS of NumPy: {around["blas"]}',
        ', '.join(f'{name}={value}' for name, value in around['threads'].items()),
        f'clock {around["clock"]}; garbage collector {around["garbage_collector"]}',
        f'seed {settings["seed"]}; {plan}; {figures["wall_time"]:.0f} s in all',
    ]
    lines += [
        f'`{name}`: {about["interface"]}'
        + (f'; {about["package"]} {about["version"]}' if 'package' in about else '')
        + (f'; {_settings(about["settings"])}' if about.get('settings') else '')
        for name, about in figures['contenders'].items()
    ]
    return '\n'.join(f'- {line}' for line in lines)


def _limitations(figures: Figures) -> str:
    lines = [
        'Times are of Python calls: a solver that is called from C or C++ is spared most of what '
        'its interface costs here.',
        'Problems are small, four equations and a handful of rotors; nothing is said of others.',
        f'Contenders take turns of {TURN} calls, so caches are warm; what only first calls do is '
        'not part of the times.',
        'Peers keep their state from call to call, as they would on board.',
        'Whatever else the machine does is in the figures: ratios and medians stand it better '
        'than times and percentiles do.',
    ]
    if figures['settings']['quick']:
        lines.append('This was a quick run: few wrenches and few repetitions, see above.')
    return '\n'.join(f'- {line}' for line in lines)


def _range(values: Figures) -> str:
    return f'{number(values["low"])} to {number(values["high"])}'


def _settings(settings: Figures) -> str:
    return ', '.join(f'{name}={value}' for name, value in settings.items())


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ', '.join(f'{count} of {size}' for size, count in value.items())
    return ' '.join(map(str, value)) if isinstance(value, (list, tuple)) else f'{value:g}'
