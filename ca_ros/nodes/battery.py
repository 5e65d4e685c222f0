"""The voltage of the battery, on which the speeds of some rotors depend."""

from collections.abc import Callable
from math import inf
from time import monotonic
from typing import Any

from rclpy.node import Node

from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import WARN, Diagnostics, Level
from ca_ros.nodes.stream import Streams
from ca_ros.settings import ParameterError

TIMEOUT = 5.0
"""Time without a sound voltage, after there was one, from which a warning begins [s]."""


class Battery:
    """Listens to `battery`; the last sound voltage holds.

    `take`: takes a voltage [V]; raises a ParameterError if the battery cannot have it.
    """

    def __init__(
        self, node: Node, diagnostics: Diagnostics, take: Callable[[float], None]
    ) -> None:
        self._node, self._diagnostics, self._take = node, diagnostics, take
        self._voltage, self._time = 0.0, inf

    def subscribe(self, streams: Streams) -> None:
        """Subscribe to the topic."""
        try:
            # Only vehicles whose voltage matters need the package of the message.
            from sensor_msgs.msg import BatteryState
        except ImportError as error:
            self._node.get_logger().warning(f'{error}: the voltage on battery is not read')
            return
        streams.listen(BatteryState, topics.BATTERY, self._receive)

    def _receive(self, message: Any) -> None:
        voltage = float(message.voltage)
        try:
            self._take(voltage)
        except ParameterError as error:
            self._diagnostics.counts['refused voltages'] += 1
            self._diagnostics.warn('voltage', f'refused {error}')
            return
        self._voltage, self._time = voltage, monotonic()

    def levels(self) -> list[Level]:
        """Return whether a sound voltage has not come for long."""
        if monotonic() - self._time <= TIMEOUT:
            return []
        return [(WARN, f'no sound voltage for {TIMEOUT:g} s: {self._voltage:.4g} V holds')]
