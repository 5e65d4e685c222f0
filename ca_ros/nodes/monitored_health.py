"""What monitors say of the rotors, as a controller or an allocator hears it."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray

from ca_ros.allocation.reconfiguration import Failures
from ca_ros.nodes import topics
from ca_ros.nodes.messages import speeds_stamp
from ca_ros.nodes.mode import RealTime
from ca_ros.nodes.monitor_reports import MonitorReports, report_of
from ca_ros.nodes.stream import NO_EVENTS, Streams
from ca_ros.nodes.topics import GATHERED, STANDING


class MonitoredHealth:
    """Listens to `rotor_health`, and keeps the reports of all monitors: see `MonitorReports`.

    - `accepts`: returns whether a report can be; it says so if not
    - `believe`: takes what all reports say together
    """

    def __init__(
        self, node: Node, mode: RealTime, accepts: Callable[[Failures], bool],
        believe: Callable[[Failures], object],
    ) -> None:
        self._node, self._mode, self._accepts, self._believe = node, mode, accepts, believe
        self._reports = MonitorReports()
        self._keeper: Publisher | None = None
        self._time = -1

    def subscribe(
        self, streams: Streams, answer: Callable[[], None], tells: bool = False
    ) -> None:
        """Subscribe to the topic.

        `answer` is called after each sound message, for what waited for it.  `tells`: whether to
        tell the newest monitor what others have found.
        """
        self._answer = answer
        topic = topics.ROTOR_HEALTH
        streams.listen(topic.kind, topic.name, self._receive, GATHERED)
        if tells:
            held = topics.HELD_HEALTH
            self._keeper = self._node.create_publisher(
                held.kind, held.name, STANDING, event_callbacks=NO_EVENTS)

    def waits(self, time: int) -> bool:
        """Return whether the health for a state [ns] has still to come."""
        return self._mode.waits(time, self._time)

    def lacks_answer(self, time: int) -> bool:
        """Return whether the monitor has said again that it lacks the answer to a state [ns]."""
        return self._mode.lacks_answer(time, self._time)

    @property
    def others(self) -> list[Failures]:
        """What all but the newest monitor found."""
        return self._reports.others

    def _receive(self, message: Float64MultiArray) -> None:
        (origin, said), time = report_of(message), speeds_stamp(message)
        news = not self._reports.has(origin, said)
        if news:
            if not self._accepts(said):
                return
            self._reports.take(origin, said)
            self._believe(self._reports.together)
        self._time = -1 if time is None else time
        self._answer()
        if news and self._keeper and (word := self._reports.word_to_newest()):
            self._keeper.publish(word)
