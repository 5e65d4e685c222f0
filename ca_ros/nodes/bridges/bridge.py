"""The base class of the bridges: nodes that convert messages and compute nothing else."""

from collections.abc import Callable
from typing import Any, ClassVar

from rclpy.node import Node
from rclpy.publisher import Publisher

from ca_ros.nodes.bridges.motors import order_of
from ca_ros.nodes.diagnostics import OK, STALE, Diagnostics, Level
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.settings import BridgeNodeSettings
from ca_ros.nodes.stream import Streams
from ca_ros.vehicle.tilts import refuse_tilts
from ca_ros.vehicle.vehicle import Vehicle


class Bridge(Node):
    """Passes messages on; those that cannot be converted are dropped and counted.

    A subclass creates its publishers and subscriptions.  The arguments are those of
    `rclpy.node.Node`.  Raises a ParameterError if a parameter is missing or wrong.
    """

    declared = BridgeNodeSettings
    takes_tilts: ClassVar[bool] = False

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared)
        self.settings = settings = self.parameters.settings
        self._adopt(self._prepare(settings))
        self.parameters.on_change(self._prepare, self._adopt)
        self.order = order_of(settings.bridge.order, self.vehicle.n)
        self.diagnostics = Diagnostics(self, 'bridge', str(settings.vehicle.name))
        self.counts = self.diagnostics.counts
        self.streams = Streams(self, settings.mode, self.diagnostics.drop, self.counts)
        self.diagnostics.start(lambda: [self._state()], lambda: self.counts, self.streams)

    def _prepare(self, settings: BridgeNodeSettings) -> Vehicle:
        vehicle = Vehicle.from_settings(settings.vehicle, settings.rotors, settings.allocation)
        if not self.takes_tilts:
            refuse_tilts(vehicle.tilts, f'{self.get_name()} (unlike actuators_bridge)')
        return vehicle

    def _adopt(self, vehicle: Vehicle) -> None:
        self.vehicle, self.settings = vehicle, self.parameters.settings

    def _state(self) -> Level:
        return (OK, 'passes on') if self.counts['served'] else (STALE, 'nothing to pass on yet')

    def passes(self, convert: Callable[..., Any], *publishers: Publisher) -> Any:
        """Return a callback that converts messages and publishes the result, or each of several.

        `convert` raises a ValueError for messages that it cannot convert.
        """

        def receive(*messages: Any) -> None:
            self.counts['received'] += 1
            try:
                found = convert(*messages)
            except ValueError as error:
                self.diagnostics.drop('content', str(error))
                return
            given = found if isinstance(found, tuple) else (found,)
            for publisher, each in zip(publishers, given, strict=True):
                publisher.publish(each)
            self.counts['served'] += 1

        return receive
