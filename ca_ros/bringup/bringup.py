"""The bringup script: starts the three nodes as processes, flies, and reports."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from datetime import datetime
from itertools import count
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from rclpy.validate_namespace import validate_namespace

from ca_ros.arrays import Array, BoolArray
from ca_ros.bringup.bag import Bag
from ca_ros.bringup.deadline import Deadline
from ca_ros.bringup.fault_proxy import PREFIX
from ca_ros.bringup.options import commands, options_as_parameters, parse
from ca_ros.bringup.processes import Processes, note_signals
from ca_ros.bringup.recorder import LINKS, Recorder
from ca_ros.bringup.rotor_health import RotorHealth
from ca_ros.errors import CaRosError
from ca_ros.flight.controller import Waypoint
from ca_ros.flight.plots import draw_flight, save
from ca_ros.flight.record import Flight
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.nodes.executable import in_one_line
from ca_ros.nodes.rclpy_internals import RCLError
from ca_ros.problem.audit import audit
from ca_ros.vehicle.vehicle import HEALTH_MIN, Vehicle

POSITION_TOLERANCE, HEADING_TOLERANCE = 0.02, math.radians(0.5)
START_TIMEOUT = 60.0
LOOK_AROUND = 0.5
"""Time to discover other nodes before the start, and between later checks [s]."""


class Stopped(CaRosError):
    """The flight ended early."""


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
        nodes = commands(options)
        options.out.mkdir(parents=True, exist_ok=True)
        # Check this before the flight rather than after it.
        if not os.access(options.out, os.W_OK | os.X_OK):
            raise PermissionError(f'--out: {options.out} cannot be written to')
        validate_namespace(options.namespace)
        rclpy.init(
            args=['--ros-args', '--enclave', f'{options.namespace.rstrip("/")}/recorder'],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        bag = Bag(options.bag) if options.bag else None
    except InvalidNamespaceException:
        print(f'bringup: --namespace: {options.namespace} is not a namespace', file=sys.stderr)
        return 1
    except RCLError as error:
        print(f'bringup: {in_one_line(error)}', file=sys.stderr)
        return 1
    except (CaRosError, OSError, ValueError) as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 1
    x, y, z = options.waypoint
    waypoint = Waypoint.of(x, y, z, math.radians(options.heading))
    try:
        flight, wall, respawned, parameters = _fly(options, nodes, waypoint, interrupts, bag)
    except CaRosError as stopped:
        print(f'bringup: {stopped}', file=sys.stderr)
        return 128 + interrupts[0] if interrupts else 1
    vehicle = Vehicle.from_parameters(parameters)
    reached = _report(options.failures, parameters['mode'], vehicle, waypoint, flight, wall)
    try:
        files = [options.out / 'flight.csv']
        flight.write_csv(files[0])
        figure = draw_flight(flight, vehicle, waypoint)
        files += save(figure, options.out / 'flight', options.figures)
    except ModuleNotFoundError as missing:
        print(f"  no plot       needs {missing.name}: pip install 'ca_ros[studies]'")
    except OSError as error:
        print(f'bringup: {error}', file=sys.stderr)
        return 1
    print(f'  written       {", ".join(map(str, files))}')
    if respawned:
        counts = ', '.join(f'{name} {count}' for name, count in respawned.items())
        print(f'  respawned     {counts}')
    if bag:
        print(f'  bag           {bag}')
    return 0 if reached else 1


def _fly(
    options: argparse.Namespace,
    nodes: Mapping[str, Sequence[str]],
    waypoint: Waypoint,
    interrupts: list[int],
    bag: Bag | None,
) -> tuple[Flight, float, Counter[str], dict[str, Any]]:
    links = [*LINKS]
    if options.faults is not None:
        links += [f'{PREFIX}{topic}' for topic in LINKS]
    recorder = Recorder(links, namespace=options.namespace)
    executor = SingleThreadedExecutor()
    executor.add_node(recorder)

    def check_alone(own: int = 0) -> None:
        if others := recorder.others(own):
            raise Stopped(
                f'other nodes publish on {", ".join(others)} in ROS domain '
                f'{recorder.context.get_domain_id()}: end them, or choose another --namespace or '
                'ROS_DOMAIN_ID (a node that was killed with -9 is gone after 20 s)'
            )

    try:
        began = looked = time.monotonic()
        while time.monotonic() < began + LOOK_AROUND and not interrupts:
            executor.spin_once(timeout_sec=0.05)
        check_alone()
        # The bag closes after the nodes have ended, and so is complete.
        with bag or nullcontext(), Processes(nodes) as processes:
            if bag:
                bag.listen(options.namespace)

            def spin() -> None:
                nonlocal looked
                executor.spin_once(timeout_sec=0.1)
                # Discovery may take 3 s.  After a respawn DDS still lists the killed node.
                if time.monotonic() > looked + LOOK_AROUND and not processes.respawned:
                    looked = time.monotonic()
                    check_alone(own=1)
                recorder.drain()
                if bag:
                    bag.write()
                if interrupts:
                    raise Stopped(f'interrupted by {signal.Signals(interrupts[0]).name}')
                ended = processes.ended()
                respawned = processes.respawn() if options.respawn else {}
                if ended and (not options.respawn or processes.failed):
                    raise Stopped(
                        ', '.join(
                            f'the {name} ended with exit code {code}'
                            for name, code in ended.items()
                        )
                    )
                for name, code in respawned.items():
                    also = ''
                    if name == 'simulator':
                        # The vehicle must rest until the recorder is connected.
                        processes.restart('controller')
                        recorder.restart()
                        also = ', and the controller too: the flight begins anew, from rest'
                    print(
                        f'bringup: the {name} ended with exit code {code} and is started again'
                        f'{also}',
                        file=sys.stderr,
                    )

            def wait(missing: Callable[[], list[str]]) -> None:
                fewest, deadline = inf, Deadline(START_TIMEOUT)
                while topics := missing():
                    spin()
                    if len(topics) < fewest:
                        fewest, deadline = len(topics), Deadline(START_TIMEOUT)
                    elif deadline.passed():
                        raise Stopped(f'after {START_TIMEOUT:g} s no node on {", ".join(topics)}')

            wait(lambda: recorder.missing() + (bag.missing() if bag else []))
            parameters = recorder.parameters
            for name, value in options_as_parameters(options).items():
                if parameters[name] != value:
                    raise Stopped(
                        f'{name} is {parameters[name]}, not {value}: see the ROS arguments'
                    )
            rotors = RotorHealth(recorder, options.failures, parameters)
            wait(rotors.missing)
            rotors.update(None, spin)
            recorder.send(waypoint)
            began = time.monotonic()
            progress, deadline = 0.0, Deadline(START_TIMEOUT)
            while progress < options.duration:
                spin()
                rotors.update(recorder.elapsed_ns, spin)
                if recorder.waiting and not recorder.missing():
                    recorder.send(waypoint)
                if recorder.elapsed != progress:
                    progress, deadline = recorder.elapsed, Deadline(START_TIMEOUT)
                    _show(progress, options.duration)
                elif deadline.passed():
                    raise Stopped(
                        f'the flight has stalled at {progress:.2f} s for {START_TIMEOUT:g} s'
                    )
            if bag:
                end = recorder.end(options.duration)
                wait(lambda: bag.behind(end))
            wall = time.monotonic() - began
            flight = recorder.flight(options.duration)
            if parameters['mode'] == 'lockstep' and (lost := flight.missing(options.duration)):
                raise Stopped(f'{lost} samples were lost: the recorder did not keep up')
            return flight, wall, processes.respawned, parameters
    finally:
        executor.shutdown()
        recorder.destroy_node()
        try_shutdown()


def _show(progress: float, duration: float) -> None:
    """Show on a terminal how far the flight is [s]; the next line that is printed replaces it."""
    if sys.stderr.isatty():
        text = f'flight: {min(progress, duration):.1f} of {duration:.1f} s'
        print(text, end='\r', file=sys.stderr, flush=True)


def _report(
    failures: RotorFailures,
    mode: str,
    vehicle: Vehicle,
    waypoint: Waypoint,
    flight: Flight,
    wall: float,
) -> bool:
    error, heading_error = flight.position_error(waypoint), flight.heading_error(waypoint)
    last = vehicle.with_health(failures.physical(vehicle.health, _ns(flight.time[-1])))
    lost = audit(last).lost
    reached = error <= POSITION_TOLERANCE
    if 'yaw' in lost:
        away = f'{1e3 * error:.1f} mm away; the heading is given up'
    else:
        reached = reached and heading_error <= HEADING_TOLERANCE
        away = f'{1e3 * error:.1f} mm and {math.degrees(heading_error):.3f} degrees away'
    verdict = 'reached' if reached else 'MISSED'
    speeds = flight.speeds
    inside = _within_bounds(flight, vehicle, failures, mode)
    print(
        f'flight of {flight.time[-1]:.2f} s ({mode}, {len(flight.time)} samples, '
        f'in {wall:.1f} s)\n'
        f'  waypoint      {verdict}: {away}\n'
        f'  rotor speeds  {", ".join(f"{speed:.1f}" for speed in speeds[-1])} rad/s at the end,\n'
        f'                {speeds.min():.1f} to {speeds.max():.1f} rad/s in flight, '
        f'{"within" if inside else "OUT OF"} bounds'
    )
    weak = ', '.join(
        f'rotor {i + 1} lost' if health < HEALTH_MIN else f'rotor {i + 1} at {100.0 * health:g} %'
        for i, health in enumerate(last.health)
        if health < 1.0
    )
    if weak:
        axes = f'; lost axes: {", ".join(lost)}' if lost else ''
        print(f'  at the end    {weak}{axes}')
    return reached


def _within_bounds(flight: Flight, vehicle: Vehicle, failures: RotorFailures, mode: str) -> bool:
    """Return whether each rotor kept its bounds as known at the time: 0 for a lost rotor."""
    times = np.round(flight.time * 1e9)
    inside = np.ones(flight.speeds.shape, dtype=bool)
    for start in [0, *failures.times()]:
        believed = vehicle.with_health(failures.believed(vehicle.health, start))
        later = times >= start
        speeds = flight.speeds[later]
        inside[later] = _inside(speeds, believed)
        if mode == 'realtime':
            # In real time the announcement takes effect with a delay.
            inside[later] |= _inside(speeds, vehicle)
    return bool(inside.all())


def _inside(speeds: Array, vehicle: Vehicle) -> BoolArray:
    low, high = vehicle.speed_limits
    return (speeds >= low) & (speeds <= high)


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


if __name__ == '__main__':
    raise SystemExit(main())
