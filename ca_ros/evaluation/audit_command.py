"""``python -m ca_ros audit``: what a vehicle's rotors can command, and after each loss."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import TypeVar

import numpy as np

from ca_ros.nodes.parameters import ALLOCATOR, load
from ca_ros.problem.audit import Audit, accept, audit
from ca_ros.problem.commandable import lift, unit
from ca_ros.schema import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

Number = TypeVar('Number', int, float)


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to those of ``python -m ca_ros``."""
    about = "what a vehicle's rotors can command, and what is left after the loss of each"
    parser = commands.add_parser(
        'audit',
        help=about,
        description=f'Say {about}. The exit code is 1 if the nodes would refuse the vehicle.',
    )
    add = parser.add_argument
    add('vehicle', help='a shipped vehicle or a parameter file')
    add('--fail', metavar='ROTOR,...', help='rotors that are lost already, counted from 1')
    health = "health of each rotor in [0, 1], or one for all (default: the file's)"
    add('--health', metavar='SHARE,...', help=health)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the audit; return the exit code."""
    try:
        load(options.vehicle, table=ALLOCATOR)
        vehicle = Vehicle.load(options.vehicle)
        if options.health is not None:
            health = _numbers('--health', options.health, float)
            vehicle = vehicle.with_health(health[0] if len(health) == 1 else health)
        if options.fail is not None:
            vehicle = without(vehicle, _numbers('--fail', options.fail, int))
        least, most = lift(vehicle)
        print(
            f'{options.vehicle}: {vehicle.mass:.3g} kg on {vehicle.n} rotors '
            f'that lift {least:.3g} to {most:.3g} kg\n'
        )
        print(table(vehicle))
        accept(vehicle)
    except ParameterError as error:
        sys.stdout.flush()
        print(f'ca_ros audit: {error}', file=sys.stderr)
        return 1
    return 0


def without(vehicle: Vehicle, rotors: Sequence[int]) -> Vehicle:
    """Return a vehicle that has lost some rotors, counted from 1.

    Raises
    ------
    ParameterError
        If there is no such rotor.
    """
    for rotor in rotors:
        if not 1 <= rotor <= vehicle.n:
            raise ParameterError(f'--fail: expected rotors 1 to {vehicle.n}, got {rotor}')
    lost = np.isin(np.arange(1, vehicle.n + 1), rotors)
    return vehicle.with_health(np.where(lost, 0.0, vehicle.health))


def table(vehicle: Vehicle) -> str:
    """Return a table of what a vehicle can command, as it is and without each of its rotors."""
    left = np.flatnonzero(vehicle.health > 0.0) + 1
    cases = {'none': vehicle, **{f'rotor {i}': without(vehicle, [i]) for i in left.tolist()}}
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
        + f'  {row[-1]}'
        for row in rows
    )


def _row(report: Audit, axes: Sequence[str]) -> list[str]:
    lost = ', '.join(report.lost) or '-'
    if not report.keeps_hovering:
        return [lost, report.why_no_hover()]
    try:
        margin = f'{report.kept_hover_margin:.3g}'
    except ValueError:
        margin = 'too many rotors'
    ends = (report.ends(axis) if axis in report.authority else '-' for axis in axes)
    return [lost, margin, *ends]


def _numbers(option: str, text: str, kind: Callable[[str], Number]) -> list[Number]:
    try:
        return [kind(word) for word in text.split(',')]
    except ValueError:
        raise ParameterError(
            f'{option}: expected numbers separated by commas, got {text!r}'
        ) from None
