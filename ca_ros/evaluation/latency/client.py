"""The client of a measured node: sends it the commands of a flight, and times its answers."""

from __future__ import annotations

import gc
import struct
import time
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from ca_ros.errors import CaRosError
from ca_ros.evaluation.benchmark import loads
from ca_ros.flight.gains import Gains
from ca_ros.nodes.messages import wrench_message
from ca_ros.nodes.parameters import load
from ca_ros.nodes.qos import offered, requested
from ca_ros.nodes.topics import SPEED_COMMAND, WRENCH
from ca_ros.process.deadline import Deadline
from ca_ros.vehicle.parameters import AXES
from ca_ros.vehicle.vehicle import Vehicle

COMMANDS = 1000
START_TIMEOUT = 30.0
ANSWER_MAX = 1.0
"""Time after which a command without an answer is lost [s]."""


class LatencyError(CaRosError):
    """A node ended, or did not answer."""


def flown(name: str) -> list[bytes]:
    """Return the wrenches of a flight as serialized messages."""
    vehicle, parameters = Vehicle.load(name), load(name)
    wrenches = np.zeros((COMMANDS, len(AXES)))
    gains = Gains.from_parameters(parameters)
    columns = [AXES.index(axis) for axis in vehicle.axes]
    wrenches[:, columns] = loads.flight(vehicle, gains, COMMANDS)
    header = Header(frame_id=parameters['command_frame'])
    return [bytes(serialize_message(wrench_message(wrench, header))) for wrench in wrenches]


class Client:
    """The client of one of the nodes.

    It sends and takes serialized messages without an executor, so that it costs less than the node
    and adds no wake-up.
    """

    def __init__(
        self, node: Node, space: str, commands: Sequence[bytes], watch: Callable[[], None]
    ) -> None:
        self._watch, self._commands = watch, [bytearray(command) for command in commands]
        self._publisher = node.create_publisher(
            WRENCH.kind, f'{space}/{WRENCH.name}', offered('realtime')
        )
        # Reliable: every answer counts, also if several arrive at once.
        self._subscription = node.create_subscription(
            SPEED_COMMAND.kind,
            f'{space}/{SPEED_COMMAND.name}',
            lambda _: None,
            requested('lockstep'),
            raw=True,
        )
        self._space, self._sent = space, 0

    def wait_for_node(self) -> None:
        """Wait until the node answers; matched topics alone may still lose its first answers."""
        deadline = Deadline(START_TIMEOUT)
        matched = self._publisher.get_subscription_count, self._subscription.get_publisher_count
        while not (all(count() for count in matched) and self.ask(50.0, 10)['latency'].count()):
            self._watch()
            time.sleep(0.05)
            if deadline.passed():
                raise LatencyError(f'after {START_TIMEOUT:g} s no answer in {self._space}')

    def ask(self, rate: float, count: int) -> pd.DataFrame:
        """Send commands at a rate, without waiting for answers.

        Returns
        -------
        DataFrame
            One row per command: ``sent`` [s], ``delay`` from the time when it was due [s], and
            ``latency`` until its answer, NaN without an answer [s].
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
        return pd.DataFrame({'sent': sent, 'delay': sent - due, 'latency': answered - sent})

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
