"""The benchmark: how fast everything is, beside solvers that others have written."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ca_ros.arguments import split
from ca_ros.evaluation.benchmark.environment import is_one_thread, one_thread
from ca_ros.evaluation.benchmark.figure import draw
from ca_ros.evaluation.benchmark.plan import FULL, QUICK
from ca_ros.evaluation.benchmark.report import report, summary
from ca_ros.evaluation.benchmark.run import run
from ca_ros.evaluation.cases import Case, natural, parser, positive
from ca_ros.evaluation.evaluation import AnswerError
from ca_ros.flight.plots import save


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit code, 128 and more after a signal."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    if argv is None and not is_one_thread():
        # NumPy's libraries look at this when they are loaded, which is before any line of ours.
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], one_thread())
    received: list[int] = []

    def interrupt(number: int, _: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    # Also where whoever started it has left interrupts out, as shells do in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        return _measure(options)
    except KeyboardInterrupt:
        print('benchmark: interrupted; nothing is written', file=sys.stderr)
        return 128 + received[0]


def _measure(options: argparse.Namespace) -> int:
    try:
        case = Case.load(options.vehicle, options.param)
        methods = list(case.allocators(options.methods))
        options.out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    plan = QUICK if options.quick else FULL
    if options.samples:
        plan = replace(plan, **dict.fromkeys(('wrenches', 'flight'), options.samples))
    # An error in a method of the user's own is to be seen whole.
    try:
        figures = run(case, methods, plan, options.seed, options.quick, not options.no_nodes)
        files = _write(figures, options)
    except (AnswerError, OSError) as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    print(summary(figures))
    print('written:', ', '.join(map(str, files)))
    if 'error' in figures['node']:
        print(f'benchmark: the nodes: {figures["node"]["error"]}', file=sys.stderr)
        return 1
    return 0


def _write(figures: dict[str, Any], options: argparse.Namespace) -> list[Path]:
    numbers, text = options.out / 'benchmark.json', options.out / 'benchmark.md'
    numbers.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    text.write_text(report(figures), encoding='utf-8')
    return [numbers, text, *save(draw(figures), options.out / 'benchmark', options.figures)]


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'benchmark',
        'Time the methods beside the clipped pseudo-inverse and the solvers that are installed '
        '(pip install ca_ros[peers]): benchmark.json, benchmark.md and a figure.',
    )
    made.add_argument(
        '--samples',
        type=partial(positive, int),
        metavar='N',
        help=f'wrenches of each load; by default {FULL.wrenches}, with --quick {QUICK.wrenches} '
        f'and {QUICK.flight} of the flight',
    )
    made.add_argument('--seed', type=natural, default=0, help='of wrenches and order')
    made.add_argument('--quick', action='store_true', help='everything, less of it, in a minute')
    made.add_argument('--no-nodes', action='store_true', help='leave the ROS nodes out')
    return made.parse_args(split(argv)[0])


if __name__ == '__main__':
    raise SystemExit(main())
