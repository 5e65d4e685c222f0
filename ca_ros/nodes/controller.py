"""The controller node: state and waypoint in, wrench out."""

from functools import partial
from math import degrees, dist, hypot, inf
from time import monotonic
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from ca_ros.arrays import Array
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import tilt
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes import messages, topics
from ca_ros.nodes.answers import Answers
from ca_ros.nodes.diagnostics import OK, STALE, WARN
from ca_ros.nodes.executable import run
from ca_ros.nodes.health_node import HealthNode
from ca_ros.nodes.messages import nanoseconds, pose_arrays, wrench_message, wrong_frame
from ca_ros.nodes.settings import ControllerNodeSettings
from ca_ros.nodes.topics import COMMAND, STANDING
from ca_ros.problem.audit import Audit
from ca_ros.vehicle.settings import AXES

NOTHING = 1e-9  # size of a component up to which it is left out of a text [N, N m]
TILT_ERROR = 0.35  # tilt beyond the greatest commanded one that is warned of [rad]

RETREAT = 1.0  # time at the greatest speed of which the distance to a waypoint may grow [s]

SAME_STAMP = 'pose and velocity with the same stamp'


class ControllerNode(HealthNode):
    """Answers each state, a pose and a velocity with the same stamp, with command/wrench."""

    declared = ControllerNodeSettings
    settings: ControllerNodeSettings
    subject, awaited = 'control', 'state'
    controller: Controller

    def __init__(self, node_name: str = 'controller', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self._pose: PoseStamped | None = None
        self._velocity: TwistStamped | None = None
        self._waypoint: Waypoint | None = None
        self._waypoint_text = self._logged_text = ''
        self._came = dict.fromkeys(('pose', 'velocity', SAME_STAMP), -inf)
        self._standing: Subscription | None = None
        self._open = False
        self._tilt, self._nearest = 0.0, inf
        self._answers = Answers()

    def connect(self) -> None:
        super().connect()
        self._wrench = self.publish_stream(topics.WRENCH)
        self._unallocated = self.publish_stream(topics.UNALLOCATED)
        # Subscriptions are served in this order, so a waypoint counts from the next state on.
        self._listen_to_waypoints(COMMAND, matched=self._ask_for_waypoint)
        restart = topics.STATE_RESTART
        self.create_subscription(restart.kind, restart.name, self._receive_restart, COMMAND)
        self.subscribe_stream(topics.POSE, self._receive_pose)
        self.subscribe_stream(topics.VELOCITY, self._receive_velocity)

    def _listen_to_waypoints(self, quality: QoSProfile, **events: Any) -> Subscription:
        topic, made = topics.WAYPOINT, SubscriptionEventCallbacks(**events)
        given = topic.kind, topic.name, self._receive_waypoint, quality
        return self.create_subscription(*given, event_callbacks=made)

    def _ask_for_waypoint(self, _: object) -> None:
        """Subscribe once more if a publisher keeps its last waypoint for new subscribers.

        Only this subscription gets that waypoint, and other publishers do not match it.
        """
        others = self.get_publishers_info_by_topic(topics.WAYPOINT.name)
        durabilities = [other.qos_profile.durability for other in others]
        if STANDING.durability in durabilities and self._standing is None:
            self._standing = self._listen_to_waypoints(STANDING, use_default_callbacks=False)

    def build(self, settings: ControllerNodeSettings) -> tuple[Audit, Controller]:
        report = self.audited(settings)
        return report, Controller.from_settings(report.vehicle, settings)

    def adopt(self, built: tuple[Audit, Controller]) -> None:
        report, controller = built
        if self.audit is not None:
            # In flight the integral action continues.
            controller.disturbances = self.controller.disturbances
        self.controller = controller
        self.audit = report
        self._rows = [AXES.index(axis) for axis in report.vehicle.axes]

    def state(self) -> tuple[bytes, str]:
        if self._watchdog.awake:
            settings = self.settings.controller
            if settings.attitude == 'tilt' and self._tilt > settings.tilt_max + TILT_ERROR:
                return WARN, f'tilt of {degrees(self._tilt):.0f} degrees, beyond what is commanded'
            cut = self.controller.unallocated.any()
            return (WARN, 'the demand is not attainable and cut') if cut else (OK, 'under way')
        if self._waypoint is None:
            return STALE, 'no waypoint yet'
        unequal = len({*self._stamps()}) == 2
        return STALE, f'no {SAME_STAMP if unequal else "state"} yet'

    def values(self) -> dict[str, object]:
        return {**super().values(), 'unallocated [N, N m]': self._components() or 'nothing'}

    @property
    def missing(self) -> str:
        since = monotonic() - self._watchdog.timeout
        absent = [name for name, time in self._came.items() if time < since]
        if not absent:
            return 'no valid state'
        return super().missing if {'pose', 'velocity'} <= {*absent} else f'no {absent[0]}'

    def watch(self) -> None:
        """Also log the waypoint if it has changed, at most once a second."""
        super().watch()
        if self._waypoint_text != self._logged_text and self.may_log('changed waypoint'):
            self._logged_text = self._waypoint_text
            self.get_logger().info(self._logged_text)

    def _receive_waypoint(self, message: PoseStamped) -> None:
        position, attitude = pose_arrays(message)
        length = hypot(*attitude.tolist())
        fault = wrong_frame(message.header.frame_id, self.settings.world_frame, 'world_frame')
        if not (np.isfinite(position).all() and np.isfinite(length) and length > 0.0):
            fault = f'that is not a pose: {position} m, quaternion {attitude}'
        if fault:
            self.counts['refused waypoints'] += 1
            self.warn_throttled('waypoint', f'refused a waypoint {fault}')
            return
        waypoint = Waypoint(position, attitude)
        self._waypoint, self._nearest = waypoint, inf
        self._waypoint_text = f'waypoint {position} m, heading {waypoint.heading:.4f} rad'

    def _receive_restart(self, _: Header) -> None:
        self.counts['restarts'] += 1
        self.controller.restart()

    def _stamps(self) -> list[int]:
        """Return the stamps of the last pose and velocity, as far as there are any [ns]."""
        return [nanoseconds(each.header.stamp) for each in (self._pose, self._velocity) if each]

    def _receive_pose(self, message: PoseStamped) -> None:
        self.counts['received'] += 1
        self.counts['unanswered'] += self._open
        self._came['pose'] = monotonic()
        stamps = self._stamps()
        if self.mode == 'lockstep' and self._open and self._waypoint and len({*stamps}) == 2:
            what = f'pose and velocity with the stamps {stamps[0]} and {stamps[1]}'
            self.warn_throttled('stamp', f'no answer to {what}: expected equal stamps')
        self._pose, self._open = message, True
        self._answer()

    def _receive_velocity(self, message: TwistStamped) -> None:
        self._velocity = message
        self._came['velocity'] = monotonic()
        self._answer()

    def health_came(self) -> None:
        if self.mode == 'lockstep' and self._open:
            self._answer()

    def _answer(self) -> None:
        if (
            self._pose is None
            or self._velocity is None
            or self._waypoint is None
            or self._pose.header.stamp != self._velocity.header.stamp
            or self.waits_for_health(nanoseconds(self._pose.header.stamp))
        ):
            return
        self._came[SAME_STAMP] = monotonic()
        first, self._open = self._open, False
        for message, name in ((self._pose, 'world_frame'), (self._velocity, 'command_frame')):
            if fault := wrong_frame(message.header.frame_id, getattr(self.settings, name), name):
                if first:
                    self.drop('frame', f'state {fault}')
                return
        state = *pose_arrays(self._pose), *messages.twist_arrays(self._velocity)
        try:
            time = nanoseconds(self._pose.header.stamp)
            by, wrench = (self.controller, self._waypoint), None
            if self.mode == 'lockstep':
                asked = time, *(part.tobytes() for part in state)
                wrench = self._answers.again(time, asked, by)
            if wrench is None:
                wrench = self._six(self.controller.wrench(*state, self._waypoint, time))
                if self.mode == 'lockstep':
                    self._answers.keep(asked, by, wrench)
        except ValueError as error:
            if first:
                self.drop('state', f'state: {error}')
            return
        self._tilt = float(tilt(state[1]))
        distance = dist(state[0], self._waypoint.position)
        self._nearest = min(self._nearest, distance)
        if distance > self._nearest + RETREAT * self.settings.controller.speed_max:
            what = f'{distance:.3g} m from the waypoint, after {self._nearest:.3g} m'
            self.warn_throttled('plan', f'the position leaves the plan: {what}')
        self._watchdog.feed()
        self.counts['served' if first else 'served again'] += 1
        header = Header(stamp=self._pose.header.stamp, frame_id=self.settings.command_frame)
        self._wrench.publish(wrench_message(wrench, header))
        if self.controller.unallocated.any():
            self.counts['cut'] += 1
            what = f'the demand is not attainable; unallocated: {self._components()} [N, N m]'
            self.warn_throttled('cut', what)
        if self._unallocated.get_subscription_count():
            cut = self._six(self.controller.unallocated)
            self._unallocated.publish(wrench_message(cut, header))

    def _six(self, wrench: Array) -> Array:
        """Return force and torque (6,) of a wrench (m,) in the axes of the vehicle [N, N m]."""
        numbers = np.zeros(len(AXES))
        numbers[self._rows] = wrench
        return numbers

    def _components(self) -> str:
        """Return the components of the last demand that are not allocated."""
        axes, cut = self.controller.vehicle.axes, self.controller.unallocated.tolist()
        return ', '.join(
            f'{axis} {component:+.3g}' for axis, component in zip(axes, cut, strict=True)
            if abs(component) > NOTHING
        )


ABOUT = 'Fly to command/pose: a state to command/wrench.'
main = partial(run, 'controller', ControllerNode, ABOUT)
