"""What a monitor says of the rotors, and what the allocator tells it of other monitors."""

from collections.abc import Callable
from time import time_ns

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from ca_ros.allocation.reconfiguration import Failures
from ca_ros.detection.acted_on import acted_on
from ca_ros.nodes import messages, topics
from ca_ros.nodes.belief import Belief
from ca_ros.nodes.diagnostics import Level
from ca_ros.nodes.monitor_reports import least, none_of, report_of
from ca_ros.nodes.stream import NO_EVENTS


class FoundHealth:
    """Publishes `rotor_health`: what the detector of a belief has found, and what others have.

    Each message has the start or the reset since which this was found.

    - `state`: returns which rotors have failed, for the log
    - `withheld`: the rotors, from 1, whose failures are not to be acted on: see `acted_on`
    - `outdated`: whether something else is announced since the last message
    """

    def __init__(
        self, node: Node, mode: str, belief: Belief, state: Callable[[], Level]
    ) -> None:
        self._log, self._belief, self._state = node.get_logger(), belief, state
        self._news: object = None
        self.withheld: tuple[int, ...] = ()
        self.outdated = True
        self.begin(messages.START)
        topic = topics.ROTOR_HEALTH
        self._publisher = node.create_publisher(
            topic.kind, topic.name, topics.standing(mode), event_callbacks=NO_EVENTS)

    def begin(self, how: str) -> None:
        """Begin anew, at a start or a reset."""
        self._origin = f'{how} {time_ns()}'

    @property
    def held(self) -> Failures:
        """What other monitors have found."""
        current = self._belief.current
        held = current.reported.get(topics.HELD_HEALTH.name)
        return held or none_of(current.in_force.failures)

    def hold(self, said: Failures | None = None) -> None:
        """Take what other monitors have found; None: nothing."""
        found = said or none_of(self.held)
        self._belief.report(topics.HELD_HEALTH.name, found.health, None, found.arms)

    def hear(self, message: Float64MultiArray) -> bool:
        """Take what the allocator tells; return whether it asks what was found here."""
        origin, said = report_of(message)
        if origin == self._origin:
            self.hold(said)
        elif origin.startswith(messages.RESET):
            # Of another monitor: what was found here holds.
            self.hold()
            return True
        return False

    def publish(self, time: int | None) -> None:
        """Publish what was found until a state [ns]."""
        detector, held = self._belief.built, self.held
        # What others announce is not found: it ends with their word.
        found = np.where([each is None for each in detector.since], 1.0, detector.health)
        news = found.tolist(), detector.failed_arms, held.key, self._origin
        if news != self._news or self.outdated:
            _, arms, self.withheld = acted_on(detector)
            if self._news not in (None, news):
                self._log.error(f'rotor health {np.round(found, 2)}: {self._state()[1]}')
            found[[i - 1 for i in self.withheld]] = 1.0
            self._told, arms, _ = least([held, Failures(found, arms, {})])
            self._message = messages.health_message(self._told, arms, self._origin)
            self._news, self.outdated = news, False
        self._publisher.publish(messages.fill_speeds(self._message, self._told, time))
