"""``ca_ros compare``: what changes between two vehicles."""

import argparse
from collections.abc import Iterator
from functools import partial

from ca_ros.arguments import command
from ca_ros.problem.audit import audit
from ca_ros.problem.controllability import lift
from ca_ros.problem.diagnosis import diagnose
from ca_ros.studies.sets.audit_command import cases_of, ends, margin
from ca_ros.vehicle.settings import unit
from ca_ros.vehicle.vehicle import Vehicle


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument('before', help='a shipped vehicle or a parameter file')
    parser.add_argument('after', help='the same')
    parser.add_argument('--all', action='store_true', help='also the rows that do not change')


def run(options: argparse.Namespace) -> None:
    """Print the table."""
    before, after = (dict(_rows(Vehicle.load(name))) for name in (options.before, options.after))
    names = [*before, *(name for name in after if name not in before)]
    rows = [['', options.before, options.after]]
    for name in names:
        pair = [before.get(name, '-'), after.get(name, '-')]
        if options.all or pair[0] != pair[1]:
            rows.append([name, *pair])
    if len(rows) == 1:
        print(f'{options.after} has the same ranges, margins and losses as {options.before}')
        return
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        words = [f'{word:{width}}' for word, width in zip(row, widths, strict=True)]
        print('  '.join(words).rstrip())


def _rows(vehicle: Vehicle) -> Iterator[tuple[str, str]]:
    """Yield the rows of a vehicle: what is shown, and its value in words."""
    yield 'rotors', str(vehicle.n)
    yield 'mass [kg]', f'{vehicle.mass:.4g}'
    if 'thrust' in vehicle.axes:
        yield 'lift [kg]', '{:.3g} to {:.3g}'.format(*lift(vehicle))
    cases = {name: audit(case) for name, case in cases_of(vehicle).items()}
    report = cases.pop('none')
    yield 'hover margin [N, N m]', margin(report)
    for axis in vehicle.axes:
        yield f'{axis} [{unit(axis)}]', ends(report, axis)
    for name, left in cases.items():
        words = f'lost: {", ".join(left.lost) or "-"}; margin {margin(left)}'
        yield f'without {name}', words if left.keeps_hovering else left.why_no_hover()
    for cause in diagnose(vehicle):
        yield f'probably wrong: {cause.kind}', cause.text


main = partial(command, 'compare', add_options, run)
