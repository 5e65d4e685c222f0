"""``ca_ros audit``: which axes a vehicle's rotors can control, after each loss, and what is wrong.

The exit code is 0, 1 if the nodes would refuse the vehicle, and 3 if they would accept it, but
something is probably wrong in its file.
"""

import argparse
import json
from collections.abc import Sequence
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np

from ca_ros.arguments import command
from ca_ros.parameter_files import AllocatorSettings, ControllerNodeSettings, load_for
from ca_ros.problem.audit import VehicleAudit, accept, audit
from ca_ros.problem.controllability import lift
from ca_ros.settings import ParameterError
from ca_ros.vehicle.failure_words import read_failures, with_failures
from ca_ros.vehicle.settings import unit
from ca_ros.vehicle.vehicle import Vehicle

PROBABLY_WRONG = 3  # the exit code


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add('vehicle', help='a shipped vehicle or a parameter file')
    add('--fail', action='append', metavar='ROTOR[=HEALTH],...',
        help='rotors that are lost already, counted from 1, or weaker; all=0.8: each at 80 %%')
    add('--format', choices=('text', 'json'), default='text', help='(default: %(default)s)')


def run(options: argparse.Namespace) -> int:
    """Print the audit; return the exit code.

    Raises a `ParameterError` if the nodes would refuse the vehicle.
    """
    load_for(AllocatorSettings, options.vehicle)
    vehicle = Vehicle.load(options.vehicle)
    if options.fail is not None:
        try:
            vehicle = with_failures(vehicle, read_failures(','.join(options.fail)))
        except ParameterError as error:
            raise ParameterError(f'--fail: {error}') from None
    report = audit(vehicle)
    if options.format == 'json':
        print(json.dumps(as_json(options.vehicle, report), indent=2))
        accept(vehicle)
        return PROBABLY_WRONG if report.causes else 0
    rotors = f'{vehicle.n} rotors'
    if 'thrust' in vehicle.axes:
        rotors += ' that lift {:.3g} to {:.3g} kg'.format(*lift(vehicle))
    print(f'{options.vehicle}: {vehicle.mass:.3g} kg on {rotors}\n\n{table(vehicle)}')
    # The error of a vehicle that is refused has the causes.
    refused = vehicle.lost_axes == 'refuse' and not report.sound
    warnings = report.remarks if refused else report.warnings
    for line in [*remains(report, options.vehicle), *(f'warning: {w}' for w in warnings)]:
        print(line)
    accept(vehicle)
    return PROBABLY_WRONG if report.causes else 0


def as_json(name: str, report: VehicleAudit) -> dict[str, Any]:
    """Return an audit as content of JSON; null where there is no number."""
    vehicle = report.full.vehicle
    failures = {}
    for rotor, case in cases_of(vehicle).items():
        each = audit(case)
        failures[rotor] = {
            'lost_axes': each.lost, 'hovers': each.keeps_hovering,
            'ranges': {axis: each.authority.get(axis) for axis in vehicle.axes}}
    return {
        'vehicle': name, 'failures': failures,
        'causes': [
            {'kind': each.kind, 'rotors': each.rotors, 'text': each.text}
            for each in report.causes],
        'warnings': report.remarks}


def remains(report: VehicleAudit, file: str) -> list[str]:
    """Return what hover leaves of the forces along x and y, and what follows; empty if nothing."""
    force = report.side_force
    if not force.any():
        return []
    settings = load_for(ControllerNodeSettings, file).controller
    stiffness = float(np.min(np.broadcast_to(settings.position_stiffness, 3)[:2]))
    size = float(np.linalg.norm(force))
    away = size / (report.vehicle.mass * stiffness)
    named = ', '.join(
        f'{axis} {value:+.3g}' for axis, value in zip(('x', 'y'), force, strict=True))
    gain = settings.integral_gain
    follows = (
        f'controller.integral_gain {gain:g} 1/s compensates it' if gain else
        f'without controller.integral_gain the vehicle hovers up to {away:.2g} m beside its '
        'waypoint, F / (m position_stiffness)'
    )
    return [f'hover leaves a side force of {size:.3g} N ({named}): {follows}']


def table(vehicle: Vehicle) -> str:
    """Return a table of the controllable axes, of the vehicle as it is and without each rotor."""
    cases = cases_of(vehicle)
    rows = [
        ['failed', 'lost axes', 'hover margin [N, N m]'],
        *([failed, *_row(audit(case), vehicle.axes)] for failed, case in cases.items()),
    ]
    rows[0] += [f'{axis} [{unit(axis)}]' for axis in vehicle.axes]
    # The last entry of a row may be a sentence, and does not widen its column.
    columns = zip_longest(*(row[:-1] for row in rows), fillvalue='')
    widths = [max(map(len, column)) for column in columns]
    return '\n'.join(
        '  '.join(f'{word:{width}}' for word, width in zip(row[:-1], widths, strict=False))
        + f'  {row[-1]}' for row in rows
    )


def cases_of(vehicle: Vehicle) -> dict[str, Vehicle]:
    """Return the vehicle as it is and without each of its rotors, by name."""
    cases = {'none': vehicle}
    for rotor in (np.flatnonzero(vehicle.health > 0.0) + 1).tolist():
        cases[f'rotor {rotor}'] = with_failures(vehicle, {str(rotor): 0.0})
    return cases


def _row(report: VehicleAudit, axes: Sequence[str]) -> list[str]:
    lost = ', '.join(report.lost) or '-'
    if not report.keeps_hovering:
        return [lost, report.why_no_hover()]
    return [lost, margin(report), *(ends(report, axis) for axis in axes)]


def margin(report: VehicleAudit) -> str:
    """Return the hover margin in words [N, N m]; of a vehicle that cannot hover '-'."""
    if not report.keeps_hovering:
        return '-'
    try:
        return f'{report.controllable_hover_margin:.3g}'
    except ValueError:
        return 'too many rotors'


def ends(report: VehicleAudit, axis: str) -> str:
    """Return the range of an axis around hover in words; '-' without one."""
    return report.ends(axis) if axis in report.authority else '-'


main = partial(command, 'audit', add_options, run)
