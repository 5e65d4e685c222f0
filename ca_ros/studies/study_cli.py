"""The command lines of the studies."""

import argparse
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from ca_ros.allocation import ALLOCATORS, Allocator
from ca_ros.arguments import HelpFormatter
from ca_ros.errors import CaRosError, message
from ca_ros.figures import add_options
from ca_ros.studies.cases import Case, methods_of
from ca_ros.studies.comparison import FOR_COMPARISON

Study = Callable[[argparse.Namespace], tuple[pd.DataFrame, str]]
"""Does a study; returns its rows, and what its command prints."""


def parser(prog: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the options that the studies share."""
    made = argparse.ArgumentParser(prog=prog, description=description)
    made.formatter_class = HelpFormatter
    add = made.add_argument
    add('--vehicle', default='hexarotor', help='a shipped vehicle or a YAML file')
    add('--methods', default='paper', metavar='A,B',
        help=f'what to compare: {", ".join([*ALLOCATORS, *FOR_COMPARISON])}, module:Class for a '
        f"method of your own; paper for the paper's four, all for the first {len(ALLOCATORS)}")
    add('-p', '--param', action='append', default=[], metavar='NAME:=VALUE',
        help="a parameter other than in the vehicle's file, as with ROS; may be repeated")
    add('--out', type=Path, default=Path('.'), metavar='DIR', help='folder of the results')
    add_options(made)
    return made


def case_of(
    options: argparse.Namespace, flying: bool = False
) -> tuple[Case, dict[str, Allocator]]:
    """Return case and allocators of a command line.

    Methods of a set such as ``all`` that do not apply to a problem without a vehicle, or to rotors
    that tilt, are left out, with a note; see `Case.left_out`.  With `flying`, a problem without a
    vehicle is refused.  Raises a CaRosError if the command line is wrong.
    """
    try:
        methods = methods_of(options.methods)
        case = Case.load(options.vehicle, options.param, methods, flying)
        asked = [word.strip() for word in options.methods.split(',')]
        allocators: dict[str, Allocator] = {}
        for method in methods:
            try:
                allocators[method] = case.allocator(method)
            except ValueError as error:
                if method in asked:
                    raise
                case.left_out[method] = str(error)
                print(f'{method} is left out: {error}', file=sys.stderr)
    except ValueError as error:
        raise CaRosError(str(error)) from None
    return case, allocators


def run_command(prog: str, study: Study, options: argparse.Namespace) -> int:
    """Do a study and print its text; return the exit code.

    It is 1 after an error, 130 after Ctrl-C, told in one line each.  Errors in a method of
    the user's own are shown with their traceback.
    """
    # Shells start background processes with SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        print(study(options)[1])
    except (CaRosError, FloatingPointError, OSError) as error:
        print(f'{prog}: {message(error)}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        print(f'{prog}: interrupted{stop}', file=sys.stderr)
        return 130
    return 0


def run_function(
    parse: Callable[[Sequence[str]], argparse.Namespace], study: Study, options: Mapping[str, Any]
) -> pd.DataFrame:
    """Do a study with the options of its command by name; return its rows.

    Without `out` no file is written.  Raises a ValueError if an option is wrong.
    """
    words, complaint = list[str](), StringIO()
    for name, value in options.items():
        flag = f'--{name.replace("_", "-")}'
        several = [*value] if isinstance(value, (list, tuple)) else [value]
        if name != 'param' and len(several) > 1:
            several = [','.join(map(str, several))]
        words += [flag if each is True else f'{flag}={each}' for each in several]
    with TemporaryDirectory() as folder:
        try:
            with redirect_stderr(complaint):
                found = parse([*words, *([] if 'out' in options else [f'--out={folder}'])])
        except SystemExit:
            raise ValueError(complaint.getvalue().strip().rpartition('error: ')[2]) from None
        if 'out' not in options:
            found.figures = None
        return study(found)[0]
