"""The base class of the bridges: nodes that convert messages and compute nothing else."""

from collections.abc import Callable
from typing import Any, ClassVar

from rclpy.publisher import Publisher

from ca_ros.nodes.bridges.motors import order_of
from ca_ros.nodes.diagnostics import OK, STALE
from ca_ros.nodes.settings import BridgeNodeSettings
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.vehicle.tilts import refuse_tilts
from ca_ros.vehicle.vehicle import Vehicle


class Bridge(VehicleNode):
    """Passes messages on; those that cannot be converted are dropped and counted."""

    declared = BridgeNodeSettings
    settings: BridgeNodeSettings
    subject = 'bridge'
    takes_tilts: ClassVar[bool] = False
    vehicle: Vehicle

    def build(self, settings: BridgeNodeSettings) -> Vehicle:
        vehicle = Vehicle.from_settings(settings.vehicle, settings.rotors, settings.allocation)
        if not self.takes_tilts:
            refuse_tilts(vehicle.tilts, f'{self.get_name()} (unlike actuators_bridge)')
        return vehicle

    def adopt(self, built: Vehicle) -> None:
        self.vehicle = built
        self.order = order_of(self.settings.bridge.order, built.n)

    def state(self) -> tuple[bytes, str]:
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
                self.drop('content', str(error))
                return
            given = found if isinstance(found, tuple) else (found,)
            for publisher, each in zip(publishers, given, strict=True):
                publisher.publish(each)
            self.counts['served'] += 1

        return receive
