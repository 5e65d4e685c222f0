"""The base class of the nodes of the loop: audit of the vehicle, streams, diagnostics."""

from collections import Counter
from collections.abc import Callable
from functools import partial
from math import inf
from time import monotonic
from typing import Any, ClassVar

import numpy as np
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import ERROR, SEVERITY, WARN, DiagnosticsPublisher, faults
from ca_ros.nodes.messages import speeds_stamp
from ca_ros.nodes.parameter_node import ParameterNode
from ca_ros.nodes.settings import FileSettings
from ca_ros.nodes.stream import Streams
from ca_ros.nodes.topics import Topic, offered, requested
from ca_ros.nodes.watchdog import TICK, Watchdog
from ca_ros.problem.audit import Audit, accept
from ca_ros.settings import Settings, repeated
from ca_ros.vehicle.tilts import Tilts
from ca_ros.vehicle.vehicle import Vehicle

NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
"""Each event handler costs a microsecond per command; `faults` replaces rclpy's."""


class VehicleNode(ParameterNode):
    """A node with the parameters of a vehicle; see `ParameterNode` for its arguments.

    A subclass defines `connect`, which calls `publish_stream` and `subscribe_stream`.
    """

    subject: ClassVar[str]
    """What its diagnostics are about, such as ``allocation``."""

    known: type[Settings] = FileSettings
    awaited: ClassVar[str] = 'command'
    """What the node cannot work without; its absence is a timeout."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        if self.unknown:
            self.get_logger().warning(f'no parameters of this node: {", ".join(self.unknown)}')
        self.audit: Audit | None = None
        self._logged_audit: Audit | None = None
        self.counts: Counter[str] = Counter()
        self.mode = str(self.settings.mode)
        self._watchdog = Watchdog()
        self._streams = Streams(self, self.mode, self.drop, self.counts)
        self.subscribe_stream = self._streams.subscribe
        self._offers: list[Publisher] = []
        self._logged: dict[str, float] = {}
        self._notes: list[tuple[bytes, str]] = []
        self._published: tuple[bytes, str] | None = None
        self._dropped_before = 0

    def start(self) -> None:
        """Build, connect, and start the diagnostics."""
        super().start()
        self.connect()
        self.start_diagnostics()

    def connect(self) -> None:
        """Create publishers and subscriptions, after the first `adopt`."""
        raise NotImplementedError

    def create_publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Create a publisher as rclpy does, but without rclpy's default event handlers."""
        return super().create_publisher(*args, **{'event_callbacks': NO_EVENTS, **kwargs})

    def audited(self, settings: Any) -> Audit:
        """Audit which axes the vehicle's rotors can control.

        Raises a ParameterError if an axis or hover is lost at the start, and
        `allocation.lost_axes` is refuse.
        """
        if self.audit is None:
            given = settings.vehicle, settings.rotors, settings.allocation
            self._declared = Vehicle.from_settings(*given)
            return accept(self._declared)
        # In a running node only health, servos and voltage change; lost axes are dropped, not
        # refused.
        vehicle = self._declared.with_stuck_servos(settings.rotors.stuck_servos)
        health = repeated('rotors.health', settings.rotors.health, vehicle.n)
        return accept(vehicle.with_health(health), 'drop')

    def _log_audit(self) -> None:
        """Log an audit that differs from the one before, after it was adopted: this takes long."""
        report, before = self.audit, self._logged_audit
        self._logged_audit = report
        if report is None or report is before:
            return
        if str(report) != str(before):
            # rclpy allows one severity for each line of code.
            if report.sound:
                self.get_logger().info(f'audit: {report}')
            else:
                self.get_logger().error(f'audit: {report}')
        for warning in report.warnings if before is None else ():
            self.get_logger().warning(warning)

    def _use(self, settings: Any, built: Any) -> None:
        super()._use(settings, built)
        self._watchdog.timeout = settings.command_timeout

    def listen(self, kind: type[Any], name: str, receive: Callable[[Any], None]) -> None:
        """Subscribe to the newest messages of a topic, without the checks of a stream."""
        self.create_subscription(kind, name, receive, requested('realtime'))

    def subscribe_commands(self, receive: Callable[..., None], tilts: Tilts | None) -> None:
        """Subscribe to rotor speeds; if rotors tilt, to pairs of speeds and angles by stamp."""
        if tilts is None:
            self.subscribe_stream(topics.SPEED_COMMAND, receive)
            return
        waiting: dict[str, Float64MultiArray] = {}

        def join(own: str, other: str, message: Float64MultiArray) -> None:
            if own in waiting:
                self.counts['without the other part'] += 1
                self.warn_throttled('part', f'{own} without {other} of the same stamp: not used')
            waiting[own] = message
            if other in waiting and speeds_stamp(waiting[other]) == speeds_stamp(message):
                receive(*[waiting.pop(name) for name in names])

        pair = topics.SPEED_COMMAND, topics.TILT_COMMAND
        names = [topic.name for topic in pair]
        for topic, other in zip(pair, reversed(names), strict=True):
            self.subscribe_stream(topic, partial(join, topic.name, other))

    def publish_stream(self, topic: Topic) -> Publisher:
        """Create the publisher of a topic; it should be the only one."""
        publisher = self.create_publisher(topic.kind, topic.name, offered(self.mode))
        self._offers.append(publisher)
        return publisher

    def drop(self, reason: str, what: str) -> None:
        """Count a message that is not served, and log the reason, rate limited."""
        self.counts[f'dropped: {reason}'] += 1
        self.warn_throttled(reason, f'dropped: {what}')

    def warn_throttled(self, reason: str, what: str) -> None:
        """Log a warning, at most once a second for each reason."""
        if self.may_log(reason):
            self.get_logger().warning(what)

    def may_log(self, reason: str) -> bool:
        """Return True at most once a second for each reason, by the steady clock."""
        now = monotonic()
        if now < self._logged.get(reason, -inf) + 1.0:
            return False
        self._logged[reason] = now
        return True

    def start_diagnostics(self) -> None:
        """Start to publish /diagnostics, once a second and on change, and to call `watch`."""
        self._log_audit()
        self._looked = monotonic()
        self._diagnostics = DiagnosticsPublisher(self, self.hardware_id)
        self.create_timer(TICK, self._tick, clock=self.steady)

    @property
    def hardware_id(self) -> str:
        """What the diagnostics are about."""
        return str(self.settings.vehicle.name)

    def levels(self) -> list[tuple[bytes, str]]:
        """Return the levels of the diagnostics with their messages."""
        levels = [*self._notes]
        if self.audit is not None and not self.audit.sound:
            levels.append((ERROR, str(self.audit)))
        expired = ERROR, f'{self.missing}{self._action(": ")}'
        return [*levels, expired if self._watchdog.expired else self.state()]

    def state(self) -> tuple[bytes, str]:
        """Return the level and the message of what the node does, if there is no timeout."""
        raise NotImplementedError

    def values(self) -> dict[str, object]:
        """Return the values of the diagnostics by name."""
        if self.audit is None:
            return dict(self.counts)
        vehicle = self.audit.vehicle
        failed = {'lost rotors': np.flatnonzero(vehicle.lost).tolist()}
        if vehicle.tilts is not None:
            failed['stuck servos'] = vehicle.tilts.stuck_rotors
        listed = {name: ', '.join(f'{i + 1}' for i in failed[name]) for name in failed}
        return {**{name: text or 'none' for name, text in listed.items()}, **self.counts}

    @property
    def missing(self) -> str:
        """What the logs and diagnostics say is missing."""
        return f'no {self.awaited}'

    def watch(self) -> None:
        """Check the timeout, except in lockstep; called every `TICK` seconds."""
        if self.mode == 'lockstep':
            return
        expired = self._watchdog.expired
        if self._watchdog.look():
            if self._watchdog.begun:
                self.counts['timeouts'] += 1
                since = f'{self._watchdog.timeout:g} s{self._action(": ")}'
                self.get_logger().error(f'{self.missing} for {since}')
            self.fall_back(self._action())
        elif expired:
            self.get_logger().info(f'{self.awaited}s have returned')

    def fall_back(self, action: str) -> None:
        """Do the timeout action, if the node has one; called at each check after the timeout."""

    def _action(self, before: str = '') -> str:
        """Return the timeout action after some text; nothing if the node has none."""
        action = getattr(self.settings, 'timeout_action', '')
        return f'{before}{action}' if action else ''

    def _tick(self) -> None:
        now = monotonic()
        self._streams.look()
        self.watch()
        self._log_audit()
        if now >= self._looked + 1.0:
            self._looked = now
            self._look_around()
        elif self._status() != self._published:
            self._publish_status()

    def _status(self) -> tuple[bytes, str]:
        """Return the worst level, and all messages, those of the worst level first."""
        levels = sorted(self.levels(), key=lambda each: SEVERITY.index(each[0]), reverse=True)
        return levels[0][0], '; '.join(message for _, message in levels)

    def _publish_status(self) -> None:
        self._published = self._status()
        self._diagnostics.publish((self.subject, *self._published, self.values()))

    def _look_around(self) -> None:
        """Report faults of endpoints, and how many messages were dropped since the last look."""
        streams = self._streams.subscriptions
        notes = [(WARN, fault) for fault in faults(self, streams, self._offers)]
        for note in notes:
            if note not in self._notes:
                self.get_logger().warning(note[1])
        dropped = sum(self.counts[key] for key in self.counts if key.startswith('dropped'))
        if dropped > self._dropped_before:
            notes.append((WARN, f'{dropped - self._dropped_before} dropped in a second'))
        self._dropped_before = dropped
        self._notes = notes
        self._publish_status()
