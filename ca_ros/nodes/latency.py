"""The latency of the allocator node from command to rotor speeds, beside that of an echo node.

Run by ``benchmark``, or alone: ``python -m ca_ros.nodes.latency --out FILE.json``.  Both nodes run
all the time, each in a process and a namespace of its own, and are asked in turn in short blocks,
so that whatever else the machine does meets both.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import os
import signal
import struct
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from ca_ros.parameters import AXES, find, load
from ca_ros.processes import Processes
from ca_ros.rigid_body import RigidBody
from ca_ros.vehicle import Vehicle

KINDS = ('allocator', 'echo')
NAMESPACE = '/benchmark_{kind}_{pid}'

START_TIMEOUT = 30.0
PATIENCE = 1.0
"""When a command without an answer is lost [s]."""

RATE_MIN, RATE_MAX = 1.0, 1e5
"""What commands can be sent at [Hz]: a block is over in seconds, and a stamp is a number."""

ANSWERED_MIN = 0.99
"""Share of the commands that is answered at a rate that is sustained.

Not all: with a queue of one, each stall of the machine loses some, at any rate.
"""

CHANCES = 3
"""How often a rate is tried before it counts as too high, for the same reason."""

OFFERED_MIN = 0.98
"""Share of a rate at which commands must have gone out: of a slower one, nothing is known."""

LADDER_START, LADDER = 500.0, 2.0
"""The first rate that is tried [Hz], and the ratio of those that follow."""


class LatencyError(RuntimeError):
    """A node ended, or did not answer."""


@dataclass(frozen=True, eq=False)
class Block:
    """What became of K commands that were due at a rate.

    Attributes
    ----------
    latencies : (K,) array
        From publishing a command to having its answer, NaN for none [s].
    delays : (K,) array
        From the time at which a command was due to its publishing [s].
    offered : float
        The rate at which they really went out [Hz].
    """

    latencies: Array
    delays: Array
    offered: float

    @property
    def answered(self) -> float:
        """Share of the commands that were answered."""
        return float(np.isfinite(self.latencies).mean())


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

    def ask(self, rate: float, count: int) -> Block:
        """Send commands when they are due, whether or not others have been answered."""
        gc.collect()
        first = self._sent
        due, sent, answered = np.full((3, count), np.nan)
        due[:] = time.perf_counter() + np.arange(1, count + 1) / rate
        end = due[-1] + PATIENCE
        k = 0
        # Answers come in the order of the commands: with that to the last one, none is to come.
        while np.isnan(answered[-1]) and (now := time.perf_counter()) < end:
            if k < count and now >= due[k]:
                sent[k] = self._send()
                k += 1
            elif (i := self._take() - first) >= 0 and i < count and np.isnan(answered[i]):
                answered[i] = time.perf_counter()
        return Block(answered - sent, sent - due, (count - 1) / (sent[-1] - sent[0]))

    def ask_in_turn(self, count: int, watch: Callable[[], None]) -> float:
        """Send each command as soon as the one before is answered; return their rate [Hz]."""
        gc.collect()
        start = time.perf_counter()
        for _ in range(count):
            sent = now = self._send()
            while self._take() != self._sent - 1:
                if time.perf_counter() > now + PATIENCE:
                    watch()
                    now = time.perf_counter()
                    if now > sent + START_TIMEOUT:
                        raise LatencyError(f'the {self.kind} has left a command unanswered')
        return count / (time.perf_counter() - start)

    def _send(self) -> float:
        """Send the next command; return when."""
        command = self._commands[self._sent % len(self._commands)]
        # The stamp follows the four bytes that say how the message is encoded.
        struct.pack_into('<iI', command, 4, 0, self._sent)
        self._sent += 1
        now = time.perf_counter()
        self.publisher.publish(bytes(command))
        return now

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


def summary(latencies: Array, delays: Array, period: float) -> dict[str, float]:
    """Return percentiles [s] and counts of latencies (N,); late is what was due a period ago."""
    answered = latencies[np.isfinite(latencies)]
    if not len(answered):
        raise LatencyError('no command was answered')
    p50, p99, p999 = np.percentile(answered, (50.0, 99.0, 99.9)).tolist()
    return {
        'p50': p50,
        'p99': p99,
        'p99.9': p999,
        'late': int(len(latencies) - (delays + latencies <= period).sum()),
        'sent': len(latencies),
        'answered': len(answered),
        'delay_p99': float(np.percentile(delays, 99.0)),
    }


def measure(
    sides: Sequence[Side],
    rates: Sequence[float],
    blocks: int,
    seconds: float,
    watch: Callable[[], None],
) -> dict[str, Any]:
    """Return the figures of each rate."""
    found = {}
    for rate in rates:
        made: dict[str, list[Block]] = {side.kind: [] for side in sides}
        for block in range(blocks):
            # Now the one and now the other comes first.
            for side in sides if block % 2 else sides[::-1]:
                made[side.kind].append(side.ask(rate, max(int(rate * seconds), 10)))
                watch()
        figures: dict[str, Any] = {
            kind: summary(
                np.concatenate([block.latencies for block in parts]),
                np.concatenate([block.delays for block in parts]),
                1.0 / rate,
            )
            for kind, parts in made.items()
        }
        for name in ('p50', 'p99'):
            figures[f'ratio_{name}'] = median(
                ours[name] / echo[name]
                for ours, echo in zip(
                    *(
                        [
                            summary(block.latencies, block.delays, 1.0 / rate)
                            for block in made[kind]
                        ]
                        for kind in KINDS
                    ),
                    strict=True,
                )
            )
        found[f'{rate:g}'] = figures
    return found


def compare(found: dict[str, list[float]]) -> dict[str, float]:
    """Return medians over the rounds of the rates found [Hz], and of their ratio in a round."""
    pairs = zip(*(found[kind] for kind in KINDS), strict=True)
    return {
        **{kind: median(rates) for kind, rates in found.items()},
        'ratio': median(ours / echo for ours, echo in pairs),
    }


def sustained(
    sides: Sequence[Side], seconds: float, rounds: int, precision: float, watch: Callable[[], None]
) -> dict[str, float]:
    """Return the highest rates [Hz] at which `ANSWERED_MIN` of the commands are answered."""

    def holds(side: Side, rate: float) -> bool:
        for _ in range(CHANCES):
            block = side.ask(rate, max(int(rate * seconds), 10))
            watch()
            if block.answered >= ANSWERED_MIN and block.offered >= OFFERED_MIN * rate:
                return True
        return False

    def highest(side: Side) -> float:
        low = LADDER_START
        while not holds(side, low):
            low /= LADDER
            if low < RATE_MIN:
                raise LatencyError(f'the {side.kind} sustains no rate')
        high = low * LADDER
        while high < RATE_MAX and holds(side, high):
            low, high = high, high * LADDER
        while high / low > precision:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if holds(side, middle) else (low, middle)
        return low

    found: dict[str, list[float]] = {side.kind: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            found[side.kind].append(highest(side))
    return compare(found)


def in_turn(
    sides: Sequence[Side], count: int, rounds: int, watch: Callable[[], None]
) -> dict[str, float]:
    """Return the rates [Hz] at which each command follows on the answer to the one before."""
    found: dict[str, list[float]] = {side.kind: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            found[side.kind].append(side.ask_in_turn(count, watch))
            watch()
    return compare(found)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; return the exit code."""
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    options = _parse(sys.argv[1:] if argv is None else argv)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
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
    # Stamps are numbers here, and what is said of these nodes is not for whoever flies nearby.
    ros += ['-p', 'command_age_max:=0.0', '-r', '/diagnostics:=diagnostics']
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
            for side in sides:
                # Who has found a node is not yet found by it: its first answers may go to nobody.
                while not (side.there and side.ask(50.0, 10).answered):
                    watch()
                    time.sleep(0.05)
                    if time.monotonic() > deadline:
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
        rclpy.try_shutdown()


if __name__ == '__main__':
    raise SystemExit(main())
