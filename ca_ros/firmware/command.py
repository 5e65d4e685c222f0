"""The exact allocator of a vehicle, as C99 with golden vectors for a flight controller."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ca_ros.allocation.settings import AllocatedVehicleSettings
from ca_ros.arguments import split
from ca_ros.detection.detector_settings import no_lag
from ca_ros.errors import message
from ca_ros.firmware import worst_case
from ca_ros.firmware.detector import detector_of
from ca_ros.firmware.export import identifier, write
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import DTYPES
from ca_ros.firmware.tilting import firmware_of
from ca_ros.setting_names import check_given
from ca_ros.settings import ParameterError, read, table
from ca_ros.vehicle import files
from ca_ros.vehicle.vehicle import Vehicle


def main(argv: Sequence[str] | None = None) -> int:
    """Export a vehicle; return the exit code."""
    options = _parse(split(sys.argv[1:] if argv is None else argv)[0])
    try:
        vehicle = Vehicle.load(options.vehicle)
        given = files.read(options.vehicle)
        settings = checked(given)
        name = identifier(settings.vehicle.name)
        faults = faults_of(vehicle, options.faults)
        firmware = firmware_of(faults, settings.allocation, options.precision)
        detector = detector_of(vehicle, given) if options.detector else None
        if detector and (text := no_lag(given)):
            print(f'firmware: warning: {text}', file=sys.stderr)
        if options.worst_case and not firmware.has_margin:
            raise ParameterError('--worst-case: rotors that tilt have another kernel')
        worst = worst_case.found(firmware) if options.worst_case else None
        write(firmware, name, options.out, detector, worst)
    except (ValueError, OSError) as error:
        text = message(error).removeprefix(f'{options.vehicle}: ')
        print(f'firmware: {options.vehicle}: {text}', file=sys.stderr)
        return 1
    print(
        f'written: {name} with {len(faults) - 1} faults, in {options.precision} precision, in '
        f'{options.out}\n`make -C {options.out}` compiles and checks it'
    )
    return 0


def checked(given: Mapping[str, Any]) -> AllocatedVehicleSettings:
    """Return the settings of the vehicle and of its allocation.

    Raises a ParameterError if one of them is wrong.
    """
    ours = {name: value for name, value in given.items() if name.startswith('allocation.')}
    check_given(ours, table(AllocatedVehicleSettings))
    return read(AllocatedVehicleSettings, given)


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='firmware',
        description='Write the exact allocator of a vehicle as C99 for a flight controller: the '
        "kernel, the vehicle's constants, golden vectors, a Makefile and a README.",
    )
    add = parser.add_argument
    add('--vehicle', required=True, help='a shipped vehicle or a YAML file')
    add('--out', type=Path, required=True, metavar='DIR', help='a folder, new or empty')
    kinds = tuple(DTYPES)
    add('--precision', choices=kinds, default='single', help='default: single')
    add('--faults', nargs='+', default=['single'], metavar='FAULT',
        help='what can be announced in flight: none; single, the loss of each rotor and of '
        'one of each coaxial pair (default); pairs, the loss of each two rotors; or, for each '
        'fault, the rotors that are lost or weaker: 1,3=0.4')
    add('--detector', action='store_true', help='with the detector of rotor failures')
    add('--worst-case', action='store_true',
        help='search the wrenches that take longest, and count the instructions of their calls')
    return parser.parse_args(argv)
