"""The latency of the allocator node from command to rotor speeds, beside that of an echo node.

Run by ``benchmark``, or alone: ``python -m ca_ros.nodes.latency --out FILE.json``.  Both nodes run
all the time, each in a process and a namespace of its own, and are asked in turn in short blocks,
so that whatever else the machine does meets both.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray
from tqdm import tqdm

from ca_ros.allocation import make_allocator
from ca_ros.arrays import Array
from ca_ros.closed_loop import fly
from ca_ros.controller import Controller, Gains, Waypoint
from ca_ros.nodes.messages import wrench_message
from ca_ros.nodes.qos import offered, requested
from ca_ros.parameters import AXES, ParameterError, find, load
from ca_ros.processes import Processes
from ca_ros.rigid_body import RigidBody
from ca_ros.vehicle import Vehicle

KINDS = ('allocator', 'echo')
NAMESPACE = '/benchmark_{kind}_{pid}'

START_TIMEOUT = 30.0
PATIENCE = 1.0
"""When a command without an answer is lost [s]."""

ANSWERED_MIN = 0.99
"""Share of the commands that is answered at a rate that is sustained.

Not all: with a queue of one, each stall of the machine loses some, at any rate.
"""

CHANCES = 3
"""How often a rate is tried before it counts as too high, for the same reason."""

LADDER = 1.5
"""Ratio of the rates that are tried one after the other."""


class LatencyError(RuntimeError):
    """A node ended, or did not answer."""


class Side:
    """One of the nodes, as who asks it sees it.

    Bytes are sent and taken as they are, and taken without an executor: so the asking costs less
    than the answering, and adds no wake-up of its own.
    """

    def __init__(self, node: Node, kind: str, commands: Sequence[bytes]) -> None:
        self.kind, self._commands = kind, [bytearray(command) for command in commands]
        place = NAMESPACE.format(kind=kind, pid=os.getpid())
        self.publisher = node.create_publisher(
            WrenchStamped, f'{place}/command/wrench', offered('realtime')
        )
        self._subscription = node.create_subscription(
            Float64MultiArray,
            f'{place}/command/motor_speed',
            lambda _: None,
            # Every answer counts, also those that come in a bunch.
            requested('lockstep'),
            raw=True,
        )
        self._sent = 0

    @property
    def there(self) -> bool:
        """Whether both topics have found the node."""
        return bool(
            self.publisher.get_subscription_count() and self._subscription.get_publisher_count()
        )

    def ask(self, rate: float, count: int) -> Array:
        """Send commands at a rate [Hz]; return the latencies (count,), NaN for no answer [s]."""
        first, sent = self._sent, np.full(count, np.nan)
        answered, left = np.full(count, np.nan), count
        start = time.perf_counter() + 1.0 / rate
        k = 0
        end = start + count / rate + PATIENCE
        while left and (now := time.perf_counter()) < end:
            if k < count and now >= start + k / rate:
                command = self._commands[(first + k) % len(self._commands)]
                # The stamp follows the four bytes that say how the message is encoded.
                struct.pack_into('<iI', command, 4, 0, first + k)
                sent[k] = time.perf_counter()
                self.publisher.publish(bytes(command))
                k += 1
            elif (i := self._take() - first) >= 0 and i < count and np.isnan(answered[i]):
                answered[i] = time.perf_counter()
                left -= 1
        self._sent += count
        return answered - sent

    def _take(self) -> int:
        """Return which command the next answer is for; -1 if there is none."""
        with self._subscription.handle:
            taken = self._subscription.handle.take_message(Float64MultiArray, True)
        if taken is None:
            return -1
        _, found, rest = bytes(taken[0]).partition(b'stamp ')
        digits = rest.partition(b'\0')[0]
        return int(digits) if found and digits.isdigit() else -1


def flown(vehicle: str) -> list[bytes]:
    """Return the wrenches of a flight, as messages in bytes."""
    parameters = load(vehicle)
    made = Vehicle.load(vehicle)
    flight_of: list[Array] = []

    class Noting(Controller):
        def wrench(self, *state: Any) -> Array:
            flight_of.append(super().wrench(*state))
            return flight_of[-1]

    controller = Noting(made, Gains.from_parameters(parameters))
    fly(controller, make_allocator('exact', made), RigidBody(made), Waypoint.of(3, -2, 2, 1), 5.0)
    rows = [AXES.index(axis) for axis in made.axes]
    wrenches = np.zeros((len(flight_of), len(AXES)))
    wrenches[:, rows] = flight_of
    header = WrenchStamped().header
    header.frame_id = 'base_link'
    return [bytes(serialize_message(wrench_message(wrench, header))) for wrench in wrenches]


def summary(latencies: Array, period: float) -> dict[str, float]:
    """Return percentiles [s] and counts of latencies (N,)."""
    answered = latencies[np.isfinite(latencies)]
    if not len(answered):
        raise LatencyError('no command was answered')
    p50, p99, p999 = np.percentile(answered, (50.0, 99.0, 99.9)).tolist()
    return {
        'p50': p50,
        'p99': p99,
        'p99.9': p999,
        'late': int(len(latencies) - (answered <= period).sum()),
        'sent': len(latencies),
        'answered': len(answered),
    }


def measure(
    sides: Sequence[Side], rates: Sequence[float], blocks: int, seconds: float, watch: Any
) -> dict[str, Any]:
    """Return the figures of each rate."""
    found = {}
    for rate in rates:
        latencies: dict[str, list[Array]] = {side.kind: [] for side in sides}
        for block in range(blocks):
            # Now the one and now the other comes first.
            for side in sides if block % 2 else sides[::-1]:
                latencies[side.kind].append(side.ask(rate, max(int(rate * seconds), 10)))
                watch()
        figures: dict[str, Any] = {
            kind: summary(np.concatenate(parts), 1.0 / rate) for kind, parts in latencies.items()
        }
        for name in ('p50', 'p99'):
            pairs = [
                summary(ours, 1.0 / rate)[name] / summary(echo, 1.0 / rate)[name]
                for ours, echo in zip(*(latencies[kind] for kind in KINDS), strict=True)
            ]
            figures[f'ratio_{name}'] = median(pairs)
        found[f'{rate:g}'] = figures
    return found


def sustained(
    sides: Sequence[Side], seconds: float, rounds: int, precision: float, watch: Any
) -> dict[str, float]:
    """Return the highest rates [Hz] at which `ANSWERED_MIN` of the commands are answered."""
    found: dict[str, list[float]] = {side.kind: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            low, high = 200.0, 0.0
            while not high or high / low > precision:
                rate = low * LADDER if not high else (low * high) ** 0.5
                for _ in range(CHANCES):
                    latencies = side.ask(rate, int(rate * seconds))
                    watch()
                    held = np.isfinite(latencies).mean() >= ANSWERED_MIN
                    if held:
                        break
                low, high = (rate, high) if held else (low, rate)
            found[side.kind].append(low)
    rates = {kind: median(values) for kind, values in found.items()}
    pairs = zip(*(found[kind] for kind in KINDS), strict=True)
    return {**rates, 'ratio': median(ours / echo for ours, echo in pairs)}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; return the exit code."""
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    options = _parse(sys.argv[1:] if argv is None else argv)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    try:
        commands = flown(options.vehicle)
        figures = _run(options, commands, stop)
    except (ParameterError, LatencyError, OSError) as error:
        print(f'latency: {error}', file=sys.stderr)
        return 128 + stop[0] if stop else 1
    options.out.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
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
        type=lambda text: [float(word) for word in text.split(',')],
        default=[250.0, 1000.0],
        metavar='HZ,HZ',
        help='rates to measure latencies at (default: 250,1000)',
    )
    return parser.parse_args(argv)


def _run(options: argparse.Namespace, commands: list[bytes], stop: list[int]) -> dict[str, Any]:
    blocks, seconds, rounds, precision = (3, 0.5, 1, 1.2) if options.quick else (20, 2.0, 5, 1.03)
    ros = ['--ros-args', '--params-file', str(find(options.vehicle).resolve())]
    # Between its blocks the allocator would tell the motors that commands have ceased.
    ros += ['-p', 'command_timeout:=1.0e6', '-p', 'mode:=realtime']
    children = {
        kind: [
            sys.executable,
            '-m',
            f'ca_ros.nodes.{kind}',
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
            deadline = time.monotonic() + START_TIMEOUT
            while not all(side.there for side in sides):
                watch()
                time.sleep(0.05)
                if time.monotonic() > deadline:
                    raise LatencyError(f'after {START_TIMEOUT:g} s not all nodes are there')
            for side in sides:
                # Laws are learned, caches are filled.
                side.ask(200.0, len(commands))
                watch()
            found = {
                'rates': measure(sides, options.rates, blocks, seconds, watch),
                'sustained': sustained(sides, seconds, rounds, precision, watch),
                'repetitions': blocks,
                'settings': {
                    'vehicle': options.vehicle,
                    'block': seconds,
                    'rounds of the sustained rate': rounds,
                    'precision of the sustained rate': precision,
                    'answered at a sustained rate': ANSWERED_MIN,
                    'quality of service': 'commands best effort, keep last 1',
                },
            }
            bar.close()
            return found
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    raise SystemExit(main())
