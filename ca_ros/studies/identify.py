"""``ca_ros identify``: lag, delay and inertia of a vehicle from recorded flights."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from ca_ros.arguments import add_recording, command
from ca_ros.input_files import read_text
from ca_ros.settings import ParameterError
from ca_ros.vehicle.files import find
from ca_ros.vehicle.formats.edited_yaml import with_values
from ca_ros.vehicle.formats.recording import read_recording
from ca_ros.vehicle.plausibility import frozen, gaps
from ca_ros.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from ca_ros.vehicle.identification import Identification

FAR = 10.0  # greatest ratio between what is fitted and the file that gets no warning


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add('flights', nargs='+', type=Path, metavar='FLIGHT',
        help='CSV, npz, ULog or a bag; with several, R^2 is that of each flight by the others')
    add('vehicle', help='a shipped vehicle or a parameter file, with mass, arms and a first guess '
        'of the inertia')
    add_recording(parser)
    add('--measured', action='store_true', help='use speed_measured_* instead of command_*')
    add('--out', type=Path, metavar='YAML', help='write a copy of the file with what is sure')


def run(options: argparse.Namespace) -> None:
    """Identify, print and write."""
    # SciPy's signal processing takes a second to import.
    from ca_ros.vehicle.identification import identify, speeds_of

    vehicle = Vehicle.load(options.vehicle)
    flights = [read_recording(file, vehicle.n, options.frame) for file in options.flights]
    if not options.measured:
        flights = [speeds_of(vehicle, flight, options.throttle) for flight in flights]
    found = identify(vehicle, flights, options.measured)
    print('\n'.join(report(found)), flush=True)
    missing = [
        f'{flight.name}: {names}: nothing from {begin:.2f} to {end:.2f} s'
        for flight in flights for names, begin, end in gaps(flight, ('command', 'gyro'))]
    source = 'speed' if options.measured else 'command'
    still = [
        f'{flight.name}: {words}' for flight in flights
        for words in frozen(
            vehicle, flight, [name for name in ('gyro', 'acc') if name in flight.times], source)]
    for warning in [*missing, *still, *warnings(found)]:
        print(f'ca_ros identify: warning: {warning}', file=sys.stderr)
    if not found.parameters:
        why = 'a sign is wrong' if found.wrong_signs else 'no parameter is sure'
        raise ParameterError(f'{why}: no parameter changes' + ', and no file is written' * (
            options.out is not None))
    if options.out is not None:
        file = find(options.vehicle)
        text = read_text(file)
        try:
            options.out.write_text(with_values(text, found.parameters), encoding='utf-8')
        except ParameterError as error:
            raise ParameterError(f'{file}: {error}') from None
        print(f'written: {options.out}')


def report(found: Identification) -> list[str]:
    """Return the estimates, one a line, and the parameters that are sure."""
    lines = ['value [95 % interval]; R^2 on flights or blocks that were not used for the fit']
    rows = {'lag': found.lag, 'delay': found.delay, 'lag and delay': found.total}
    for name, each in found.effectiveness.items():
        rows[f'{name}, acceleration over that of the file'] = each
    rows['inertia of a rotor over that of the vehicle about z'] = found.kick
    lines += [
        f'{name}: {each}' + f'; R^2 {each.r2:.2f}' * isfinite(each.r2)
        for name, each in rows.items()]
    lines.append(f'white noise of the gyro: {found.noise:.3g} rad/s')
    lines.append('sure, as parameters:')
    lines += [f'    {name}: {value}' for name, value in found.parameters.items()]
    lines += ['not sure, so they stay:'] * bool(found.left)
    return [*lines, *(f'    {name}: {why}' for name, why in found.left.items())]


def warnings(found: Identification) -> list[str]:
    """Return the ratios that are far from 1, in words."""
    return [
        f'{name}: {each.value:.3g} times the acceleration of the file: expected 1 / {FAR:g} to '
        f'{FAR:g}; check the units of commands and gyro [rad/s], mass and first guess'
        for name, each in found.effectiveness.items()
        if not each.fault and not 1.0 / FAR <= each.value <= FAR
    ]


main = partial(command, 'identify', add_options, run)
