"""The controller node: state and waypoint in, wrench out."""

from collections.abc import Callable, Sequence
from functools import partial
from math import degrees, dist, hypot, inf
from time import monotonic
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from ca_ros.arrays import Array
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.nodes import messages, topics
from ca_ros.nodes.belief import Belief
from ca_ros.nodes.cuts import Cuts
from ca_ros.nodes.diagnostics import OK, STALE, WARN, Diagnostics, Level
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import nanoseconds, pose_arrays, wrench_message, wrong_frame
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import Streams
from ca_ros.nodes.topics import COMMAND, STANDING, offered, standing
from ca_ros.nodes.watchdog import CommandWatch
from ca_ros.parameter_files import ControllerNodeSettings
from ca_ros.problem.audit import Audit
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.state import tilt

NOTHING = 1e-9  # size of a component up to which it is left out of a text [N, N m]
TILT_ERROR = 0.35  # tilt beyond the greatest commanded one that is warned of [rad]

RETREAT = 1.0  # time at the greatest speed of which the distance to a waypoint may grow [s]

SAME_STAMP = 'pose and velocity with the same stamp'


class ControllerNode(Node):
    """Answers each state, a pose and a velocity with the same stamp, with command/wrench.

    The arguments are those of `rclpy.node.Node`.  Raises a ParameterError if a parameter is
    missing or wrong.
    """

    declared = ControllerNodeSettings

    def __init__(self, node_name: str = 'controller', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared)
        settings = self.parameters.settings
        self._mode = self.parameters.mode
        self._pose: PoseStamped | None = None
        self._velocity: TwistStamped | None = None
        self.waypoint: Waypoint | None = None
        self._waypoint_text = self._logged_text = ''
        self._came = dict.fromkeys(('pose', 'velocity', SAME_STAMP), -inf)
        self._standing: Subscription | None = None
        self._open = self._heard = False
        self._tilt, self._nearest = 0.0, inf
        self._cuts = Cuts()
        self.diagnostics = Diagnostics(self, 'control', str(settings.vehicle.name))
        self._counts = self.diagnostics.counts
        self.belief = Belief(self, self.parameters, self.diagnostics, _make, self._use)
        self._use()
        self.watchdog = CommandWatch(
            self, self.parameters, self.diagnostics, 'state', missing=self._missing)
        self.streams = Streams(self, self._mode, self.diagnostics.drop, self._counts)
        self.belief.subscribe(self.streams, self._answer_held)
        self._wrench = self.streams.publish(topics.WRENCH)
        self._unallocated = self.streams.publish(topics.UNALLOCATED)
        # Subscriptions are served in this order, so a waypoint counts from the next state on.
        self._listen_to_waypoints(
            offered(self._mode.name), self._receive_new, matched=self._ask_for_waypoint)
        restart = topics.STATE_RESTART
        self.create_subscription(restart.kind, restart.name, self._receive_restart, COMMAND)
        self.streams.subscribe(topics.POSE, self._receive_pose)
        self.streams.subscribe(topics.VELOCITY, self._receive_velocity)
        self.diagnostics.start(
            self._levels, self._values, self.streams, self.watchdog.watch, self._cuts.update,
            self._log_waypoint, log=self.belief.log)

    def _use(self) -> None:
        self.controller: Controller = self.belief.built

    def _listen_to_waypoints(
        self, quality: QoSProfile, receive: Callable[[PoseStamped], None], **events: Any
    ) -> Subscription:
        topic, callbacks = topics.WAYPOINT, SubscriptionEventCallbacks(**events)
        given = topic.kind, topic.name, receive, quality
        return self.create_subscription(*given, event_callbacks=callbacks)

    def _ask_for_waypoint(self, _: object) -> None:
        """Subscribe once more if a publisher keeps its waypoints for new subscribers.

        Only this subscription gets those from before it started, and other publishers do not match
        it.  It counts until the other one gets a waypoint: from then on that gets all of them.
        """
        others = self.get_publishers_info_by_topic(topics.WAYPOINT.name)
        durabilities = [other.qos_profile.durability for other in others]
        if STANDING.durability in durabilities and self._standing is None:
            quality = standing(self._mode.name)
            self._standing = self._listen_to_waypoints(
                quality, self._receive_kept, use_default_callbacks=False)

    def _levels(self) -> list[Level]:
        return [*self.belief.levels(), *self.watchdog.levels(self._state)]

    def _state(self) -> Level:
        if self.watchdog.awake:
            settings = self.parameters.settings.controller
            if settings.attitude == 'tilt' and self._tilt > settings.tilt_max + TILT_ERROR:
                return WARN, f'tilt of {degrees(self._tilt):.0f} degrees, beyond what is commanded'
            cut = self.controller.unallocated.any()
            return (WARN, 'the demand is not attainable and cut') if cut else (OK, 'under way')
        if self.waypoint is None:
            return STALE, 'no waypoint yet'
        unequal = len({*self._stamps()}) == 2
        return STALE, f'no {SAME_STAMP if unequal else "state"} yet'

    def _values(self) -> dict[str, object]:
        cut = self._components() or 'nothing'
        unallocated = {'unallocated [N, N m]': cut, **self._cuts.values()}
        return {**self.belief.values(), **self._counts, **unallocated}

    def _missing(self) -> str:
        since = monotonic() - self.watchdog.timeout
        absent = [name for name, time in self._came.items() if time < since]
        if not absent:
            return 'no valid state'
        return 'no state' if {'pose', 'velocity'} <= {*absent} else f'no {absent[0]}'

    def _log_waypoint(self) -> None:
        """Log the waypoint if it has changed, at most once a second."""
        changed = self._waypoint_text != self._logged_text
        if changed and self.diagnostics.may_log('changed waypoint'):
            self._logged_text = self._waypoint_text
            self.get_logger().info(self._logged_text)

    def _receive_new(self, message: PoseStamped) -> None:
        self._heard = True
        self._receive_waypoint(message)

    def _receive_kept(self, message: PoseStamped) -> None:
        if not self._heard:
            self._receive_waypoint(message)

    def _receive_waypoint(self, message: PoseStamped) -> None:
        position, attitude = pose_arrays(message)
        length = hypot(*attitude.tolist())
        frame, world = message.header.frame_id, self.parameters.settings.world_frame
        fault = wrong_frame(frame, world, 'world_frame')
        if not (np.isfinite(position).all() and np.isfinite(length) and length > 0.0):
            fault = f'that is not a pose: {position} m, quaternion {attitude}'
        if not fault:
            fly = partial(self._fly_to, Waypoint(position, attitude))
            if self._mode.take(nanoseconds(message.header.stamp), topics.WAYPOINT.name, fly):
                return
            fault = 'after too many others that wait for their stamps'
        self._counts['refused waypoints'] += 1
        self.diagnostics.warn('waypoint', f'refused a waypoint {fault}')

    def _fly_to(self, waypoint: Waypoint) -> None:
        self.waypoint, self._nearest = waypoint, inf
        place = waypoint.position
        self._waypoint_text = f'waypoint {place} m, heading {waypoint.heading:.4f} rad'

    def _receive_restart(self, _: Header) -> None:
        self._counts['restarts'] += 1
        self.controller.restart()

    def _stamps(self) -> list[int]:
        """Return the stamps of the last pose and velocity, as far as there are any [ns]."""
        return [nanoseconds(each.header.stamp) for each in (self._pose, self._velocity) if each]

    def _receive_pose(self, message: PoseStamped) -> None:
        self._counts['received'] += 1
        self._counts['unanswered'] += self._open
        self._came['pose'] = monotonic()
        stamps = self._stamps()
        between = self._open and self.waypoint and len({*stamps}) == 2
        if between and not self._mode.clocked:
            self.diagnostics.warn(
                'stamp',
                f'no answer to pose and velocity with the stamps {stamps[0]} and {stamps[1]}: '
                'expected equal stamps')
        self._pose, self._open = message, True
        self._answer()

    def _receive_velocity(self, message: TwistStamped) -> None:
        self._velocity = message
        self._came['velocity'] = monotonic()
        self._answer()

    def _answer_held(self) -> None:
        if self._open and not self._mode.clocked:
            self._answer()

    def _answer(self) -> None:
        if (
            self._pose is None
            or self._velocity is None
            or self._pose.header.stamp != self._velocity.header.stamp
            or self.belief.monitored.waits(time := nanoseconds(self._pose.header.stamp))
        ):
            return
        self._mode.advance(time)
        if self.waypoint is None:
            return
        self._came[SAME_STAMP] = monotonic()
        first, self._open = self._open, False
        settings = self.parameters.settings
        for message, name in ((self._pose, 'world_frame'), (self._velocity, 'command_frame')):
            if fault := wrong_frame(message.header.frame_id, getattr(settings, name), name):
                if first:
                    self.diagnostics.drop('frame', f'state {fault}')
                return
        state = *pose_arrays(self._pose), *messages.twist_arrays(self._velocity)
        try:
            by = self.controller, self.waypoint
            asked = None if self._mode.clocked else (time, *map(bytes, state))
            found = self._mode.recall(time, asked, by)
            if found is None:
                wrench = self.controller.wrench(*state, self.waypoint, time)
                found = wrench, self.controller.unallocated, self.controller.rows
                self._mode.remember(asked, by, found)
                if found[1].any() and self.controller.answer is not None:
                    self._cuts.add(time, self.controller.answer)
        except ValueError as error:
            if first:
                self.diagnostics.drop('state', f'state: {error}')
            return
        self._tilt = float(tilt(state[1]))
        self._watch_plan(dist(state[0], self.waypoint.position))
        self.watchdog.feed()
        self._counts['served' if first else 'served again'] += 1
        header = Header(stamp=self._pose.header.stamp, frame_id=settings.command_frame)
        wrench, cut, rows = found
        self._wrench.publish(wrench_message(six(wrench, rows), header))
        if cut.any():
            self._counts['cut'] += 1
            self.diagnostics.warn(
                'cut',
                f'the demand is not attainable; unallocated: {self._components()} [N, N m]')
        if self._unallocated.get_subscription_count():
            self._unallocated.publish(wrench_message(six(cut, rows), header))

    def _watch_plan(self, distance: float) -> None:
        """Warn if the distance from the waypoint [m] grows again."""
        self._nearest = min(self._nearest, distance)
        if distance > self._nearest + RETREAT * self.parameters.settings.controller.speed_max:
            self.diagnostics.warn(
                'plan',
                f'the position leaves the plan: {distance:.3g} m from the waypoint, after '
                f'{self._nearest:.3g} m')

    def _components(self) -> str:
        """Return the components of the last demand that are not allocated."""
        axes, cut = self.controller.vehicle.axes, self.controller.unallocated.tolist()
        return ', '.join(
            f'{axis} {component:+.3g}' for axis, component in zip(axes, cut, strict=True)
            if abs(component) > NOTHING
        )


def six(wrench: Array, rows: Sequence[int]) -> Array:
    """Return force and torque (6,) of a wrench (m,) with these components [N, N m]."""
    numbers = np.zeros(len(AXES))
    numbers[rows] = wrench
    return numbers


def _make(settings: Any, report: Audit, before: Controller | None) -> Controller:
    return Controller.from_settings(report.vehicle, settings, before)


ABOUT = 'Fly to command/pose: a state to command/wrench.'
main = partial(run, 'controller', ControllerNode, ABOUT)
