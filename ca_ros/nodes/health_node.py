"""The base class of the nodes that heed monitor and battery: allocator and controller."""

from time import monotonic
from typing import Any, ClassVar

import numpy as np
from std_msgs.msg import Float64MultiArray

from ca_ros.arrays import Array
from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import WARN
from ca_ros.nodes.messages import speeds_stamp
from ca_ros.nodes.topics import STANDING
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.problem.audit import Audit, accept
from ca_ros.settings import ParameterError, repeated

VOLTAGE_STEP = 0.005  # relative change of the voltage from which the bounds follow it


class HealthNode(VehicleNode):
    """A node that subscribes to `rotor_health`, and to `battery` if the voltage matters.

    The health in use is the lesser of the parameter `rotors.health` and of the last sound
    message, for each rotor.  The last message holds if its publisher ends, with a warning, and so
    does the last sound voltage; before the first one, the bounds are those of the settings.
    """

    heeds_monitor: ClassVar[bool] = True

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self._reported: Array | None = None
        self._reported_time = -1
        self._voltage: float | None = None
        self._voltage_time: float | None = None

    def connect(self) -> None:
        if not self.heeds_monitor:
            return
        topic = topics.ROTOR_HEALTH
        self.create_subscription(topic.kind, topic.name, self._receive_health, STANDING)
        if not np.any(self.settings.rotors.speed_max_per_volt):
            return
        try:
            # Only vehicles whose voltage matters need the package of the message.
            from sensor_msgs.msg import BatteryState
        except ImportError as error:
            self.get_logger().warning(f'{error}: the voltage on battery is not read')
            return
        self._voltage_time = monotonic()
        self.listen(BatteryState, topics.BATTERY, self._receive_battery)

    def audited(self, settings: Any) -> Audit:
        report = super().audited(settings)
        if self._reported is None and self._voltage is None:
            return report
        vehicle = report.full.vehicle
        if self._reported is not None:
            vehicle = vehicle.with_health(np.minimum(vehicle.health, self._reported))
        if self._voltage is not None:
            vehicle = vehicle.at_voltage(self._voltage)
        return accept(vehicle, 'drop')

    def values(self) -> dict[str, object]:
        found = super().values()
        if self.audit is not None and self._reported is not None:
            shares = ', '.join(f'{share:.3g}' for share in self.audit.vehicle.health)
            found = {'health in use': shares, **found}
        if self._voltage is not None:
            found = {'voltage in use [V]': f'{self._voltage:.4g}', **found}
        return found

    def levels(self) -> list[tuple[bytes, str]]:
        levels = super().levels()
        if self._reported is not None and not self.count_publishers(topics.ROTOR_HEALTH.name):
            levels.insert(0, (WARN, 'the monitor has ended: its last rotor_health holds'))
        if self._voltage_time is None:
            return levels
        age, limit = monotonic() - self._voltage_time, self.settings.battery_timeout
        if not 0.0 < limit < age:
            return levels
        held = 'the declared one' if self._voltage is None else f'{self._voltage:.4g} V'
        return [(WARN, f'no sound voltage for {limit:g} s: {held} holds'), *levels]

    def waits_for_health(self, time: int) -> bool:
        """Return whether the health for a state [ns] has still to come, in lockstep."""
        heeds = self.heeds_monitor and self.mode == 'lockstep'
        return heeds and self.settings.await_health and self._reported_time < time

    def health_came(self) -> None:
        """Answer what waited for the health; a subclass defines it."""

    def _receive_health(self, message: Float64MultiArray) -> None:
        assert self.audit is not None
        health, n = np.array(message.data), self.audit.vehicle.n
        time = speeds_stamp(message)
        if health.shape != (n,) or not ((health >= 0.0) & (health <= 1.0)).all():
            self.counts['refused health'] += 1
            what = f'refused rotor health {health}: expected {n} numbers in [0, 1]'
            self.warn_throttled('health', what)
            return
        before = np.ones(n) if self._reported is None else self._reported
        self._reported = health
        if not np.array_equal(health, before):
            self._rebuild()
            parameter = repeated('rotors.health', self.settings.rotors.health, n)
            reduced = [f'rotor {i + 1}' for i in np.flatnonzero(health < parameter)]
            found = f'failed: {", ".join(reduced)}' if reduced else 'all rotors are as announced'
            self.get_logger().warning(f'the monitor reports: {found}')
        self._reported_time = -1 if time is None else time
        self.health_came()

    def _receive_battery(self, message: Any) -> None:
        voltage = float(message.voltage)
        try:
            self._declared.at_voltage(voltage)
        except ParameterError as error:
            self.counts['refused voltages'] += 1
            self.warn_throttled('voltage', f'refused {error}')
            return
        self._voltage_time = monotonic()
        before = self._voltage
        if before is None or abs(voltage - before) > VOLTAGE_STEP * before:
            self._voltage = voltage
            self._rebuild()

    def _rebuild(self) -> None:
        """Build for the health and the voltage in use, between two messages."""
        self._use(self.settings, self.build(self.settings))
