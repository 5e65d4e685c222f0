"""The watchdog for commands, and the rotor speeds of the timeout actions."""

from collections.abc import Callable
from time import monotonic

import numpy as np
from rclpy.node import Node

from ca_ros.arrays import Array
from ca_ros.nodes.diagnostics import ERROR, Diagnostics, Level
from ca_ros.nodes.parameters import Parameters
from ca_ros.vehicle.vehicle import Vehicle


class Watchdog:
    """Expires when commands cease, by the steady clock, since ROS time may pause or jump.

    The watchdog is asleep until the first command, because the rotors rest until then.  `expired`
    tells whether the timeout had passed at the last look, and `begun` whether that was the first
    look after it.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        self._timeout = timeout
        self.sleep()

    @property
    def timeout(self) -> float:
        """The longest time without a command [s]."""
        return self._timeout

    def sleep(self) -> None:
        """Be asleep until the next command."""
        self.expired = self.begun = self._over = False
        self._last: float | None = None

    @property
    def awake(self) -> bool:
        """Whether there has been a command."""
        return self._last is not None

    @property
    def over(self) -> bool:
        """Whether the timeout has passed; once `check` has seen it, only a command resets it."""
        return self._over or (self._last is not None and monotonic() > self._last + self.timeout)

    def feed(self) -> None:
        """Note a command."""
        self._last, self._over = monotonic(), False

    def check(self) -> bool:
        """Return whether the timeout has passed, and remember it."""
        before, self._over = self._over, self.over
        self.expired, self.begun = self._over, self._over and not before
        return self.expired


class CommandWatch(Watchdog):
    """The watchdog of a node, with its logs and the timeout action.

    `awaited`: what the node cannot work without.  `fall_back`: does a timeout action, at each
    check after the timeout.  `missing`: returns what logs and diagnostics say is missing.
    `replaced`: returns whether the node works on with something else, of which it says itself.
    """

    def __init__(
        self, node: Node, parameters: Parameters, diagnostics: Diagnostics,
        awaited: str = 'command', fall_back: Callable[[str], None] = lambda _: None,
        missing: Callable[[], str] | None = None, replaced: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__()
        self._node, self._parameters, self._counts = node, parameters, diagnostics.counts
        self._awaited, self._fall_back = awaited, fall_back
        self._missing, self._replaced = missing or (lambda: f'no {awaited}'), replaced

    @property
    def timeout(self) -> float:
        """The parameter `command_timeout` [s]."""
        return float(self._parameters.settings.command_timeout)

    @property
    def action(self) -> str:
        """The timeout action; empty if the node has none."""
        return getattr(self._parameters.settings, 'timeout_action', '')

    def watch(self) -> None:
        """Check the timeout, if the clock counts; called every `TICK` seconds."""
        if not self._parameters.mode.clocked:
            return
        before = self.expired
        if self.check():
            if self.begun:
                self._counts['timeouts'] += 1
                self._node.get_logger().error(f'{self._text(f" for {self.timeout:g} s")}')
            self._fall_back(self.action)
        elif before and not self._replaced():
            self._node.get_logger().info(f'{self._awaited}s have returned')

    def levels(self, state: Callable[[], Level]) -> list[Level]:
        """Return the level of the diagnostics: of the timeout, or else of what the node does."""
        return [(ERROR, self._text()) if self.expired else state()]

    def _text(self, since: str = '') -> str:
        return f'{self._missing()}{since}{f": {self.action}" if self.action else ""}'


def fallback(action: str, vehicle: Vehicle, last: Array) -> Array:
    """Return rotor speeds (n,) [rad/s]: idle, the nearest to zero; stop, zero; hold, the last.

    Tilt angles, which follow the speeds in `last`, stay.
    """
    if action == 'hold':
        return last
    speeds = vehicle.idle_speeds if action == 'idle' else np.zeros(vehicle.n)
    return np.concatenate([speeds, last[vehicle.n :]])
