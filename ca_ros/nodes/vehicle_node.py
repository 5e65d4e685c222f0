"""The base class of the nodes: parameters of a vehicle, streams, diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import inf
from time import monotonic
from typing import Any, ClassVar, cast

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Infinite
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ca_ros.nodes.diagnostics import ERROR, WARN, Diagnostics
from ca_ros.nodes.executor import Executor
from ca_ros.nodes.parameters import NODE, PARAMETERS
from ca_ros.nodes.qos import offered, requested
from ca_ros.nodes.rclpy_internals import RMWError, given_parameters
from ca_ros.nodes.topics import Topic, type_name
from ca_ros.nodes.watchdog import TICK
from ca_ros.problem.audit import Audit, accept
from ca_ros.schema import REQUIRED, MissingParameterError, check_given, complete
from ca_ros.schema import Parameter as Declared
from ca_ros.vehicle.vehicle import Vehicle

NO_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
"""Each event handler costs half a microsecond per command; `mismatch` replaces rclpy's."""

SIZE_MAX = 16384
"""Largest message of a stream [bytes]: 2000 rotor speeds."""


def explicit(profile: QoSProfile) -> QoSProfile:
    """Return the policies that decide about a match; unset durations (zero) become infinite."""
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
    """Return why a publisher and a subscription cannot match; None if they can.

    The number of matches does not tell, because discovery takes time.
    """
    if other.topic_type != type_name(own.msg_type):
        return f'type: {other.topic_type}'
    compatibility, reason = qos_check_compatible(explicit(offered), explicit(requested))
    if compatibility == QoSCompatibility.ERROR:
        return f'quality of service: {reason.removeprefix("ERROR: ").rstrip(";")}'
    return None


class VehicleNode(Node):
    """A node with the parameters of a vehicle.

    A change of parameters takes effect completely or not at all.  The constructor of a subclass
    calls `configure`, once all is there that its `build` and `adopt` use; then `offer` and
    `listen` for its topics; and `observe` at its end.

    Parameters
    ----------
    node_name : str
    **kwargs
        As for `rclpy.node.Node`: context, namespace, parameter_overrides and others.

    Raises
    ------
    ParameterError
        If a parameter is missing or wrong.

    Attributes
    ----------
    declared : mapping
        The parameters that the node declares, a table of `ca_ros.nodes.parameters`.
    """

    declared: ClassVar[Mapping[str, Declared]]

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.audit: Audit | None = None
        self.counts: Counter[str] = Counter()
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._streams: list[Subscription] = []
        self._offers: list[Publisher] = []
        self._logged: dict[str, float] = {}
        self._notes: list[tuple[bytes, str]] = []
        self._dropped_before = 0
        self._candidate: tuple[dict[str, Any], Any] | None = None
        self.parameters: dict[str, Any] = self._declare()
        self.mode = str(self.parameters['mode'])

    def _declare(self) -> dict[str, Any]:
        """Declare the parameters and return their values by name."""
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
        overrides = given_parameters(self)
        values = {key: override.value for key, override in overrides.items()}
        check_given(values, PARAMETERS)
        given.update(values)
        try:
            parameters = complete(given, self.declared)
        except MissingParameterError as error:
            name = self.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None
        # The file of a vehicle has the parameters of all its nodes, and files from
        # `ros2 param dump` have those of rclpy's own topics.
        unknown = [
            key
            for key in overrides
            if key not in PARAMETERS
            and not self.has_parameter(key)
            and not key.startswith('qos_overrides.')
        ]
        if unknown:
            self.get_logger().warning(f'no parameters of this node: {", ".join(unknown)}')
        return parameters

    def configure(self) -> None:
        """Build and adopt from the parameters, now and on each change of them."""
        self._built = self.build(self.parameters)
        self.adopt(self._built)
        self.add_on_set_parameters_callback(self._consider)
        self.add_post_set_parameters_callback(self._accept)

    def destroy_node(self) -> None:
        """Let the node send its last messages (`close`) and destroy it."""
        try:
            self.close()
        finally:
            super().destroy_node()

    def audited(self, parameters: dict[str, Any]) -> Audit:
        """Audit what the vehicle's rotors can command.

        Raises
        ------
        ParameterError
            If an axis or hover is lost at the start, and `allocation.lost_axes` is refuse.
        """
        # A running node drops lost axes; only the start refuses them.
        lost_axes = None if self.audit is None else 'drop'
        return accept(Vehicle.from_parameters(parameters), lost_axes)

    def note(self, report: Audit) -> None:
        """Keep an audit, and log it if it differs from the one before."""
        if str(report) != str(self.audit):
            if report.sound:
                self.get_logger().info(f'audit: {report}')
            else:
                self.get_logger().error(f'audit: {report}')
        self.audit = report

    def build(self, parameters: dict[str, Any]) -> Any:
        """Return what `adopt` takes over, made from the parameters that are not in `NODE`.

        Raises
        ------
        ValueError
            If the parameters are wrong.
        """
        raise NotImplementedError

    def adopt(self, built: Any) -> None:
        """Take over what `build` returned; called between two messages."""
        raise NotImplementedError

    def listen(self, topic: Topic, receive: Callable[[Any], None]) -> None:
        """Subscribe to a stream that should have one publisher.

        Messages of more than `SIZE_MAX` bytes are dropped before conversion.  While there is one
        publisher, the node counts the messages that were lost in transport or replaced by a newer
        message before it took them.
        """
        kind, name = topic.kind, topic.name
        newest = 0

        def take(data: bytes, about: dict[str, Any]) -> None:
            nonlocal newest
            number = about.get('publication_sequence_number') or 0
            lost = number - newest - 1
            if newest and lost > 0 and stream.get_publisher_count() == 1:
                self.counts[f'lost: {name}'] += lost
            newest = number
            fault, message = None, None
            if len(data) > SIZE_MAX:
                fault = 'size', f'{len(data)} bytes on {name}: expected up to {SIZE_MAX}'
            else:
                try:
                    message = deserialize_message(data, kind)
                except RMWError:
                    fault = 'bytes', f'{len(data)} bytes on {name} are no {kind.__name__}'
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
            name,
            # rclpy's annotation leaves out callbacks that take the information, too.
            cast('Callable[[bytes], None]', take),
            requested(self.mode),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                matched=forget, use_default_callbacks=False
            ),
        )
        self._streams.append(stream)

    def offer(self, topic: Topic) -> Publisher:
        """Create the publisher of a stream; it should be the only one."""
        publisher = self.create_publisher(
            topic.kind, topic.name, offered(self.mode), event_callbacks=NO_EVENTS
        )
        self._offers.append(publisher)
        return publisher

    def drop(self, reason: str, what: str) -> None:
        """Count a message that is not served, and log the reason, rate limited."""
        self.counts[f'dropped: {reason}'] += 1
        self.complain(reason, f'dropped: {what}')

    def complain(self, reason: str, what: str) -> None:
        """Log a warning, for each reason once a second at most, by the steady clock."""
        now = monotonic()
        if now >= self._logged.get(reason, -inf) + 1.0:
            self._logged[reason] = now
            self.get_logger().warning(what)

    def observe(self, subject: str) -> None:
        """Start to publish /diagnostics, once a second and on change, and to call `watch`."""
        self._looked = monotonic()
        vehicle = str(self.parameters['vehicle.name'])
        self._diagnostics = Diagnostics(self, subject, self.levels, self.values, vehicle)
        self.create_timer(TICK, self._tick, clock=self.steady)

    def levels(self) -> list[tuple[bytes, str]]:
        """Return the levels of the diagnostics with their messages."""
        lost = self.audit is not None and not self.audit.sound
        return self._notes + ([(ERROR, str(self.audit))] if lost else [])

    def values(self) -> dict[str, object]:
        """Return the values of the diagnostics by name."""
        return dict(self.counts)

    def watch(self) -> None:
        """Check the timeouts; called every `TICK` seconds."""

    def close(self) -> None:
        """Send the last messages; called before the node is destroyed."""

    def _tick(self) -> None:
        now = monotonic()
        self.watch()
        if now >= self._looked + 1.0:
            self._looked = now
            self._look_around()
        else:
            self._diagnostics.update()

    def _look_around(self) -> None:
        """Note surplus publishers, publishers and subscribers that cannot match, and drops."""
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
        # A client may ask for many changes at once; commands and timers wait for one at most.
        if isinstance(self.executor, Executor):
            self.executor.spin_streams(0.0)
        try:
            parameters = complete({**self.parameters, **ours}, self.declared)
            # A rebuild takes time and forgets the cached critical regions: only where necessary.
            rebuild = any(name not in NODE for name in ours)
            self._candidate = parameters, self.build(parameters) if rebuild else self._built
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, _: list[Parameter]) -> None:
        if self._candidate is not None:
            self.parameters, self._built = self._candidate
            self._candidate = None
            self.adopt(self._built)
