"""The latency of the allocator node from command to rotor speeds, beside that of an echo node.

The nodes run all the time, each in a process and a namespace of its own, and get commands in short
alternating blocks, so that background load affects all equally.  ``python -m benchmarks.latency
--base FOLDER`` measures the node of another version, too: FOLDER has its source with the kernel.
"""

import argparse
import gc
import os
import struct
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from std_msgs.msg import Header

from benchmarks import wrenches
from benchmarks.sizes import FULL, Sizes
from ca_ros.errors import CaRosError
from ca_ros.nodes.messages import wrench_message
from ca_ros.nodes.topics import SPEED_COMMAND, WRENCH, offered, requested
from ca_ros.parameter_files import load
from ca_ros.process.processes import Deadline, Processes
from ca_ros.vehicle.files import find
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle

COMMAND = {'ca_ros_cli.py': 'ca_ros_cli', 'ca_ros_commands.py': 'ca_ros_commands'}
"""The module that starts a node, by a file of the source of a version: today's, and 0.2."""

RATES = (250.0, 1000.0)  # rates at which latencies are measured [Hz]

COMMANDS = 1000
START_TIMEOUT = 30.0
ANSWER_MAX = 1.0  # time after which a command without an answer is lost [s]


def measure_nodes(vehicle: str, sizes: Sizes, base: Path | None = None) -> pd.DataFrame:
    """Start the nodes for a vehicle's name or file, measure them, and end them.

    `base`: the source of another version, whose node is measured as ``base``.

    Returns one row per block: rate, node, percentiles of the latency [s], and how many commands
    were sent, answered, and late.  Raises a CaRosError if a node ends or does not answer.
    """
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    root = Path(__file__).parents[1]
    ros = ['--ros-args', '-r', '/diagnostics:=diagnostics']
    # Between its blocks a node gets no commands, and stamps are numbers here.
    ours = ['-p', 'mode:=realtime', '-p', 'command_timeout:=1.0e6', '-p', 'command_age_max:=0.0']
    nodes = {
        kind: (source, [_command(source), 'allocator', *ros, *_parameters(source, vehicle), *ours])
        for kind, source in {'allocator': root, 'base': base}.items() if source
    }
    nodes['echo'] = root, ['benchmarks.echo', str(Vehicle.load(vehicle).n), *ros]
    spaces = {kind: f'/benchmark_{kind}_{os.getpid()}' for kind in nodes}
    children = {
        # Python finds the modules of the folder in which it starts first.
        kind: ['env', '-C', str(folder), sys.executable, '-m', *words,
               '-r', f'__ns:={spaces[kind]}']
        for kind, (folder, words) in nodes.items()
    }
    commands = flown(vehicle)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('latency', start_parameter_services=False, enable_rosout=False)
    try:
        with Processes(children) as processes:

            def watch() -> None:
                for name, code in processes.ended().items():
                    raise CaRosError(f'the {name} ended with exit code {code}')

            clients = {kind: Client(node, spaces[kind], commands, watch) for kind in nodes}
            for client in clients.values():
                client.wait_for_node()
                # The first commands fill caches and are not measured.
                client.ask(COMMANDS, COMMANDS)
            return measure(clients, *sizes.blocks)
    finally:
        node.destroy_node()
        try_shutdown()


def _command(source: Path) -> str:
    """Return the module that starts the nodes of a version."""
    for file, module in COMMAND.items():
        if (source / file).exists():
            return module
    raise CaRosError(f'{source} has none of {", ".join(COMMAND)}')


def _parameters(source: Path, vehicle: str) -> list[str]:
    """Return the options with the file of a vehicle: of a shipped one, that of the version."""
    shipped = source / 'config' / f'{vehicle}.yaml'
    return ['--params-file', str((shipped if shipped.exists() else find(vehicle)).resolve())]


def flown(name: str) -> list[bytes]:
    """Return the wrenches of a flight as serialized messages."""
    vehicle, settings = Vehicle.load(name), load(name)
    demands = np.zeros((COMMANDS, len(AXES)))
    columns = [AXES.index(axis) for axis in vehicle.axes]
    demands[:, columns] = wrenches.flown(vehicle, settings.controller, COMMANDS)
    header = Header(frame_id=settings.command_frame)
    return [bytes(serialize_message(wrench_message(wrench, header))) for wrench in demands]


class Client:
    """The client of one of the nodes.

    It sends and takes serialized messages without an executor, so that it costs less than the node
    and adds no wake-up.
    """

    def __init__(
        self, node: Node, space: str, commands: Sequence[bytes], watch: Callable[[], None]
    ) -> None:
        self._watch, self._commands = watch, [bytearray(command) for command in commands]
        topic = f'{space}/{WRENCH.name}'
        self._publisher = node.create_publisher(WRENCH.kind, topic, offered('realtime'))
        # Reliable: every answer counts, also if several arrive at once.
        taken = SPEED_COMMAND.kind, f'{space}/{SPEED_COMMAND.name}', print, requested('lockstep')
        self._subscription = node.create_subscription(*taken, raw=True)
        self._space, self._sent = space, 0

    def wait_for_node(self) -> None:
        """Wait until the node answers; matched topics alone may still lose its first answers."""
        deadline = Deadline(START_TIMEOUT)
        matched = self._publisher.get_subscription_count, self._subscription.get_publisher_count
        while not (all(count() for count in matched) and self.ask(50.0, 10)['latency'].count()):
            self._watch()
            time.sleep(0.05)
            if deadline.passed():
                raise CaRosError(f'after {START_TIMEOUT:g} s no answer in {self._space}')

    def ask(self, rate: float, count: int) -> pd.DataFrame:
        """Send commands at a rate, without waiting for answers.

        Returns one row per command: ``delay`` from the time when it was due, and ``latency`` until
        its answer, NaN without an answer [s].
        """
        gc.collect()
        first = self._sent
        due, sent, answered = np.full((3, count), np.nan)
        due[:] = time.perf_counter() + np.arange(1, count + 1) / rate
        end = due[-1] + ANSWER_MAX
        k = 0
        # Answers arrive in the order of the commands, so the last one ends the block.
        while np.isnan(answered[-1]) and (now := time.perf_counter()) < end:
            if k < count and now >= due[k]:
                sent[k] = self._send()
                k += 1
            elif (i := self._take() - first) >= 0 and i < count and np.isnan(answered[i]):
                answered[i] = time.perf_counter()
        self._watch()
        return pd.DataFrame({'delay': sent - due, 'latency': answered - sent})

    def _send(self) -> float:
        """Send the next command; return the time [s]."""
        command = self._commands[self._sent % len(self._commands)]
        # The stamp follows the four bytes of the encoding; the answer repeats it.
        struct.pack_into('<iI', command, 4, 0, self._sent)
        self._sent += 1
        now = time.perf_counter()
        self._publisher.publish(bytes(command))
        return now

    def _take(self) -> int:
        """Return the number of the command that the next answer is for; -1 without answer."""
        with self._subscription.handle:
            taken = self._subscription.handle.take_message(SPEED_COMMAND.kind, True)
        if taken is None:
            return -1
        _, found, rest = bytes(taken[0]).partition(b'stamp ')
        digits = rest.partition(b'\0')[0]
        return int(digits) if found and digits.isdigit() else -1


def measure(clients: Mapping[str, Client], blocks: int, seconds: float) -> pd.DataFrame:
    """Return the rows of `measure_nodes`; the clients take turns at being the first."""
    rows: list[dict[str, Any]] = []
    least = len(RATES) * blocks * len(clients) * seconds / 60.0
    print(f'{", ".join(clients)}: at least {least:.1f} min', flush=True)
    for rate in RATES:
        for block in range(blocks):
            for kind in list(clients)[:: 1 if block % 2 else -1]:
                found = clients[kind].ask(rate, max(int(rate * seconds), 10))
                key = {'part': 'node', 'wrenches': f'{rate:g} Hz', 'contender': kind}
                rows.append({**key, 'repetition': block, **metrics(found, 1.0 / rate)})
            medians = (f'{row["contender"]} {1e6 * row["p50"]:.0f} us'
                       for row in rows[-len(clients):])
            print(f'{rate:g} Hz, block {block + 1} of {blocks}:', ', '.join(medians), flush=True)
    return pd.DataFrame(rows)


def metrics(rows: pd.DataFrame, period: float) -> dict[str, float]:
    """Return percentiles [s] and counts; an answer is late a period after it was due."""
    if rows['latency'].isna().all():
        raise CaRosError('no command was answered')
    p50, p99 = rows['latency'].quantile([0.5, 0.99])
    in_time = int((rows['delay'] + rows['latency'] <= period).sum())
    counts = {'sent': len(rows), 'answered': int(rows['latency'].count())}
    return {'p50': p50, 'p99': p99, 'late': len(rows) - in_time, **counts}


def main() -> None:
    """Measure, and print the medians over the blocks and the ratios to the other version."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.latency', description=__doc__)
    parser.add_argument('--vehicle', default='hexarotor', help='a shipped vehicle or a YAML file')
    parser.add_argument('--base', type=Path, help='the source of another version')
    options = parser.parse_args()
    rows = measure_nodes(options.vehicle, FULL, options.base)
    for rate, own in rows.groupby('wrenches', sort=False):
        cells = own.pivot_table(['p50', 'p99'], 'repetition', 'contender')
        for metric in ('p50', 'p99'):
            times = cells[metric]
            words = [f'{kind} {1e6 * times[kind].median():.0f} us' for kind in times]
            if 'base' in times:
                over = (times['allocator'] / times['base']).median()
                words.append(f'allocator over base {over:.2f}')
            print(f'{rate} {metric}:', ', '.join(words))


if __name__ == '__main__':
    main()
