"""The bringup script: starts the three nodes as processes, flies, and reports."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from itertools import count
from pathlib import Path

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from rclpy.validate_namespace import validate_namespace

from ca_ros.bringup.bag import Bag
from ca_ros.bringup.options import commands, parse
from ca_ros.bringup.session import Flown, Session
from ca_ros.bringup.summary import summarize
from ca_ros.errors import CaRosError
from ca_ros.flight.figures import save
from ca_ros.flight.plots import draw_flight
from ca_ros.flight.trajectory import trajectory_of
from ca_ros.nodes.executable import in_one_line
from ca_ros.nodes.rclpy_internals import RCLError
from ca_ros.process.processes import note_signals
from ca_ros.vehicle.vehicle import Vehicle


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; return 0 if the waypoint was reached."""
    # Shared memory that a killed process leaves behind delays the next start by seconds.
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    # The matrices are too small for the threads of BLAS.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    options = parse(sys.argv[1:] if argv is None else argv)
    if options.out is not None:
        return _bringup(options)
    try:
        options.out = _new_folder()
    except OSError as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 1
    try:
        return _bringup(options)
    finally:
        # This fails if the folder holds a flight.
        with suppress(OSError):
            options.out.rmdir()


def _new_folder() -> Path:
    """Create a new folder in the current folder."""
    name = f'flight_{datetime.now():%Y-%m-%d_%H-%M-%S}'
    for i in count(1):
        folder = Path(name if i == 1 else f'{name}_{i}')
        with suppress(FileExistsError):
            folder.mkdir()
            break
    return folder


def _bringup(options: argparse.Namespace) -> int:
    interrupts = note_signals()
    try:
        nodes, bag = _prepare(options)
    except InvalidNamespaceException:
        print(f'bringup: --namespace: {options.namespace} is not a namespace', file=sys.stderr)
        return 1
    except RCLError as error:
        print(f'bringup: {in_one_line(error)}', file=sys.stderr)
        return 1
    except (CaRosError, OSError, ValueError) as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 1
    try:
        flown = Session(options, nodes, interrupts, bag).fly(options.goals)
        summary, reached = summarize(flown, options.goals.last, options.failures)
        print(summary)
        _write(options, flown)
    except (CaRosError, OSError) as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 128 + interrupts[0] if interrupts else 1
    finally:
        try_shutdown()
    if bag:
        print(f'  bag           {bag}')
    return 0 if reached else 1


def _prepare(options: argparse.Namespace) -> tuple[dict[str, list[str]], Bag | None]:
    """Return the commands of the nodes, and the bag; find faults before the flight."""
    options.goals = trajectory_of(options)
    nodes = commands(options)
    options.out.mkdir(parents=True, exist_ok=True)
    if not os.access(options.out, os.W_OK | os.X_OK):
        raise PermissionError(f'--out: {options.out} cannot be written to')
    validate_namespace(options.namespace)
    rclpy.init(
        args=['--ros-args', '--enclave', f'{options.namespace.rstrip("/")}/recorder'],
        signal_handler_options=SignalHandlerOptions.NO,
    )
    return nodes, Bag(options.bag) if options.bag else None


def _write(options: argparse.Namespace, flown: Flown) -> None:
    """Write flight.csv and, if matplotlib is installed, the plot."""
    files = [options.out / 'flight.csv']
    flown.flight.write_csv(files[0])
    try:
        vehicle = Vehicle.from_parameters(flown.parameters)
        figure = draw_flight(flown.flight, vehicle, options.goals, options.figure_width)
        files += save(figure, options.out / 'flight', options.figures)
    except ModuleNotFoundError as missing:
        print(f"  no plot       needs {missing.name}: pip install 'ca_ros[studies]'")
    print(f'  written       {", ".join(map(str, files))}')


if __name__ == '__main__':
    raise SystemExit(main())
