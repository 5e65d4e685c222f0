"""The latency of the allocator node from command to rotor speeds, beside that of an echo node.

Both nodes run all the time, each in a process and a namespace of its own, and get commands in
short alternating blocks, so that background load affects both equally.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import pandas as pd
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from tqdm import tqdm

from ca_ros.evaluation.latency.client import COMMANDS, Client, LatencyError, flown
from ca_ros.process.processes import Processes
from ca_ros.vehicle.files import find

MODULES = {'allocator': 'ca_ros.nodes.allocator', 'echo': 'ca_ros.evaluation.latency.echo'}
NAMESPACE = '/benchmark_{kind}_{pid}'

RATES = (250.0, 1000.0)
"""Rates at which latencies are measured [Hz]."""

ANSWERED_MIN, OFFERED_MIN = 0.99, 0.98
"""Share of the commands that must be answered at a sustained rate, and of the rate that must be
reached in sending.  Not all: with a queue of one, each stall loses some, at any rate."""

CHANCES = 3
"""Attempts at a rate before it counts as too high, for the same reason."""

LADDER_START, LADDER, RATE_MIN, RATE_MAX = 500.0, 2.0, 1.0, 1e5
"""First rate that is tried [Hz], ratio of the rates that follow, and their limits [Hz]."""


def measure_nodes(vehicle: str, quick: bool) -> dict[str, Any]:
    """Start both nodes for a vehicle's name or file, measure them, and end them.

    Returns ``node`` of benchmark.json: metrics of each rate, highest sustained rates, settings.
    Raises a LatencyError if a node ends or does not answer.
    """
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    blocks, seconds, rounds, precision = (3, 0.3, 1, 1.2) if quick else (20, 2.0, 5, 1.03)
    ros = ['--ros-args', '--params-file', str(find(vehicle).resolve()), '-p', 'mode:=realtime']
    # Between its blocks a node gets no commands, and stamps are numbers here.
    ros += ['-p', 'command_timeout:=1.0e6', '-p', 'command_age_max:=0.0']
    ros += ['-r', '/diagnostics:=diagnostics', '-r']
    spaces = {kind: NAMESPACE.format(kind=kind, pid=os.getpid()) for kind in MODULES}
    children = {
        kind: [sys.executable, '-m', module, *ros, f'__ns:={spaces[kind]}']
        for kind, module in MODULES.items()
    }
    commands = flown(vehicle)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(
        'latency', start_parameter_services=False, enable_rosout=False, use_global_arguments=False
    )
    try:
        with (
            Processes(children) as processes,
            tqdm(desc='latency', unit=' blocks', disable=None) as bar,
        ):

            def watch() -> None:
                bar.update()
                for name, code in processes.ended().items():
                    raise LatencyError(f'the {name} ended with exit code {code}')

            clients = {kind: Client(node, spaces[kind], commands, watch) for kind in MODULES}
            for client in clients.values():
                client.wait_for_node()
            for client in clients.values():
                # The first commands fill caches and are not measured.
                client.ask(COMMANDS, COMMANDS)
            return {
                'rates': measure(clients, RATES, blocks, seconds),
                'sustained': sustained(clients, seconds, rounds, precision),
                'settings': {
                    'blocks': f'{blocks} of {seconds:g} s',
                    'sustained rate': f'{ANSWERED_MIN:.0%} answered, in one of {CHANCES} attempts',
                    'rounds': rounds,
                    'precision': precision,
                },
            }
    finally:
        node.destroy_node()
        try_shutdown()


def measure(
    clients: Mapping[str, Client], rates: Sequence[float], blocks: int, seconds: float
) -> dict[str, Any]:
    """Return the metrics of each rate."""
    found = {}
    for rate in rates:
        parts = []
        for block in range(blocks):
            # The clients take turns at being the first.
            for kind in list(clients)[:: 1 if block % 2 else -1]:
                part = clients[kind].ask(rate, max(int(rate * seconds), 10))
                parts.append(part.assign(kind=kind, block=block))
        rows = pd.concat(parts)
        quantiles = rows.groupby(['kind', 'block'])['latency'].quantile([0.5, 0.99])
        ratios = (quantiles['allocator'] / quantiles['echo']).groupby(level=1).median()
        found[f'{rate:g}'] = {
            **{kind: metrics(own, 1.0 / rate) for kind, own in rows.groupby('kind')},
            'ratio': {'p50': float(ratios[0.5]), 'p99': float(ratios[0.99])},
        }
    return found


def metrics(rows: pd.DataFrame, period: float) -> dict[str, float]:
    """Return percentiles [s] and counts; an answer is late a period after it was due."""
    if rows['latency'].isna().all():
        raise LatencyError('no command was answered')
    p50, p99, p999 = rows['latency'].quantile([0.5, 0.99, 0.999])
    in_time = (rows['delay'] + rows['latency'] <= period).sum()
    counts = {'sent': len(rows), 'answered': int(rows['latency'].count())}
    return {'p50': p50, 'p99': p99, 'p99.9': p999, 'late': int(len(rows) - in_time), **counts}


def sustained(
    clients: Mapping[str, Client], seconds: float, rounds: int, precision: float
) -> dict[str, float]:
    """Return the highest rates [Hz] at which `ANSWERED_MIN` of the commands are answered."""

    def holds(client: Client, rate: float) -> bool:
        for _ in range(CHANCES):
            rows = client.ask(rate, max(int(rate * seconds), 10))
            reached = (len(rows) - 1) / (rows['sent'].iloc[-1] - rows['sent'].iloc[0])
            answered = rows['latency'].notna().mean()
            if answered >= ANSWERED_MIN and reached >= OFFERED_MIN * rate:
                return True
        return False

    def highest(client: Client) -> float:
        low = LADDER_START
        while not holds(client, low):
            low /= LADDER
            if low < RATE_MIN:
                raise LatencyError('a node sustains no rate')
        high = low * LADDER
        while high < RATE_MAX and holds(client, high):
            low, high = high, high * LADDER
        while high / low > precision:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if holds(client, middle) else (low, middle)
        return low

    made = [{kind: highest(client) for kind, client in clients.items()} for _ in range(rounds)]
    ratio = median(each['allocator'] / each['echo'] for each in made)
    return {**{kind: median(each[kind] for each in made) for kind in clients}, 'ratio': ratio}
