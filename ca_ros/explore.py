"""``ca_ros explore``: the explorer, one page for a browser, with the kernel in it."""

import argparse
import json
import sys
from functools import partial
from pathlib import Path

import numpy as np

from ca_ros.arguments import command
from ca_ros.input_files import read_text
from ca_ros.problem.audit import audit
from ca_ros.settings import ParameterError
from ca_ros.vehicle.files import find, read
from ca_ros.vehicle.vehicle import Vehicle

PAGE = Path(__file__).with_name('explorer.html')  # the page, which ``make explorer`` builds

NO_VEHICLE = '<script type="application/json" id="start">{}</script>'

TABLES = 'speeds', 'thrusts', 'throttles'  # of rotors.thrust_curve, which the page does not read

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

    Raises a ParameterError if the page was not built, the vehicle's file is wrong, its rotors
    tilt, or its thrust curve is a table.
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
    given = read(vehicle)
    for name in (f'rotors.thrust_curve.{table}' for table in TABLES):
        if np.any(given.get(name, 0.0)):
            raise ParameterError(
                f'{vehicle}: {name}: the explorer does not read tables of thrust; expected '
                'rotors.thrust_curve.polynomial, or no curve'
            )
    file = find(vehicle)
    start = json.dumps({file.stem: read_text(file)}).replace('</', '<\\/')
    return text.replace(NO_VEHICLE, NO_VEHICLE.replace('{}', start))


main = partial(command, 'explore', add_options, run)
