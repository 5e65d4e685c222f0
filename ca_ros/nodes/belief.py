"""What a node believes of the vehicle: its parameters, and what others report."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from ca_ros.allocation.reconfiguration import Failures, Reconfiguration
from ca_ros.nodes import topics
from ca_ros.nodes.battery import Battery
from ca_ros.nodes.diagnostics import ERROR, WARN, Diagnostics, Level
from ca_ros.nodes.messages import read_announcement, speeds_stamp
from ca_ros.nodes.monitored_health import MonitoredHealth
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import Streams
from ca_ros.nodes.topics import standing
from ca_ros.problem.audit import Audit
from ca_ros.settings import ParameterError
from ca_ros.vehicle.motors import HEALTH_MIN

Make = Callable[[Any, Audit, Any], Any]


class Belief:
    """Keeps a `Reconfiguration` up to date: with the parameters, and with topics.

    The health in use is the least, for each rotor, of the parameter `rotors.health` and of the
    last sound messages on `rotor_health` and `rotor_health/announced`; the second one may also
    name servos that stick.  The last message on `rotor_health` holds if its publisher ends, with a
    warning, and what it says of failures also if another one starts, until that is reset; the
    other one is told.  So does the last sound voltage on `battery`; before the first one, the
    bounds are those of the settings.

    - `make`: see `Reconfiguration`
    - `changed`: called when something else is in force; it only assigns
    - `monitored`: what monitors say
    """

    made_by: ClassVar[Any] = Reconfiguration
    health_topic: ClassVar[str] = topics.ROTOR_HEALTH.name
    sound: ClassVar[str] = 'no rotor below the parameter rotors.health'
    stuck: ClassVar[tuple[str, str]] = 'servos', 'servo of rotor {} stuck at {:g} rad'
    """What may stick, and how a log says so."""

    def __init__(
        self, node: Node, parameters: Parameters, diagnostics: Diagnostics, make: Make,
        changed: Callable[[], None],
    ) -> None:
        self._node, self._parameters, self._diagnostics = node, parameters, diagnostics
        self._changed = changed
        self.current = self.made_by(parameters.settings, make)
        parameters.on_change(self.current.prepare, self._use)
        self.monitored = MonitoredHealth(node, parameters.mode, self._accepts, self._believe)
        self._battery = Battery(node, diagnostics, self._measure)
        self._logged_audit: Audit | None = None
        self._logged_reports: dict[str, tuple[Failures, str]] = {}
        self._logged_fault = ''

    @property
    def built(self) -> Any:
        """What was made for the belief in force."""
        return self.current.in_force.built

    @property
    def audit(self) -> Audit:
        """The audit of the belief in force."""
        return self.current.in_force.audit

    def subscribe(
        self, streams: Streams, answer: Callable[[], None], tells: bool = False
    ) -> None:
        """Subscribe to what is said of the health, and to `battery` if the voltage matters.

        `answer` and `tells`: see `MonitoredHealth.subscribe`.
        """
        self.monitored.subscribe(streams, answer, tells)
        self.subscribe_announcements(streams)
        if np.any(self._parameters.settings.rotors.speed_max_per_volt):
            self._battery.subscribe(streams)

    def subscribe_announcements(self, streams: Streams) -> None:
        """Subscribe to what is announced."""
        topic, quality = topics.ANNOUNCED_HEALTH, standing(self._parameters.mode.name)
        streams.listen(topic.kind, topic.name, self._receive_announcement, quality)

    def log(self) -> None:
        """Log what has changed since the last call: not while a command waits."""
        for name, reported in self.current.reported.items():
            newest, text = self._logged_reports.get(name, (None, self.sound))
            if reported is not newest:
                now = self.reductions(reported)
                self._logged_reports[name] = reported, now
                if now != text:
                    self._node.get_logger().warning(f'{name}: {now}')
        fault = self.current.fault
        if fault != self._logged_fault:
            self._logged_fault = fault
            text = f'not in force: {fault}' if fault else 'what is believed is in force again'
            self._node.get_logger().error(text)
        report, before = self.audit, self._logged_audit
        if report is before:
            return
        self._logged_audit = report
        if self._news(report) != (before and self._news(before)):
            # rclpy allows one severity for each line of code.
            if not self._faulty:
                self._node.get_logger().info(f'audit: {report.summary}')
            else:
                self._node.get_logger().error(f'audit: {report.summary}')
        for warning in report.warnings if before is None else ():
            self._node.get_logger().warning(warning)

    def levels(self) -> list[Level]:
        """Return what is wrong with the vehicle and with those who report of it."""
        found = self._battery.levels()
        topic = self.health_topic
        if topic in self.current.reported and not self._node.count_publishers(topic):
            found.append((WARN, f'the publisher of {topic} has ended: its last one holds'))
        for failures in self.monitored.others:
            if (text := self.reductions(failures)) != self.sound:
                found.append((WARN, f'another monitor found, until monitor/reset: {text}'))
        if self.current.fault:
            found.append((ERROR, f'not in force: {self.current.fault}'))
        return [*found, (ERROR, self.audit.summary)] if self._faulty else found

    def _news(self, report: Audit) -> str:
        """Return what is logged when it changes."""
        return report.summary

    @property
    def _faulty(self) -> bool:
        """Whether the audit is an error."""
        return not self.audit.sound

    def values(self) -> Mapping[str, object]:
        """Return what is in force, for the diagnostics."""
        now, found = self.current.in_force, dict[str, object]()
        health, _, stuck = now.failures
        if now.voltage is not None:
            found['voltage in use [V]'] = f'{now.voltage:.4g}'
        if self.current.reported:
            found['health in use'] = ', '.join(f'{share:.3g}' for share in health)
        lost = (np.flatnonzero(health < HEALTH_MIN) + 1).tolist()
        found[f'lost {self.current.effector}s'] = ', '.join(map(str, lost)) or 'none'
        if stuck:
            found[f'stuck {self.stuck[0]}'] = ', '.join(map(str, stuck))
        waiting = self._parameters.mode.values()
        return {**found, **waiting, 'last build [ms]': f'{1e3 * now.duration:.2f}'}

    def _use(self, prepared: Any) -> None:
        self.current.apply(prepared)
        self._notify()

    def _notify(self) -> None:
        self._changed()
        self._diagnostics.wait()

    def report(self, name: str, *said: Any) -> bool:
        """Believe what is reported on a topic; return whether it is sound."""
        try:
            if self.current.report(name, *said):
                self._notify()
        except ParameterError as error:
            self._refuse(str(error))
            return False
        return True

    def _refuse(self, why: str) -> None:
        self._diagnostics.counts['refused health'] += 1
        self._diagnostics.warn('health', f'refused {why}')

    def _receive_announcement(
        self, message: Float64MultiArray, name: str = topics.ANNOUNCED_HEALTH.name
    ) -> None:
        full = self.audit.full
        try:
            said = read_announcement(message, len(full.health), full.effector_kind)
            self.current.check(*said)
        except ParameterError as error:
            self._refuse(f'{name}: {error}')
            return
        stamp = speeds_stamp(message) or 0
        if not self._parameters.mode.take(stamp, name, partial(self.report, name, *said)):
            self._refuse(f'{name}: too many announcements before their stamps')

    def _accepts(self, said: Failures) -> bool:
        try:
            self.current.check(said.health, None, said.arms)
        except ParameterError as error:
            self._refuse(str(error))
            return False
        return True

    def _believe(self, said: Failures) -> None:
        self.report(topics.ROTOR_HEALTH.name, said.health, None, said.arms)

    def _measure(self, voltage: float) -> None:
        if self.current.measure(voltage):
            self._notify()

    def reductions(self, said: Failures) -> str:
        """Return in words where a report is below the parameter, and what sticks."""
        health, _, stuck = said
        parameter = self.current.own(self._parameters.settings).health
        below = np.flatnonzero(health < parameter).tolist()
        found = [f'{self.current.effector} {i + 1} at {health[i]:.3g}' for i in below]
        found += [self.stuck[1].format(*pair) for pair in stuck.items()]
        return ', '.join(found) or self.sound

