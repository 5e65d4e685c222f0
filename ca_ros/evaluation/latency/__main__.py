"""The latency of the allocator node from command to rotor speeds, beside that of an echo node.

Run by ``benchmark``, or alone: ``python -m ca_ros.evaluation.latency --out FILE.json``.  Both
nodes run all the time, each in a process and a namespace of its own, and are asked in turn in
short blocks, so that whatever else the machine does meets both.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from std_msgs.msg import Header
from tqdm import tqdm

from ca_ros.bringup.deadline import Deadline
from ca_ros.bringup.processes import Processes, note_signals
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.latency.figures import (
    ANSWERED_MIN,
    CHANCES,
    KINDS,
    RATE_MAX,
    RATE_MIN,
    in_turn,
    measure,
    sustained,
)
from ca_ros.evaluation.latency.side import NAMESPACE, START_TIMEOUT, LatencyError, Side
from ca_ros.flight.controller import Gains
from ca_ros.nodes.messages import wrench_message
from ca_ros.nodes.parameters import load
from ca_ros.vehicle.files import find
from ca_ros.vehicle.parameters import AXES
from ca_ros.vehicle.vehicle import Vehicle

COMMANDS = 1000

MODULES = {'allocator': 'ca_ros.nodes.allocator', 'echo': 'ca_ros.evaluation.latency.echo'}


def flown(name: str) -> list[bytes]:
    """Return the wrenches of a flight, as messages in bytes."""
    vehicle, parameters = Vehicle.load(name), load(name)
    wrenches = np.zeros((COMMANDS, len(AXES)))
    wrenches[:, [AXES.index(axis) for axis in vehicle.axes]] = loads.flight(
        vehicle, Gains.from_parameters(parameters), COMMANDS
    )
    header = Header(frame_id=parameters['command_frame'])
    return [bytes(serialize_message(wrench_message(wrench, header))) for wrench in wrenches]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; return the exit code."""
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    options = _parse(sys.argv[1:] if argv is None else argv)
    stop = note_signals()
    try:
        # Not found out after minutes.
        if not options.out.absolute().parent.is_dir():
            raise FileNotFoundError(f'--out: {options.out.parent} is not a folder')
        figures = _run(options, flown(options.vehicle), stop)
        options.out.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    except (ValueError, LatencyError, OSError) as error:
        print(f'latency: {error}', file=sys.stderr)
        return 128 + stop[0] if stop else 1
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='latency', description='Measure the allocator node beside an echo node.'
    )
    parser.add_argument('--out', type=Path, required=True, metavar='FILE', help='JSON')
    parser.add_argument('--vehicle', default='hexarotor', help='a shipped vehicle or a YAML file')
    parser.add_argument('--quick', action='store_true', help='in a quarter of a minute')
    parser.add_argument(
        '--rates',
        type=_rates,
        default=[250.0, 1000.0],
        metavar='HZ,HZ',
        help='rates to measure latencies at (default: 250,1000)',
    )
    return parser.parse_args(argv)


def _rates(text: str) -> list[float]:
    try:
        rates = [float(word) for word in text.split(',')]
    except ValueError:
        rates = []
    if not rates or not all(RATE_MIN <= rate <= RATE_MAX for rate in rates):
        raise argparse.ArgumentTypeError(
            f'{text}: expected rates from {RATE_MIN:g} to {RATE_MAX:g} Hz with commas between'
        )
    return rates


def _run(options: argparse.Namespace, commands: list[bytes], stop: list[int]) -> dict[str, Any]:
    blocks, seconds, rounds, precision = (3, 0.3, 1, 1.2) if options.quick else (20, 2.0, 5, 1.03)
    turns = 300 if options.quick else 2000
    ros = ['--ros-args', '--params-file', str(find(options.vehicle).resolve())]
    # Between its blocks the allocator would tell the motors that commands have ceased.
    ros += ['-p', 'command_timeout:=1.0e6', '-p', 'mode:=realtime']
    # Stamps are numbers here; the diagnostics stay in the namespace.
    ros += ['-p', 'command_age_max:=0.0', '-r', '/diagnostics:=diagnostics']
    children = {
        kind: [
            sys.executable,
            '-m',
            MODULES[kind],
            *ros,
            '-r',
            f'__ns:={NAMESPACE.format(kind=kind, pid=os.getpid())}',
        ]
        for kind in KINDS
    }
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(
        'latency', start_parameter_services=False, enable_rosout=False, use_global_arguments=False
    )
    try:
        with Processes(children) as processes:
            bar = tqdm(desc='latency', unit=' blocks', disable=not sys.stderr.isatty())

            def watch() -> None:
                bar.update()
                if stop:
                    raise LatencyError('interrupted')
                for name, code in processes.ended().items():
                    raise LatencyError(f'the {name} ended with exit code {code}')

            sides = [Side(node, kind, commands) for kind in KINDS]
            deadline = Deadline(START_TIMEOUT)
            for side in sides:
                # Who has found a node is not yet found by it: its first answers may go to nobody.
                while not (side.there and side.ask(50.0, 10).answered):
                    watch()
                    time.sleep(0.05)
                    if deadline.passed():
                        raise LatencyError(f'after {START_TIMEOUT:g} s no answer of {side.kind}')
            for side in sides:
                # Laws are learned, caches are filled.
                side.ask_in_turn(len(commands), watch)
                watch()
            found = {
                'rates': measure(sides, options.rates, blocks, seconds, watch),
                'sustained': sustained(sides, seconds, rounds, precision, watch),
                'in_turn': in_turn(sides, turns, rounds, watch),
                'repetitions': blocks,
                'settings': {
                    'vehicle': options.vehicle,
                    'block': seconds,
                    'rounds of the sustained rate': rounds,
                    'precision of the sustained rate': precision,
                    'answered at a sustained rate': ANSWERED_MIN,
                    'chances of a sustained rate': CHANCES,
                    'commands in turn': turns,
                    'quality of service': 'commands best effort, keep last 1',
                },
            }
            bar.close()
            return found
    finally:
        node.destroy_node()
        try_shutdown()


if __name__ == '__main__':
    raise SystemExit(main())
