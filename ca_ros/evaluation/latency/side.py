"""The client of a measured node, and its latencies."""

from __future__ import annotations

import gc
import os
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node

from ca_ros.arrays import Array
from ca_ros.nodes.qos import offered, requested
from ca_ros.nodes.topics import SPEED_COMMAND, WRENCH

NAMESPACE = '/benchmark_{kind}_{pid}'

START_TIMEOUT = 30.0
ANSWER_MAX = 1.0
"""Time after which a command without an answer is lost [s]."""


class LatencyError(RuntimeError):
    """A node ended, or did not answer."""


@dataclass(frozen=True, eq=False)
class Block:
    """The latencies of K commands at a rate.

    Attributes
    ----------
    latencies : (K,) array
        From publishing a command to having its answer, NaN for none [s].
    delays : (K,) array
        From the time at which a command was due to its publishing [s].
    offered : float
        The achieved rate [Hz].
    """

    latencies: Array
    delays: Array
    offered: float

    @property
    def answered(self) -> float:
        """Share of the commands that were answered."""
        return float(np.isfinite(self.latencies).mean())


class Side:
    """The client of one of the nodes.

    It sends and takes messages as bytes, without an executor, so that it costs less than the node
    and adds no wake-up.
    """

    def __init__(self, node: Node, kind: str, commands: Sequence[bytes]) -> None:
        self.kind, self._commands = kind, [bytearray(command) for command in commands]
        place = NAMESPACE.format(kind=kind, pid=os.getpid())
        self.publisher = node.create_publisher(
            WRENCH.kind, f'{place}/{WRENCH.name}', offered('realtime')
        )
        self._subscription = node.create_subscription(
            SPEED_COMMAND.kind,
            f'{place}/{SPEED_COMMAND.name}',
            lambda _: None,
            # Every answer counts, also if several arrive at once.
            requested('lockstep'),
            raw=True,
        )
        self._sent = 0

    @property
    def there(self) -> bool:
        """Whether both topics are matched with the node."""
        return bool(
            self.publisher.get_subscription_count() and self._subscription.get_publisher_count()
        )

    def ask(self, rate: float, count: int) -> Block:
        """Send commands at a rate, without waiting for answers."""
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
        return Block(answered - sent, sent - due, (count - 1) / (sent[-1] - sent[0]))

    def ask_in_turn(self, count: int, watch: Callable[[], None]) -> float:
        """Send each command after the answer to the one before; return the rate [Hz]."""
        gc.collect()
        start = time.perf_counter()
        for _ in range(count):
            sent = now = self._send()
            while self._take() != self._sent - 1:
                if time.perf_counter() > now + ANSWER_MAX:
                    watch()
                    now = time.perf_counter()
                    if now > sent + START_TIMEOUT:
                        raise LatencyError(f'the {self.kind} has left a command unanswered')
        return count / (time.perf_counter() - start)

    def _send(self) -> float:
        """Send the next command; return the time [s]."""
        command = self._commands[self._sent % len(self._commands)]
        # The stamp follows the four bytes that say how the message is encoded.
        struct.pack_into('<iI', command, 4, 0, self._sent)
        self._sent += 1
        now = time.perf_counter()
        self.publisher.publish(bytes(command))
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
