"""``python -m ca_ros audit``: what a vehicle's rotors can command, and after each loss."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import TypeVar

import numpy as np

from ca_ros.nodes.parameters import load
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
    parser.add_argument('vehicle', help='a shipped vehicle or a parameter file')
    parser.add_argument(
        '--fail',
        metavar='ROTOR,...',
        default=argparse.SUPPRESS,
        help='rotors that are lost already, counted from 1',
    )
    parser.add_argument(
        '--health',
        metavar='SHARE,...',
        default=argparse.SUPPRESS,
        help="health of each rotor in [0, 1], or one for all (default: the file's)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the audit; return the exit code."""
    try:
        load(options.vehicle)
        vehicle = Vehicle.load(options.vehicle)
        if 'health' in options:
            health = _numbers('--health', options.health, float)
            vehicle = vehicle.with_health(health[0] if len(health) == 1 else health)
        if 'fail' in options:
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
    health = np.array(vehicle.health)
    for rotor in rotors:
        if not 1 <= rotor <= vehicle.n:
            raise ParameterError(f'--fail: expected rotors 1 to {vehicle.n}, got {rotor}')
        health[rotor - 1] = 0.0
    return vehicle.with_health(health)


def table(vehicle: Vehicle) -> str:
    """Return a table of what a vehicle can command, as it is and without each of its rotors."""
    rows = [
        (
            'failed',
            'lost axes',
            'hover margin [N, N m]',
            *(f'{axis} [{unit(axis)}]' for axis in vehicle.axes),
        ),
        ('none', *_row(audit(vehicle), vehicle.axes)),
    ]
    rows += [
        (f'rotor {i + 1}', *_row(audit(without(vehicle, [i + 1])), vehicle.axes))
        for i in np.flatnonzero(vehicle.health > 0.0).tolist()
    ]
    # The last entry of a row may be a sentence, and does not widen its column.
    padded = [row[:-1] for row in rows]
    widths = [max(len(word) for word in column) for column in zip_longest(*padded, fillvalue='')]
    return '\n'.join(
        '  '.join([f'{word:{width}}' for word, width in zip(row, widths, strict=False)] + [last])
        for row, last in zip(padded, (row[-1] for row in rows), strict=True)
    )


def _row(report: Audit, axes: Sequence[str]) -> tuple[str, ...]:
    lost = ', '.join(report.lost) or '-'
    if not report.keeps_hovering:
        return lost, report.why_no_hover()
    ends = (report.ends(axis) if axis in report.authority else '-' for axis in axes)
    return lost, _margin(report), *ends


def _margin(report: Audit) -> str:
    try:
        return f'{report.kept_hover_margin:.3g}'
    except ValueError:
        return 'too many rotors'


def _numbers(option: str, text: str, kind: Callable[[str], Number]) -> list[Number]:
    try:
        return [kind(word) for word in text.split(',')]
    except ValueError:
        raise ParameterError(
            f'{option}: expected numbers separated by commas, got {text!r}'
        ) from None
