"""The base class of the nodes that heed the monitor: allocator and controller."""

from __future__ import annotations

from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

from ca_ros.arrays import Array
from ca_ros.nodes import topics
from ca_ros.nodes.messages import speeds_stamp
from ca_ros.nodes.qos import STANDING
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.problem.audit import Audit, accept
from ca_ros.settings import repeated


class HealthNode(VehicleNode):
    """A node that subscribes to `rotor_health`.

    The health in use is the lesser of the parameter `rotors.health` and of the last sound
    message, for each rotor.  The last message holds if its publisher ends.
    """

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self._reported: Array | None = None
        self._reported_time = -1

    def start(self) -> None:
        """Build, and begin to listen to the monitor."""
        super().start()
        topic = topics.ROTOR_HEALTH
        self.create_subscription(topic.kind, topic.name, self._receive_health, STANDING)

    def audited(self, settings: Any) -> Audit:
        """Audit which axes the rotors can control with the health in use."""
        report = super().audited(settings)
        if self._reported is None:
            return report
        vehicle = report.full.vehicle
        return accept(vehicle.with_health(np.minimum(vehicle.health, self._reported)), 'drop')

    def values(self) -> dict[str, object]:
        """Return the values of the diagnostics by name."""
        if self.audit is None or self._reported is None:
            return super().values()
        health = ', '.join(f'{share:.3g}' for share in self.audit.vehicle.health)
        return {'health in use': health, **super().values()}

    def waits_for_health(self, time: int) -> bool:
        """Return whether the health for a state [ns] has still to come, in lockstep."""
        awaited = self.mode == 'lockstep' and bool(self.settings.await_health)
        return awaited and self._reported_time < time

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
            self._use()
        self._reported_time = -1 if time is None else time
        self.health_came()

    def _use(self) -> None:
        """Build for the health in use."""
        lockstep, settings = self.mode == 'lockstep', self.settings
        built = self.build(settings) if lockstep else self._build_beside(settings).result()
        self._built = built
        self.adopt(built)
        assert self._reported is not None
        parameter = repeated('rotors.health', settings.rotors.health, len(self._reported))
        reduced = ', '.join(map(str, np.flatnonzero(self._reported < parameter) + 1))
        found = f'rotors {reduced} have failed' if reduced else 'all rotors are as announced'
        self.get_logger().warning(f'the monitor reports: {found}')
