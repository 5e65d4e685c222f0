"""One of the nodes that are asked, and what became of what it was asked."""

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
PATIENCE = 1.0
"""When a command without an answer is lost [s]."""


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
            WRENCH.kind, f'{place}/{WRENCH.name}', offered('realtime')
        )
        self._subscription = node.create_subscription(
            SPEED_COMMAND.kind,
            f'{place}/{SPEED_COMMAND.name}',
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
            taken = self._subscription.handle.take_message(SPEED_COMMAND.kind, True)
        if taken is None:
            return -1
        _, found, rest = bytes(taken[0]).partition(b'stamp ')
        digits = rest.partition(b'\0')[0]
        return int(digits) if found and digits.isdigit() else -1
