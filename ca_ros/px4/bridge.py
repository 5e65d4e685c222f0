"""The node that speaks with PX4: it has the rules, and turns them into topics.

It is the only module that imports px4_msgs.
"""

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, Header

from ca_ros.arrays import Array
from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import ERROR, OK, STALE, WARN, Diagnostics, Level
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import answers_nothing, stamp, state_messages, wrench_message
from ca_ros.nodes.mode import RealTime
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import Streams
from ca_ros.parameter_files import Px4NodeSettings
from ca_ros.px4.frames import State
from ca_ros.px4.messages import topic
from ca_ros.px4.rules import Rules
from ca_ros.vehicle.vehicle import Vehicle

REPLIES = 5  # depth of the queue of replies: those to other nodes come on the same topic
TO_PX4 = QoSProfile(depth=5)

LEVELS = {'OK': OK, 'WARN': WARN, 'ERROR': ERROR, 'STALE': STALE}


def from_px4(depth: int) -> QoSProfile:
    """Return the QoS of PX4's publishers, and how many messages wait here."""
    return QoSProfile(
        depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class Px4Bridge(Node):
    """Passes between PX4 and ca_ros what `rules` let through; see `ca_ros.px4.rules.Host`.

    `parameter_overrides` and other arguments are those of `rclpy.node.Node`.  Raises a
    ParameterError if a parameter, the vehicle or px4_msgs is wrong.
    """

    declared = Px4NodeSettings
    _mismatch = ''

    def __init__(self, node_name: str = 'px4_bridge', **kwargs: Any) -> None:
        # Here, so that the help of the command needs no px4_msgs.
        from px4_msgs import msg

        super().__init__(node_name, **kwargs)
        self.settings = settings = Parameters(self, self.declared).settings
        vehicle = Vehicle.from_settings(settings.vehicle, settings.rotors, settings.allocation)
        self.rules = rules = Rules(msg, vehicle, settings.px4, self)
        self._diagnostics = Diagnostics(self, 'px4', str(settings.vehicle.name))
        self._counts = self._diagnostics.counts
        self._streams = Streams(self, RealTime(), self._diagnostics.drop, self._counts)
        # What PX4 sends comes first, so that a command meets the newest mode.
        for name, kind in rules.heard.items():
            quality = from_px4(REPLIES if name.endswith('reply') else 1)
            receive = partial(self._take, name)
            self.create_subscription(kind, topic('out', name, kind), receive, quality)
        self._to_px4 = {
            name: self.create_publisher(kind, topic('in', name, kind), TO_PX4)
            for name, kind in rules.sent.items()
        }
        if settings.px4.interface == 'setpoints':
            self._wrench = self._streams.publish(topics.WRENCH)
        else:
            given = topics.STATE_RESTART, topics.POSE, topics.VELOCITY
            self._restart, self._pose, self._velocity = map(self._streams.publish, given)
        self._streams.subscribe(topics.SPEED_COMMAND, self._command)
        self._diagnostics.start(self._levels, self._values, self._streams, rules.tick)

    def destroy_node(self) -> None:
        """Take leave of PX4, and destroy the node."""
        try:
            self.rules.close()
        finally:
            super().destroy_node()

    # The host of the rules

    def send(self, name: str, message: Any) -> None:
        self._to_px4[name].publish(message)

    def pass_state(self, state: State, time: int) -> None:
        names = self.settings.world_frame, self.settings.command_frame
        pose, velocity = state_messages(*state, stamp(time), *names)
        self._pose.publish(pose)
        self._velocity.publish(velocity)

    def pass_restart(self, time: int) -> None:
        self._restart.publish(Header(stamp=stamp(time), frame_id=self.settings.world_frame))

    def pass_wrench(self, wrench: Array, time: int) -> None:
        header = Header(stamp=stamp(time), frame_id=self.settings.command_frame)
        self._wrench.publish(wrench_message(wrench, header))

    def connected(self) -> bool:
        [commands] = self._streams.subscriptions
        return bool(self._pose.get_subscription_count() and commands.get_publisher_count())

    def log(self, text: str) -> None:
        self.get_logger().info(text)

    # The topics

    def _take(self, name: str, message: Any) -> None:
        self._unless_dropped(partial(self.rules.receive, name), message)

    def _command(self, message: Float64MultiArray) -> None:
        answers = not answers_nothing(message)
        speeds = np.array(message.data)
        self._unless_dropped(partial(self.rules.command, speeds), answers)

    def _unless_dropped(self, receive: Callable[[Any], None], message: Any) -> None:
        self._counts['received'] += 1
        try:
            receive(message)
        except ValueError as error:
            self._diagnostics.drop('content', str(error))

    def _levels(self) -> list[Level]:
        level, text = self.rules.state()
        found = [(LEVELS[level], text)]
        if level == 'STALE' and self._diagnostics.may_log('versions'):
            self._mismatch = self._other_versions()
        if level == 'STALE' and self._mismatch:
            found.append((ERROR, self._mismatch))
        return found

    def _values(self) -> dict[str, object]:
        return {**self.rules.values(), **self._counts}

    def _other_versions(self) -> str:
        """Return which topics PX4 has with other versions of their messages; '' if none."""
        there = {name for name, _ in self.get_topic_names_and_types()}
        found = []
        for name, kind in self.rules.heard.items():
            own = topic('out', name, kind)
            plain = self.resolve_topic_name(f'fmu/out/{name}')
            version = re.compile(rf'{re.escape(plain)}(_v\d+)?')
            if not self.count_publishers(own):
                others = there - {self.resolve_topic_name(own)}
                found += [other for other in others if version.fullmatch(other)]
        if not found:
            return ''
        return f'PX4 has {", ".join(sorted(found))}: px4_msgs is not of its branch'


ABOUT = "Fly PX4: as an external mode, in offboard mode, or as the allocator of PX4's own loops."
main = partial(run, 'px4_bridge', Px4Bridge, ABOUT)
