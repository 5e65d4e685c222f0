"""The recorder: a node that sends the waypoint and gathers the flight."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from time import monotonic
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rcl_interfaces.srv import GetParameters
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray

from ca_ros.bringup.link_faults import LINKS
from ca_ros.flight.controller import Waypoint
from ca_ros.flight.parameters import SIMULATOR
from ca_ros.flight.record import Flight
from ca_ros.nodes.messages import nanoseconds, pose_arrays, speeds_stamp, twist_arrays
from ca_ros.nodes.parameters import ALLOCATOR
from ca_ros.nodes.qos import COMMAND, LOCKSTEP_DEPTH

REPEAT = 2.0
"""Time after which parameters are asked for again [s]: DDS may lose an early answer."""

ASKED = {'allocator': list(ALLOCATOR), 'simulator': list(SIMULATOR)}
"""The parameters that each node is asked for."""


class Recorder(Node):
    """Gathers what the simulator publishes into samples, by their stamps."""

    def __init__(self, namespace: str, links: Iterable[str] = LINKS) -> None:
        super().__init__('recorder', namespace=namespace)
        self._links = links
        self._waypoint = self.create_publisher(
            PoseStamped,
            'command/pose',
            COMMAND,
            event_callbacks=PublisherEventCallbacks(matched=self._greet),
        )
        self._streams: list[tuple[Subscription, Callable[[Any], None]]] = []
        self._parameter_clients = {
            node: self.create_client(GetParameters, f'{node}/get_parameters') for node in ASKED
        }
        self._asked = dict.fromkeys(ASKED, -REPEAT)
        self._told: set[str] = set()
        self.parameters: dict[str, Any] = {}
        """The parameters `ASKED` of the running nodes that have answered."""
        self.restart()

    def restart(self) -> None:
        """Forget the flight, which begins anew, and what is still on its way of it."""
        self._goal: Waypoint | None = None
        for stream, _ in self._streams:
            self.destroy_subscription(stream)
        everything = QoSProfile(
            reliability=ReliabilityPolicy.RELIABLE,
            history=HistoryPolicy.KEEP_LAST,
            depth=LOCKSTEP_DEPTH,
        )
        self._streams = [
            (self.create_subscription(kind, topic, receive, everything), receive)
            for kind, topic, receive in (
                (PoseStamped, 'local_position/pose', self._receive_pose),
                (TwistStamped, 'local_position/velocity_body', self._receive_velocity),
                (Float64MultiArray, 'motor_speed', self._receive_speeds),
            )
        ]
        self._samples: dict[int, dict[str, np.ndarray]] = {}
        self._start: int | None = None
        self._last: int | None = None

    def drain(self) -> None:
        """Take all that has come; an executor would take several times as long for a message."""
        for stream, receive in self._streams:
            with stream.handle:
                while taken := stream.handle.take_message(stream.msg_type, False):
                    receive(taken[0])
        if self._start is None and self._samples:
            # Before the flight only the newest samples matter: one may become the first.
            oldest = max(self._samples) - 1_000_000_000
            self._samples = {key: part for key, part in self._samples.items() if key >= oldest}

    def missing(self) -> list[str]:
        """Return the links of the loop that are not there yet, in words."""
        ends = {
            topic: (self.count_publishers(topic), self.count_subscribers(topic))
            for topic in self._links
        }
        lacking = [
            topic
            for topic, (publishers, subscribers) in ends.items()
            if not (publishers and subscribers)
        ]
        if not self._waypoint.get_subscription_count():
            lacking.append('command/pose')
        if not any(len(sample) == 5 for sample in self._samples.values()):
            lacking.append('motor_speed')
        for node in ASKED:
            if node not in self._told:
                lacking.append(f'{node}/get_parameters')
                self._ask(node)
        return lacking

    def others(self, own: int = 0) -> list[str]:
        """Return the topics of the loop on which more than `own` nodes publish."""
        topics = map(self.resolve_topic_name, [*self._links, 'motor_speed'])
        return [topic for topic in topics if self.count_publishers(topic) > own]

    def _ask(self, node: str) -> None:
        client = self._parameter_clients[node]
        if monotonic() > self._asked[node] + REPEAT and client.service_is_ready():
            self._asked[node] = monotonic()
            request = GetParameters.Request(names=ASKED[node])
            client.call_async(request).add_done_callback(partial(self._receive_parameters, node))

    def _receive_parameters(self, node: str, answer: Any) -> None:
        values = map(parameter_value_to_python, answer.result().values)
        self.parameters.update(zip(ASKED[node], values, strict=True))
        self._told.add(node)

    def send(self, waypoint: Waypoint) -> None:
        """Send the waypoint; the flight begins when the rotors begin to turn."""
        self._goal = waypoint
        message = PoseStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = waypoint.position.tolist()
        q.x, q.y, q.z, q.w = waypoint.attitude.tolist()
        self._waypoint.publish(message)

    @property
    def waiting(self) -> bool:
        """Whether no waypoint has been sent yet."""
        return self._goal is None

    def _greet(self, event: QoSPublisherMatchedInfo) -> None:
        """Send the waypoint to a controller that came later, or came back."""
        if self._goal is not None and event.current_count_change > 0:
            self.send(self._goal)

    @property
    def elapsed(self) -> float:
        """Time of the flight so far, up to the last complete sample [s]."""
        return (self.elapsed_ns or 0) / 1e9

    @property
    def elapsed_ns(self) -> int | None:
        """The same in nanoseconds; None before the flight."""
        return None if self._start is None or self._last is None else self._last - self._start

    def end(self, duration: float) -> int:
        """Return the stamp with which a flight that lasts `duration` [s] ends [ns]."""
        return (self._start or 0) + round(duration * 1e9)

    def flight(self, duration: float) -> Flight:
        """Return the complete samples of the first `duration` seconds."""
        start = self._start if self._start is not None else 0
        stamps = sorted(
            key
            for key, sample in self._samples.items()
            if 0 <= key - start <= duration * 1e9 and len(sample) == 5
        )
        columns = {
            name: np.array([self._samples[key][name] for key in stamps])
            for name in ('position', 'attitude', 'velocity', 'angular_velocity', 'speeds')
        }
        return Flight((np.array(stamps) - start) / 1e9, **columns)

    def _receive_pose(self, message: PoseStamped) -> None:
        position, attitude = pose_arrays(message)
        self._put(nanoseconds(message.header.stamp), position=position, attitude=attitude)

    def _receive_velocity(self, message: TwistStamped) -> None:
        velocity, angular_velocity = twist_arrays(message)
        self._put(
            nanoseconds(message.header.stamp), velocity=velocity, angular_velocity=angular_velocity
        )

    def _receive_speeds(self, message: Float64MultiArray) -> None:
        time = speeds_stamp(message)
        if time is None:
            return
        speeds = np.array(message.data)
        if speeds.any():
            self._start = time if self._start is None else min(time, self._start)
        self._put(time, speeds=speeds)

    def _put(self, time: int, **parts: np.ndarray) -> None:
        sample = self._samples.setdefault(time, {})
        sample.update(parts)
        if len(sample) == 5 and self._start is not None:
            self._last = time if self._last is None else max(time, self._last)
