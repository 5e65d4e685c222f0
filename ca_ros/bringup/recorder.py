"""The recorder: a node that sends the waypoint and records the flight."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, Header

from ca_ros.arrays import Array
from ca_ros.control.waypoint import Waypoint
from ca_ros.errors import CaRosError
from ca_ros.nodes import topics
from ca_ros.nodes.link_faults import LINK_NAMES
from ca_ros.nodes.messages import (
    announcement,
    imu_arrays,
    nanoseconds,
    pose_message,
    speeds_stamp,
    stamp,
    wrench_numbers,
)
from ca_ros.nodes.topics import STANDING, Topic, deep
from ca_ros.parameter_files import DECLARED
from ca_ros.process.parameters import Call, ParameterClient
from ca_ros.process.processes import Deadline
from ca_ros.process.samples import SAMPLED, Samples
from ca_ros.settings import table
from ca_ros.simulation.record import Flight

DEMANDED = WRENCH, UNALLOCATED, RESIDUAL = tuple(
    topic.path for topic in (topics.WRENCH, topics.UNALLOCATED, topics.RESIDUAL))
"""The topics that tell what is demanded: commanded, cut by the controller, by the allocator."""

PARAMETERS_MAX = 5.0  # longest wait for a program's parameters, when all else is there [s]
OWN = topics.WRENCH.name, topics.SPEED_COMMAND.name  # links to which the recorder subscribes, too
RECENT = 1000  # wrenches that are kept before the flight: its first one is among the newest
NOTHING = 1e-6  # size of what counts as served in full [N, N m]


class Recorder(Node):
    """Sends the waypoint, and joins the messages of the simulator to samples by their stamps.

    `links` are topics that need a publisher and a subscriber before the flight starts.  The
    `foreign` nodes may lack parameters of ours, or have none.  `measures`: whether to record the
    measured rotor speeds, which slows lockstep by 3 to 5 %, and an Imu.
    """

    def __init__(
        self, links: Iterable[str] = LINK_NAMES, foreign: Collection[str] = (),
        node_name: str = 'recorder', measures: bool = False, **kwargs: Any,
    ) -> None:
        super().__init__(node_name, **kwargs)
        self._links, self._measures = links, measures
        self._waypoint = self._offer_waypoint()
        topic = topics.ANNOUNCED_HEALTH
        self._announced = self.create_publisher(topic.kind, topic.name, self._lasting())
        self._streams: list[tuple[Subscription, Callable[[Any], None]]] = []
        self._parameter_clients = {node: ParameterClient(self, node) for node in DECLARED}
        # The names come first: a request of a parameter that is not declared has no values.
        self._calls: dict[str, Call[list[Any]]] = {
            node: client.names() for node, client in self._parameter_clients.items()
        }
        self._names: dict[str, list[str]] = {}
        self._foreign = foreign
        self._patience = Deadline(PARAMETERS_MAX)
        self.parameters: dict[str, dict[str, Any]] = {}
        """The parameters of each running node that has answered, by name."""
        self.restart()

    def restart(self) -> None:
        """Discard the flight, with its messages in the queues."""
        self._goal: Waypoint | None = None
        self._stamped = False
        # The old publisher would send its last waypoint to the next controller.
        self.destroy_publisher(self._waypoint)
        self._waypoint = self._offer_waypoint()
        for stream, _ in self._streams:
            self.destroy_subscription(stream)
        # The deep queues of lockstep, so that no message is lost in real time either.
        quality = deep()
        self.samples = Samples()
        self.wrenches: dict[str, dict[int, tuple[float, ...]]] = {name: {} for name in DEMANDED}
        self._measured: dict[str, dict[int, Sequence[float]]] = {
            'measured': {}, 'specific_force': {}}
        receivers: dict[Topic, Callable[[Any], None]] = {
            topics.SPEED_COMMAND: self._receive_command,
            **{topic: partial(self.samples.add, topic.name) for topic in (*SAMPLED, topics.TILTS)},
        }
        if self._measures:
            receivers[topics.MEASURED_SPEEDS] = self._receive_measured
            receivers[topics.imu()] = self._receive_imu
        receivers |= {topic: partial(self._receive_wrench, topic.path)
                      for topic in (topics.WRENCH, topics.UNALLOCATED, topics.RESIDUAL)}
        self._streams = [
            (self.create_subscription(topic.kind, topic.path, receive, quality), receive)
            for topic, receive in receivers.items()
        ]

    def _offer_waypoint(self) -> Publisher:
        topic, events = topics.WAYPOINT, PublisherEventCallbacks(matched=self._greet)
        quality = self._lasting()
        return self.create_publisher(topic.kind, topic.name, quality, event_callbacks=events)

    @staticmethod
    def _lasting() -> QoSProfile:
        """Return the QoS of messages that late nodes get, too, all of them."""
        quality = deep()
        quality.durability = STANDING.durability
        return quality

    def drain(self) -> None:
        """Take all messages, in a fraction of the time of an executor."""
        for stream, receive in self._streams:
            with stream.handle:
                while taken := stream.handle.take_message(stream.msg_type, False):
                    receive(taken[0])
        if self.samples.start is None:
            # The flight begins with one of the newest samples.
            self.samples.forget(1_000_000_000)
            kept: list[dict[int, Any]] = [*self.wrenches.values(), *self._measured.values()]
            for stamps in kept:
                while len(stamps) > RECENT:
                    del stamps[next(iter(stamps))]

    def missing(self) -> list[str]:
        """Return the topics and services that are not connected yet."""
        lacking = [
            topic for topic in self._links if not self.count_publishers(topic)
            # The recorder itself subscribes to what is commanded.
            or self.count_subscribers(topic) <= (topic in OWN)
        ]
        if not self._waypoint.get_subscription_count():
            lacking.append(topics.WAYPOINT.name)
        if not self.samples.any_complete():
            lacking.append(f'{topics.SPEEDS.name} with the stamp of a pose and a velocity')
        for node in DECLARED:
            self._ask(node)
        silent = [node for node in DECLARED if node not in self.parameters]
        absent = [
            node for node in silent if node in self._foreign and not self._calls[node].ready()
        ]
        if lacking or {*absent} != {*silent}:
            self._patience = Deadline(PARAMETERS_MAX)
        elif self._patience.passed():
            self.parameters |= {node: {} for node in absent}
            return []
        return lacking + [f'{node}/get_parameters' for node in silent]

    def others(self, own: int = 0) -> list[str]:
        """Return the topics of the loop on which more than `own` nodes publish."""
        names = map(self.resolve_topic_name, [*self._links, topics.SPEEDS.name])
        return [name for name in names if self.count_publishers(name) > own]

    def _ask(self, node: str) -> None:
        """Take the parameters of a node once they have come."""
        if node in self.parameters or (answer := self._calls[node].answer()) is None:
            return
        if node in self._names:
            self.parameters[node] = dict(zip(self._names[node], answer, strict=True))
            return
        declared = table(DECLARED[node])
        names = self._names[node] = [name for name in declared if name in answer]
        if node not in self._foreign and len(names) < len(declared):
            raise CaRosError(
                f'{self.resolve_topic_name(node)} lacks parameters of the {node}: another node '
                'has its name; end it, or choose another --namespace'
            )
        self._calls[node] = self._parameter_clients[node].get(names)

    def send(self, waypoint: Waypoint, time: int = 0) -> None:
        """Send a waypoint; the flight begins when the rotors start.

        It holds from a stamp on [ns]; 0: at once.
        """
        if time:
            self._stamped = True
        else:
            self._goal = waypoint
        header = Header(stamp=stamp(time))
        self._waypoint.publish(pose_message(waypoint.position, waypoint.attitude, header))

    def announce(self, health: Array, stuck: Mapping[int, float], time: int = 0) -> None:
        """Announce the health (n,) of the rotors, and stuck servos: by rotor the angle [rad].

        It holds from a stamp on [ns]; 0: at once.
        """
        self._announced.publish(announcement(health, stuck, time or None))

    def deaf(self, nodes: Collection[str]) -> list[str]:
        """Return which of the nodes do not hear announcements."""
        topic = topics.ANNOUNCED_HEALTH.name
        heard = [each.node_name for each in self.get_subscriptions_info_by_topic(topic)]
        absent = [name for name in nodes if name not in heard]
        # A program of one's own may have another name.
        return absent if self._announced.get_subscription_count() < len(nodes) else []

    def delivered(self) -> bool:
        """Return whether all that was sent has been received."""
        limit = Duration(seconds=0.1)
        return all(each.wait_for_all_acked(limit) for each in (self._waypoint, self._announced))

    @property
    def waiting(self) -> bool:
        """Whether no waypoint has been sent yet."""
        return self._goal is None

    def _greet(self, event: QoSPublisherMatchedInfo) -> None:
        """Send the waypoint to a controller that starts late or was restarted."""
        if self._goal is not None and not self._stamped and event.current_count_change > 0:
            self.send(self._goal)

    @property
    def elapsed(self) -> int | None:
        """Time of the flight up to the last complete sample [ns]; None before the flight."""
        start, last = self.samples.start, self.samples.last
        return None if start is None or last is None else last - start

    def end(self, duration: float) -> int:
        """Return the stamp at which a flight of `duration` [s] ends [ns]."""
        return (self.samples.start or 0) + round(duration * 1e9)

    def flight(self, duration: float) -> Flight:
        """Return the complete samples of the first `duration` seconds."""
        origin = self.samples.start or 0
        flight = self.samples.flight(self.end(duration), origin)
        stamps = (np.round(flight.time * 1e9).astype(int) + origin).tolist()
        found: dict[str, Any] = {}
        for name, size in (('measured', flight.speeds.shape[1]), ('specific_force', 3)):
            numbers, none = self._measured[name], [np.nan] * size
            if numbers.keys() & {*stamps}:
                found[name] = np.array([numbers.get(time, none) for time in stamps])
        return replace(flight, **found)

    def _receive_measured(self, message: Float64MultiArray) -> None:
        if (time := speeds_stamp(message)) is not None:
            self._measured['measured'][time] = message.data

    def _receive_imu(self, message: Any) -> None:
        _, force = imu_arrays(message)
        self._measured['specific_force'][nanoseconds(message.header.stamp)] = force.tolist()

    def _receive_wrench(self, topic: str, message: WrenchStamped) -> None:
        self.wrenches[topic][nanoseconds(message.header.stamp)] = wrench_numbers(message)

    def cut(self) -> bool:
        """Return whether a demand of the flight was not served in full."""
        start = self.samples.start or 0
        return any(
            max(map(abs, wrench)) > NOTHING for name in (UNALLOCATED, RESIDUAL)
            for time, wrench in self.wrenches[name].items() if time >= start
        )

    def demanded(self, duration: float) -> dict[str, dict[int, tuple[float, ...]]]:
        """Return the wrenches of `DEMANDED` of a flight, by their times of flight [ns]."""
        start, end = self.samples.start or 0, self.end(duration)
        return {
            name: {time - start: wrench for time, wrench in stamps.items() if start <= time <= end}
            for name, stamps in self.wrenches.items()
        }

    def _receive_command(self, command: Float64MultiArray) -> None:
        """Begin the flight also where the first command turns no rotor, as in neutral buoyancy."""
        time = speeds_stamp(command)
        if time is not None and not any(command.data):
            self.samples.begin(time)
