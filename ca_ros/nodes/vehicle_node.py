"""What the three nodes have in common: the parameters of a vehicle, and being observed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import inf
from time import monotonic
from typing import Any, ClassVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Infinite
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ca_ros.nodes.diagnostics import ERROR, WARN, Diagnostics
from ca_ros.nodes.executor import Executor
from ca_ros.nodes.parameters import NODE
from ca_ros.nodes.qos import offered, requested
from ca_ros.nodes.watchdog import TICK
from ca_ros.problem.audit import Audit, accept
from ca_ros.schema import PARAMETERS, REQUIRED, MissingParameterError, complete
from ca_ros.schema import Parameter as Declared
from ca_ros.vehicle.vehicle import Vehicle

NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
"""Each event costs every command half a microsecond; `mismatch` says what rclpy's would."""

SIZE_MAX = 16384
"""Of a stream's message [bytes]: 2000 rotor speeds."""

RMWError = rclpy_implementation.RMWError


def explicit(profile: QoSProfile) -> QoSProfile:
    """Return what decides about a match, with infinity for durations that are left open (zero)."""
    return QoSProfile(
        depth=1,
        reliability=profile.reliability,
        durability=profile.durability,
        deadline=profile.deadline if profile.deadline.nanoseconds else Infinite,
        liveliness=profile.liveliness,
        liveliness_lease_duration=profile.liveliness_lease_duration
        if profile.liveliness_lease_duration.nanoseconds
        else Infinite,
    )


def mismatch(
    other: TopicEndpointInfo,
    own: Publisher | Subscription,
    offered: QoSProfile,
    requested: QoSProfile,
) -> str | None:
    """Return why the two ends of a topic cannot match, if so.

    That they have not matched says little: they may be about to.
    """
    kind = own.msg_type
    if other.topic_type != f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}':
        return f'type: {other.topic_type}'
    compatibility, reason = qos_check_compatible(explicit(offered), explicit(requested))
    if compatibility == QoSCompatibility.ERROR:
        return f'quality of service: {reason.removeprefix("ERROR: ").rstrip(";")}'
    return None


class VehicleNode(Node):
    """A node with parameters of a vehicle, rebuilt as a whole when they change.

    Attributes
    ----------
    declared : mapping
        The parameters that the node declares, a table of `ca_ros.nodes.parameters`.
    """

    declared: ClassVar[Mapping[str, Declared]]
    audit: Audit | None = None

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.counts: Counter[str] = Counter()
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._streams: list[Subscription] = []
        self._offers: list[Publisher] = []
        self._said: dict[str, float] = {}
        self._notes: list[tuple[bytes, str]] = []
        self._dropped_before = 0
        given = {}
        for key, parameter in self.declared.items():
            descriptor = ParameterDescriptor(
                description=parameter.description,
                additional_constraints=parameter.range(),
                read_only=not parameter.mutable,
                dynamic_typing=True,
            )
            default = None if parameter.default is REQUIRED else parameter.default
            given[key] = self.declare_parameter(key, default, descriptor).value
        given.update({key: override.value for key, override in self._parameter_overrides.items()})
        try:
            self.parameters = complete(given, self.declared)
        except MissingParameterError as error:
            name = self.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None
        # The file of a vehicle has the parameters of all its nodes, and a file from
        # `ros2 param dump` has those of rclpy's topics.
        strangers = [
            key
            for key in self._parameter_overrides
            if key not in PARAMETERS
            and not self.has_parameter(key)
            and not key.startswith('qos_overrides.')
        ]
        if strangers:
            self.get_logger().warning(f'no parameters of this node: {", ".join(strangers)}')
        self._candidate: tuple[dict[str, Any], Any] | None = None
        self.mode = str(self.parameters['mode'])
        self._built = self.build(self.parameters)
        self.adopt(self._built)
        self.add_on_set_parameters_callback(self._consider)
        self.add_post_set_parameters_callback(self._accept)

    def audited(self, parameters: dict[str, Any]) -> Audit:
        """Return what the vehicle's rotors can command.

        Raises
        ------
        ParameterError
            If an axis or hover is lost at the start, and `allocation.lost_axes` is refuse.
        """
        # In flight lost axes are given up; nothing is refused.
        lost_axes = None if self.audit is None else 'drop'
        return accept(Vehicle.from_parameters(parameters), lost_axes)

    def note(self, report: Audit) -> None:
        """Keep an audit, and say it if it is another than before."""
        if str(report) != str(self.audit):
            if report.sound:
                self.get_logger().info(f'audit: {report}')
            else:
                self.get_logger().error(f'audit: {report}')
        self.audit = report

    def build(self, parameters: dict[str, Any]) -> Any:
        """Make what `adopt` will take over, of the parameters that are not in `NODE`.

        Raises
        ------
        ValueError
            If they are wrong.
        """
        raise NotImplementedError

    def adopt(self, built: Any) -> None:
        """Take over what `build` made, between two messages."""
        raise NotImplementedError

    def listen(self, kind: type, topic: str, receive: Callable[[Any], None]) -> None:
        """Subscribe to a stream that one publisher should send.

        Messages of more than `SIZE_MAX` bytes are dropped before they are converted.  Messages
        that were lost on their way, or replaced by a newer one before the node could take them,
        are counted while one publisher sends.
        """
        newest = 0

        def take(data: bytes, about: dict[str, Any]) -> None:
            nonlocal newest
            number = about.get('publication_sequence_number') or 0
            lost = number - newest - 1
            if newest and lost > 0 and stream.get_publisher_count() == 1:
                self.counts[f'lost: {topic}'] += lost
            newest = number
            fault, message = None, None
            if len(data) > SIZE_MAX:
                fault = 'size', f'{len(data)} bytes on {topic}: expected up to {SIZE_MAX}'
            else:
                try:
                    message = deserialize_message(data, kind)
                except RMWError:
                    fault = 'bytes', f'{len(data)} bytes on {topic} are no {kind.__name__}'
            if fault:
                self.counts['received'] += 1
                self.drop(*fault)
            else:
                receive(message)

        def forget(_: object) -> None:
            nonlocal newest
            newest = 0

        stream = self.create_subscription(
            kind,
            topic,
            take,
            requested(self.mode),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=forget, use_default_callbacks=False
            ),
        )
        self._streams.append(stream)

    def offer(self, kind: type, topic: str) -> Publisher:
        """Create the publisher of a stream that nobody else should send."""
        publisher = self.create_publisher(
            kind, topic, offered(self.mode), event_callbacks=NO_EVENTS
        )
        self._offers.append(publisher)
        return publisher

    def drop(self, reason: str, what: str) -> None:
        """Count a message that is not served, and say why now and then."""
        self.counts[f'dropped: {reason}'] += 1
        self.complain(reason, f'dropped: {what}')

    def complain(self, reason: str, what: str) -> None:
        """Log a warning, for each reason once a second at most; the system's clock may jump."""
        now = monotonic()
        if now >= self._said.get(reason, -inf) + 1.0:
            self._said[reason] = now
            self.get_logger().warning(what)

    def observe(self, subject: str) -> None:
        """Begin to give account of the node on /diagnostics: once a second, and on change."""
        self._looked = monotonic()
        vehicle = str(self.parameters['vehicle.name'])
        self._diagnostics = Diagnostics(self, subject, self.levels, self.values, vehicle)
        self.create_timer(TICK, self._tick, clock=self.steady)

    def levels(self) -> list[tuple[bytes, str]]:
        """Return what is to be said of the node, with its levels."""
        lost = self.audit is not None and not self.audit.sound
        return self._notes + ([(ERROR, str(self.audit))] if lost else [])

    def values(self) -> dict[str, object]:
        """Return details of the node by name."""
        return dict(self.counts)

    def watch(self) -> None:
        """Look at what does not come by itself; called every `TICK` seconds."""

    def close(self) -> None:
        """Say the last word before the node ends."""

    def _tick(self) -> None:
        now = monotonic()
        self.watch()
        if now >= self._looked + 1.0:
            self._looked = now
            self._look_around()
        else:
            self._diagnostics.update()

    def _look_around(self) -> None:
        """Note who is at the other ends of the topics, and whether something was dropped."""
        notes = []
        for stream in self._streams:
            topic = stream.topic_name
            if (matched := stream.get_publisher_count()) > 1:
                notes.append((WARN, f'{matched} publishers on {topic}'))
            for other in self.get_publishers_info_by_topic(topic):
                if fault := mismatch(other, stream, other.qos_profile, stream.qos_profile):
                    notes.append((WARN, f'a publisher on {topic} offers another {fault}'))
        for publisher in self.publishers:
            topic = publisher.topic_name
            if publisher in self._offers and (count := self.count_publishers(topic)) > 1:
                notes.append((WARN, f'{count} publishers on {topic}'))
            for other in self.get_subscriptions_info_by_topic(topic):
                if fault := mismatch(other, publisher, publisher.qos_profile, other.qos_profile):
                    notes.append((WARN, f'a subscriber to {topic} asks for another {fault}'))
        for _, note in notes:
            if (WARN, note) not in self._notes:
                self.get_logger().warning(note)
        dropped = sum(self.counts[key] for key in self.counts if key.startswith('dropped'))
        if dropped > self._dropped_before:
            notes.append((WARN, f'{dropped - self._dropped_before} dropped in a second'))
        self._dropped_before = dropped
        self._notes = notes
        self._diagnostics.publish()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, as rclpy does, all or none.

        Raises
        ------
        ParameterNotDeclaredException
            If the node does not declare one of them; unlike rclpy's, it names them.
        """
        unknown = [change.name for change in parameter_list if not self.has_parameter(change.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        return super().set_parameters_atomically(parameter_list)

    def _consider(self, changes: list[Parameter]) -> SetParametersResult:
        ours = {change.name: change.value for change in changes if change.name in self.declared}
        if not ours:
            return SetParametersResult(successful=True)
        # However many changes a client asks for, commands and timers wait for one at most.
        if isinstance(self.executor, Executor):
            self.executor.spin_streams(0.0)
        try:
            parameters = complete({**self.parameters, **ours}, self.declared)
            # A rebuild delays the motors and forgets critical regions.
            anew = any(name not in NODE for name in ours)
            self._candidate = parameters, self.build(parameters) if anew else self._built
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, _: list[Parameter]) -> None:
        if self._candidate is not None:
            self.parameters, self._built = self._candidate
            self._candidate = None
            self.adopt(self._built)
