"""``ca_ros explore``: the explorer, one page for a browser, with the kernel in it."""

import argparse
import json
import sys
from functools import partial
from pathlib import Path

from ca_ros.arguments import command
from ca_ros.input_files import read_text
from ca_ros.problem.audit import audit
from ca_ros.settings import ParameterError
from ca_ros.vehicle.files import find
from ca_ros.vehicle.vehicle import Vehicle

PAGE = Path(__file__).with_name('explorer.html')  # the page, which ``make explorer`` builds

NO_VEHICLE = '<script type="application/json" id="start">{}</script>'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add('vehicle', nargs='?', help='a shipped vehicle or a parameter file; default: hexarotor')
    add('--out', default='explorer.html', metavar='PAGE', help='default: %(default)s')


def run(options: argparse.Namespace) -> None:
    """Write the page; repeat what the audit finds wrong with the vehicle."""
    Path(options.out).write_text(page(options.vehicle), encoding='utf-8')
    if options.vehicle is not None:
        report = audit(Vehicle.load(options.vehicle))
        for line in [*report.warnings, *([] if report.sound else [f'audit: {report}'])]:
            print(f'ca_ros explore: {line}', file=sys.stderr)
    print(f'Written: {options.out}. Open it in a browser; it needs no network.')


def page(vehicle: str | None = None) -> str:
    """Return the page, which begins with a vehicle.

    Raises a ParameterError if the page was not built, the vehicle's file is wrong, or its rotors
    tilt.
    """
    if not PAGE.is_file():
        raise ParameterError(
            'this installation has no page: run `make explorer` in a clone of the repository '
            '(it needs npm, clang and lld)'
        )
    text = PAGE.read_text(encoding='utf-8')
    if vehicle is None:
        return text
    Vehicle.load(vehicle).servos.refuse('explorer')
    file = find(vehicle)
    start = json.dumps({file.stem: read_text(file)}).replace('</', '<\\/')
    return text.replace(NO_VEHICLE, NO_VEHICLE.replace('{}', start))


main = partial(command, 'explore', add_options, run)
