"""The bringup script: starts the three nodes as processes, flies, and reports."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from rclpy.validate_namespace import validate_namespace

from ca_ros.bringup.bag import Bag
from ca_ros.bringup.flight import EndedEarlyError, Flown, Session
from ca_ros.bringup.options import Plan, parse
from ca_ros.bringup.report import Shares, draw_flight, shares_of, summarize
from ca_ros.errors import CaRosError, message
from ca_ros.figures import save
from ca_ros.nodes.executable import in_one_line
from ca_ros.nodes.rclpy_internals import RCLError
from ca_ros.process.processes import FAST_DDS, note_signals


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; return 0 if the waypoint was reached."""
    # The matrices are too small for the threads of BLAS.
    for name, value in {**FAST_DDS, 'OPENBLAS_NUM_THREADS': '1'}.items():
        os.environ.setdefault(name, value)
    interrupts: list[int] = []
    new = None
    try:
        plan = parse(sys.argv[1:] if argv is None else argv)
        out = plan.out or (new := _new_folder())
        interrupts = note_signals()
        return _bringup(plan, out, interrupts)
    except (CaRosError, OSError, RCLError) as error:
        text = in_one_line(error) if isinstance(error, RCLError) else message(error)
        print(f'bringup: {text}', file=sys.stderr)
        return 128 + interrupts[0] if interrupts else 1
    finally:
        try_shutdown()
        if new:
            # A folder that holds a flight is not empty, and stays.
            with suppress(OSError):
                new.rmdir()


def _new_folder() -> Path:
    """Create a new folder in the current folder."""
    name = f'flight_{datetime.now():%Y-%m-%d_%H-%M-%S}'
    for i in count(1):
        folder = Path(name if i == 1 else f'{name}_{i}')
        with suppress(FileExistsError):
            folder.mkdir()
            break
    return folder


def _bringup(plan: Plan, out: Path, interrupts: list[int]) -> int:
    nodes, bag = _prepare(plan, out)
    try:
        flown = Session(plan, nodes, interrupts, bag).fly()
    except EndedEarlyError as error:
        write_results(plan, out, error.flown)
        raise
    served = shares_of(flown)
    summary, reached = summarize(flown, plan.trajectory.last, served, plan.tolerance)
    print(summary)
    write_results(plan, out, flown, served)
    if bag:
        print(f'  bag           {bag}')
    return 0 if reached else 1


def _prepare(plan: Plan, out: Path) -> tuple[dict[str, list[str]], Bag | None]:
    """Return the commands of the nodes, and the bag; find faults before the flight."""
    nodes = plan.commands()
    with naming(out):
        out.mkdir(parents=True, exist_ok=True)
    if not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError(f'--out: {out} cannot be written to')
    words = ['--ros-args', '--enclave', f'{plan.namespace.rstrip("/")}/recorder']
    try:
        validate_namespace(plan.namespace)
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except InvalidNamespaceException:
        raise CaRosError(f'--namespace: {plan.namespace} is not a namespace') from None
    except RCLError as error:
        raise CaRosError(in_one_line(error)) from None
    return nodes, Bag(plan.bag) if plan.bag else None


def write_results(plan: Plan, out: Path, flown: Flown, served: Shares | None = None) -> None:
    """Write flight.csv and, if matplotlib is installed, the plot."""
    files = [out / 'flight.csv']
    with naming(files[0]):
        flown.flight.write_csv(files[0])
    try:
        figure = None
        moments = flown.failures.moments(flown.detected.values())
        for form in plan.figures:
            figure = figure or draw_flight(
                flown.flight, flown.vehicle, plan.trajectory, plan.figure_width, moments, served)
            with naming(out / f'flight.{form}'):
                files += save(figure, out / 'flight', [form])
    except ModuleNotFoundError as missing:
        print(f"  no plot       needs {missing.name}: pip install 'ca_ros[studies]'")
    print(f'  written       {", ".join(map(str, files))}')


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in an OSError; a full disk, for instance, has none."""
    try:
        yield
    except OSError as error:
        raise OSError(message(error, path)) from None
