"""The bringup script: three nodes as processes, a flight, and what came of it."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from tqdm import tqdm

from ca_ros.controller import Waypoint
from ca_ros.figures import draw_flight
from ca_ros.flight import Flight
from ca_ros.nodes.recorder import Recorder
from ca_ros.nodes.vehicle_node import split
from ca_ros.parameters import METHODS, ParameterError, find
from ca_ros.processes import Processes
from ca_ros.vehicle import Vehicle

NODES = ('controller', 'allocator', 'simulator')
"""In the order in which they end: no command may come from a loop that is half stopped."""

POSITION_TOLERANCE, HEADING_TOLERANCE = 0.02, math.radians(0.5)
START_TIMEOUT = 30.0


class Stopped(Exception):
    """The flight was ended before its time."""


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; return 0 if the waypoint was reached."""
    # Segments in shared memory, left behind by a killed process, would delay the next start by
    # seconds.
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    options = _parse(sys.argv[1:] if argv is None else argv)
    interrupts: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: interrupts.append(received))
    try:
        vehicle = Vehicle.load(options.params_file or options.vehicle)
        options.out.mkdir(parents=True, exist_ok=True)
        validate_namespace(options.namespace)
    except InvalidNamespaceException:
        print(f'bringup: --namespace: {options.namespace} is not a namespace', file=sys.stderr)
        return 1
    except (ParameterError, OSError) as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 1
    waypoint = Waypoint.of(*options.waypoint, math.radians(options.heading))
    try:
        flight, wall = _fly(options, waypoint, interrupts)
    except Stopped as stopped:
        print(f'bringup: {stopped}', file=sys.stderr)
        return 128 + interrupts[0] if interrupts else 1
    flight.write_csv(options.out / 'flight.csv')
    draw_flight(options.out / 'flight.png', flight, vehicle, waypoint)
    return 0 if _report(options, vehicle, waypoint, flight, wall) else 1


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='bringup',
        description='Start controller, allocator and simulator, fly to a waypoint, and report.',
        epilog='ROS arguments after --ros-args go to the three nodes.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        '--method',
        choices=METHODS,
        help="allocation method (default: the parameter file's)",
        default=argparse.SUPPRESS,
    )
    parser.add_argument(
        '--mode',
        choices=('realtime', 'lockstep'),
        default='realtime',
        help='follow the clock, or step as fast as possible',
    )
    parser.add_argument('--duration', type=_positive, default=10.0, help='time of flight [s]')
    parser.add_argument(
        '--waypoint',
        type=_finite,
        nargs=3,
        default=(1.0, 1.0, 1.0),
        metavar=('X', 'Y', 'Z'),
        help='position to fly to [m]',
    )
    parser.add_argument(
        '--heading', type=_finite, default=45.0, help='heading to turn to [degrees]'
    )
    parser.add_argument(
        '--out', type=Path, default=Path('.'), metavar='DIR', help='folder of the results'
    )
    parser.add_argument(
        '--vehicle', default='hexarotor', help='a shipped vehicle or a parameter file'
    )
    parser.add_argument(
        '--params-file', metavar='FILE', help='the same, by path alone', default=argparse.SUPPRESS
    )
    parser.add_argument(
        '--namespace', default='/', help='namespace of the nodes, for instance /uav1'
    )
    own, ros = split(argv)
    options = parser.parse_args(own)
    options.ros = ros
    options.method = getattr(options, 'method', None)
    options.params_file = getattr(options, 'params_file', None)
    if not options.namespace.startswith('/'):
        options.namespace = f'/{options.namespace}'
    return options


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f'{text} is not a finite number')
    return number


def _positive(text: str) -> float:
    number = _finite(text)
    if number <= 0.0:
        raise argparse.ArgumentTypeError(f'{text} is not positive')
    return number


def _commands(options: argparse.Namespace) -> dict[str, list[str]]:
    arguments = [
        '--ros-args',
        '--params-file',
        str(find(options.params_file or options.vehicle).resolve()),
        '-p',
        f'mode:={options.mode}',
        '-r',
        f'__ns:={options.namespace}',
    ]
    if options.method:
        arguments += ['-p', f'allocation.method:={options.method}']
    arguments += ['--', *options.ros]
    return {name: [sys.executable, '-m', f'ca_ros.nodes.{name}', *arguments] for name in NODES}


def _fly(
    options: argparse.Namespace, waypoint: Waypoint, interrupts: list[int]
) -> tuple[Flight, float]:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    recorder = Recorder(options.namespace)
    executor = SingleThreadedExecutor()
    executor.add_node(recorder)
    try:
        with Processes(_commands(options)) as processes:

            def spin() -> None:
                executor.spin_once(timeout_sec=0.1)
                if interrupts:
                    raise Stopped(f'interrupted by {signal.Signals(interrupts[0]).name}')
                if ended := processes.ended():
                    raise Stopped(
                        ', '.join(
                            f'the {name} ended with exit code {code}'
                            for name, code in ended.items()
                        )
                    )

            deadline = time.monotonic() + START_TIMEOUT
            while missing := recorder.missing():
                spin()
                if time.monotonic() > deadline:
                    raise Stopped(
                        f'after {START_TIMEOUT:g} s there is nobody on {", ".join(missing)}'
                    )
            recorder.send(waypoint)
            began = time.monotonic()
            with tqdm(
                total=options.duration,
                unit='s',
                desc='flight',
                disable=not sys.stderr.isatty(),
                bar_format='{l_bar}{bar}| {n:.1f}/{total:.1f} s',
            ) as bar:
                progress, last = 0.0, time.monotonic()
                while progress < options.duration:
                    spin()
                    if recorder.elapsed > progress:
                        bar.update(min(recorder.elapsed, options.duration) - progress)
                        progress, last = recorder.elapsed, time.monotonic()
                    elif time.monotonic() - last > START_TIMEOUT:
                        raise Stopped(
                            f'the flight has stood still at {progress:.2f} s '
                            f'for {START_TIMEOUT:g} s'
                        )
            return recorder.flight(options.duration), time.monotonic() - began
    finally:
        executor.shutdown()
        recorder.destroy_node()
        rclpy.try_shutdown()


def _report(
    options: argparse.Namespace, vehicle: Vehicle, waypoint: Waypoint, flight: Flight, wall: float
) -> bool:
    error, heading_error = flight.position_error(waypoint), flight.heading_error(waypoint)
    reached = error <= POSITION_TOLERANCE and heading_error <= HEADING_TOLERANCE
    speeds = flight.speeds
    inside = bool(((speeds >= vehicle.speed_min) & (speeds <= vehicle.speed_max)).all())
    verdict = 'reached' if reached else 'MISSED'
    print(
        f'flight of {flight.time[-1]:.2f} s ({options.mode}, {len(flight.time)} samples, '
        f'in {wall:.1f} s)\n'
        f'  waypoint      {verdict}: {1e3 * error:.1f} mm and '
        f'{math.degrees(heading_error):.3f} degrees away\n'
        f'  rotor speeds  {", ".join(f"{speed:.1f}" for speed in speeds[-1])} rad/s at the end,\n'
        f'                {speeds.min():.1f} to {speeds.max():.1f} rad/s in flight, '
        f'{"within" if inside else "OUT OF"} bounds\n'
        f'  written       {options.out / "flight.csv"}, {options.out / "flight.png"}'
    )
    return reached


if __name__ == '__main__':
    raise SystemExit(main())
