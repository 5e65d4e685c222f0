"""The command lines and result files of the studies and the benchmark."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import pandas as pd

from ca_ros.allocation import ALLOCATORS
from ca_ros.arguments import HelpFormatter
from ca_ros.errors import CaRosError
from ca_ros.evaluation.comparison import FOR_COMPARISON
from ca_ros.flight.figures import add_options

NOT_REPEATED = (
    'out', 'figures', 'figure_width', 'fail', 'announce', 'ros_arguments', 'goals', 'waypoint',
    'heading', 'trajectory', 'workers', 'scheduler',
)  # fmt: skip
"""Options that `command` leaves out: places of files and of computation, and what the dynamic
study adds itself."""


def parser(prog: str, description: str, methods: bool = True) -> argparse.ArgumentParser:
    """Return a parser with the options that the studies and the benchmark share.

    A study without `methods` has no plots either.
    """
    made = argparse.ArgumentParser(prog=prog, description=description)
    made.formatter_class = HelpFormatter
    add = made.add_argument
    add('--vehicle', default='hexarotor', help='a shipped vehicle or a YAML file')
    compared = (
        f'what to compare: {", ".join([*ALLOCATORS, *FOR_COMPARISON])}, module:Class for a '
        f"method of your own; paper for the paper's four, all for the first {len(ALLOCATORS)}"
    )
    if methods:
        add('--methods', default='paper', metavar='A,B', help=compared)
    change = "a parameter other than in the vehicle's file, as with ROS; may be repeated"
    add('-p', '--param', action='append', default=[], metavar='NAME:=VALUE', help=change)
    add('--out', type=Path, default=Path('.'), metavar='DIR', help='folder of the results')
    if methods:
        add_options(made)
    return made


def concluded(prog: str, study: Callable[[], None]) -> int:
    """Do a study; return its exit code: 1 after an error, 130 after Ctrl-C, in one line each.

    Errors in a method of the user's own are shown with their traceback.
    """
    try:
        study()
    except (CaRosError, FloatingPointError, OSError) as error:
        print(f'{prog}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        print(f'{prog}: interrupted{stop}', file=sys.stderr)
        return 130
    return 0


def positive(kind: type[int] | type[float]) -> Callable[[str], Any]:
    """Return an argparse type: a positive, finite number; an int also as 1e8."""

    def read(text: str) -> Any:
        with suppress(ValueError):
            number = float(text)
            if 0 < number < float('inf') and kind(number) == number:
                return kind(number)
        what = 'positive whole number' if kind is int else 'positive number'
        raise argparse.ArgumentTypeError(f'{text!r} is not a {what}')

    return read


def natural(text: str) -> int:
    """Return a whole number from 0 on; an argparse type."""
    if text.isdecimal():
        return int(text)
    raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 on')


def write(stem: Path, rows: pd.DataFrame, found: Mapping[str, Any], document: str) -> None:
    """Write the rows as CSV, the metrics as JSON and a document as Markdown."""
    rows.to_csv(stem.with_suffix('.csv'), index=False, lineterminator='\n')
    text = json.dumps(found, indent=2) + '\n'
    stem.with_suffix('.json').write_text(text, encoding='utf-8')
    stem.with_suffix('.md').write_text(document, encoding='utf-8')


def command(prog: str, options: argparse.Namespace) -> list[str]:
    """Return the command line that gives the same results, with the defaults spelled out."""
    words = [prog]
    for name, value in vars(options).items():
        if name not in NOT_REPEATED and value is not None and value is not False:
            for each in value if isinstance(value, list) else [value]:
                words += [f'--{name.replace("_", "-")}', *([] if value is True else [str(each)])]
    return words
