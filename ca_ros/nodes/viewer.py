"""The viewer node: states, speeds and wrenches in, markers for RViz and Foxglove out."""

from __future__ import annotations

from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import OK, STALE
from ca_ros.nodes.executable import run
from ca_ros.nodes.markers import View, markers, status_text
from ca_ros.nodes.messages import pose_arrays, wrench_numbers
from ca_ros.nodes.settings import ViewerSettings
from ca_ros.nodes.topics import COMMAND, requested
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.vehicle.vehicle import Vehicle

PERIOD = 0.05  # between two pictures [s]
STEP = 0.05  # least distance between two points of the path [m]
POINTS_MAX = 1000  # greatest number of points of the path


class ViewerNode(VehicleNode):
    """Publishes the flight as markers, at most every `PERIOD`, and only if somebody subscribes.

    It asks for best effort in each mode, so that it never holds up a flight.
    """

    declared = ViewerSettings
    settings: ViewerSettings
    vehicle: Vehicle

    def start(self) -> None:
        super().start()
        n = self.vehicle.n
        tilts = self.vehicle.tilts
        angles = None if tilts is None else tilts.resting
        self._view = View(np.zeros(3), np.zeros(4), np.zeros(n), [0] * n, angles)
        self._pose: PoseStamped | None = None
        self._new = False
        self._markers = self.publish_stream(topics.MARKERS, COMMAND)
        for topic, receive in (
            (topics.POSE, self._receive_pose), (topics.SPEED_COMMAND, self._receive_speeds),
            (topics.SATURATION, self._receive_saturation), (topics.WRENCH, self._receive_demand),
            (topics.ALLOCATED_WRENCH, self._receive_served),
            (topics.DIAGNOSTICS, self._receive_diagnostics),
            (topics.WAYPOINT, self._receive_waypoint),
            *([] if tilts is None else [(topics.TILT_COMMAND, self._receive_angles)]),
        ):
            self.create_subscription(topic.kind, topic.path, receive, requested('realtime'))
        self.create_timer(PERIOD, self._draw, clock=self.steady)
        self.start_diagnostics('view')

    def build(self, settings: ViewerSettings) -> Vehicle:
        return Vehicle.from_settings(settings.vehicle, settings.rotors)

    def adopt(self, built: Vehicle) -> None:
        self.vehicle = built

    def state(self) -> tuple[bytes, str]:
        """Return whether there is something to show, and somebody who looks."""
        if self._pose is None:
            return STALE, 'no state yet'
        return OK, 'shown' if self._markers.get_subscription_count() else 'nobody looks'

    def _receive_pose(self, message: PoseStamped) -> None:
        position, attitude = pose_arrays(message)
        if not np.isfinite([*position, *attitude]).all() or not attitude.any():
            self.drop('state', 'a state that is not finite')
            return
        view, self._pose, self._new = self._view, message, True
        view.position, view.attitude = position, attitude
        if not view.path or np.linalg.norm(position - view.path[-1]) > STEP:
            view.path = [*view.path[1 - POINTS_MAX :], position]

    def _receive_speeds(self, message: Float64MultiArray) -> None:
        speeds = np.array(message.data)
        if speeds.shape == self._view.speeds.shape and np.isfinite(speeds).all():
            self._view.speeds = speeds

    def _receive_angles(self, message: Float64MultiArray) -> None:
        angles = np.array(message.data)
        assert self._view.angles is not None
        if angles.shape == self._view.angles.shape and np.isfinite(angles).all():
            self._view.angles = angles

    def _receive_saturation(self, message: Int8MultiArray) -> None:
        if len(message.data) == self.vehicle.n:
            self._view.saturation = [min(max(each, -2), 1) for each in message.data]

    def _receive_demand(self, message: WrenchStamped) -> None:
        self._view.demand = np.array(wrench_numbers(message))

    def _receive_served(self, message: WrenchStamped) -> None:
        self._view.served = np.array(wrench_numbers(message))

    def _receive_waypoint(self, message: PoseStamped) -> None:
        self._view.waypoint = pose_arrays(message)[0]

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith('allocator: allocation'):
                self._view.text = status_text(self.settings.vehicle.name, status.message)

    def _draw(self) -> None:
        if self._pose is None or not self._new or not self._markers.get_subscription_count():
            return
        self._new = False
        header = self._pose.header
        frame = header.frame_id or self.settings.world_frame
        self._markers.publish(markers(self.vehicle, self._view, frame, header.stamp))
        self.counts['pictures'] += 1


ABOUT = 'Show a flight in three dimensions: markers for RViz and Foxglove (~/markers).'
main = partial(run, 'viewer', ViewerNode, ABOUT)

if __name__ == '__main__':
    raise SystemExit(main())
