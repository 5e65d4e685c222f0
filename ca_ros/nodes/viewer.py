"""The viewer node: states, speeds and wrenches in, markers for RViz and Foxglove out."""

from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import OK, STALE, Diagnostics, Level
from ca_ros.nodes.executable import run
from ca_ros.nodes.markers import View, markers, status_text
from ca_ros.nodes.messages import pose_arrays, wrench_numbers
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import STEADY, Streams
from ca_ros.parameter_files import ViewerSettings
from ca_ros.vehicle.vehicle import Vehicle

PERIOD = 0.05  # between two pictures [s]
STEP = 0.05  # least distance between two points of the path [m]
POINTS_MAX = 1000  # greatest number of points of the path


class ViewerNode(Node):
    """Publishes the flight as markers, at most every `PERIOD`, and only if somebody subscribes.

    It asks for best effort in each mode, so that it never holds up a flight.

    The arguments are those of `rclpy.node.Node`.  Raises a ParameterError if a parameter is
    missing or wrong.
    """

    declared = ViewerSettings

    def __init__(self, node_name: str = 'viewer', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared)
        settings = self.parameters.settings
        self._use(self._prepare(settings))
        self.parameters.on_change(self._prepare, self._use)
        self.diagnostics = Diagnostics(self, 'view', str(settings.vehicle.name))
        self.streams = Streams(
            self, self.parameters.mode, self.diagnostics.drop, self.diagnostics.counts)
        n, servos = self.vehicle.n, self.vehicle.servos
        self._view = View(np.zeros(3), np.zeros(4), np.zeros(n), [0] * n, servos.resting)
        unused = {topics.TILT_COMMAND} - {*topics.needed(topics.COMMAND_PARTS, len(servos))}
        self._pose: PoseStamped | None = None
        self._new = False
        self._markers = self.streams.publish(topics.MARKERS)
        for topic, receive in (
            (topics.POSE, self._receive_pose), (topics.WAYPOINT, self._receive_waypoint),
            (topics.SPEED_COMMAND, partial(self._receive_numbers, 'speeds')),
            (topics.TILT_COMMAND, partial(self._receive_numbers, 'angles')),
            (topics.SATURATION, partial(self._receive_numbers, 'saturation')),
            (topics.WRENCH, partial(self._receive_wrench, 'demand')),
            (topics.ALLOCATED_WRENCH, partial(self._receive_wrench, 'served')),
            (topics.DIAGNOSTICS, self._receive_diagnostics),
        ):
            if topic not in unused:
                self.streams.listen(topic.kind, topic.path, receive)
        self.create_timer(PERIOD, self._draw, clock=STEADY)
        self.diagnostics.start(
            lambda: [self._state()], lambda: self.diagnostics.counts, self.streams)

    def _prepare(self, settings: ViewerSettings) -> Vehicle:
        return Vehicle.from_settings(settings.vehicle, settings.rotors)

    def _use(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle

    def _state(self) -> Level:
        if self._pose is None:
            return STALE, 'no state yet'
        return OK, 'shown' if self._markers.get_subscription_count() else 'nobody looks'

    def _receive_pose(self, message: PoseStamped) -> None:
        position, attitude = pose_arrays(message)
        if not np.isfinite([*position, *attitude]).all() or not attitude.any():
            self.diagnostics.drop('state', 'a state that is not finite')
            return
        view, self._pose, self._new = self._view, message, True
        view.position, view.attitude = position, attitude
        if not view.path or np.linalg.norm(position - view.path[-1]) > STEP:
            view.path = [*view.path[1 - POINTS_MAX :], position]

    def _receive_numbers(self, name: str, message: Float64MultiArray | Int8MultiArray) -> None:
        numbers = np.array(message.data)
        if numbers.shape == np.shape(getattr(self._view, name)) and np.isfinite(numbers).all():
            setattr(self._view, name, numbers)

    def _receive_wrench(self, name: str, message: WrenchStamped) -> None:
        setattr(self._view, name, np.array(wrench_numbers(message)))

    def _receive_waypoint(self, message: PoseStamped) -> None:
        self._view.waypoint = pose_arrays(message)[0]

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith('allocator: allocation'):
                name = self.parameters.settings.vehicle.name
                self._view.text = status_text(name, status.message)

    def _draw(self) -> None:
        if self._pose is None or not self._new or not self._markers.get_subscription_count():
            return
        self._new = False
        header = self._pose.header
        frame = header.frame_id or self.parameters.settings.world_frame
        self._markers.publish(markers(self.vehicle, self._view, frame, header.stamp))
        self.diagnostics.counts['pictures'] += 1


ABOUT = 'Show a flight in three dimensions: markers for RViz and Foxglove (~/markers).'
main = partial(run, 'viewer', ViewerNode, ABOUT)

if __name__ == '__main__':
    raise SystemExit(main())
