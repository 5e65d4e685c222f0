"""The monitor node: states and rotor speeds in, the health of the rotors out."""

from functools import partial
from math import inf
from time import monotonic
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger

from ca_ros.arrays import Array
from ca_ros.control.momentum_observer import RESTART
from ca_ros.detection.detector_settings import no_lag
from ca_ros.detection.kernel_detector import Detector, make_detector
from ca_ros.detection.lag_check import LagCheck
from ca_ros.detection.speed_residual import oldest_measurement
from ca_ros.nodes import messages, topics
from ca_ros.nodes.belief import Belief
from ca_ros.nodes.detector_words import failures_found, not_acted_on, values_of
from ca_ros.nodes.diagnostics import ERROR, OK, STALE, WARN, Diagnostics, Level
from ca_ros.nodes.executable import run
from ca_ros.nodes.found_health import FoundHealth
from ca_ros.nodes.imu import ALONE, Imu
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.rclpy_internals import given_parameters
from ca_ros.nodes.stream import Streams
from ca_ros.nodes.topics import COMMAND, GATHERED
from ca_ros.nodes.watchdog import CommandWatch
from ca_ros.parameter_files import MonitorSettings
from ca_ros.problem.audit import Audit
from ca_ros.vehicle.command_bounds import CommandBounds

UNTESTED = (
    'no rotor is tested: commands are missing, or a flight has just begun, by a start in the air, '
    'a reset or a gap of the states')

SETTLING = 300_000_000
"""Time after a restart of the states until the motors are sure to follow the commands [ns]."""


class MonitorNode(Node):
    """Detects rotor failures, and publishes the health of the rotors to fly with (`acted_on`).

    Where the clock counts, `rotor_health` is published when it changes, otherwise for each state.
    A failure holds until the service ``~/reset``, also if the monitor ends or starts again: each
    message has the start or the reset since which this was found, so its readers keep what was
    found before a start, and drop it after a reset.  On `rotor_health/held` the allocator tells
    a monitor what others have found, which it says from then on, too; and the others of its reset,
    after which these say again what they have found.

    With `detector.imu_position` it also takes `imu`: between two states the mean of its specific
    force takes the place of the change of velocity.  In real time, angular velocity and specific
    force alone are observed until the first state comes, and where states stop: see `Standby`.  In
    lockstep, a state waits for the message of its stamp.

    The arguments are those of `rclpy.node.Node`.  Raises a ParameterError if a parameter is
    missing or wrong.
    """

    declared = MonitorSettings

    def __init__(self, node_name: str = 'monitor', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared)
        settings = self.parameters.settings
        self._mode = self.parameters.mode
        self._pose: PoseStamped | None = None
        self._velocity: TwistStamped | None = None
        self._stated: int | None = None  # stamp of the last state
        self._observed: int | None = None  # of the last state, or sample of the Imu alone
        self._commanded: int | None = None
        self._ahead: int | None = None
        self._settled, self._repeated = 0, -inf
        self.diagnostics = Diagnostics(self, 'detection', str(settings.vehicle.name))
        self._counts = self.diagnostics.counts
        self.belief = Belief(self, self.parameters, self.diagnostics, _make, self._use)
        self.found = FoundHealth(self, self._mode.name, self.belief, self.state)
        self._publish = self.found.publish
        self._use()
        vehicle = self.belief.audit.vehicle
        self._imu = Imu(
            settings.detector.has_imu, vehicle, self._mode, self.diagnostics)
        self._bounds = CommandBounds(vehicle)
        self._lag_check = LagCheck(vehicle, settings.detector)
        self._no_lag = no_lag(given_parameters(self))
        if self._no_lag:
            self.get_logger().warning(self._no_lag)
        self.watchdog = CommandWatch(
            self, self.parameters, self.diagnostics, 'state', missing=self._missing,
            replaced=lambda: self._imu.alone)
        self.streams = Streams(self, self._mode, self.diagnostics.drop, self._counts)
        self.streams.subscribe_commands(self._receive_command, self._bounds)
        held = topics.HELD_HEALTH
        self.streams.listen(held.kind, held.name, self._receive_held, GATHERED)
        # Subscriptions are served in this order, so a restart comes before its state.
        self.belief.subscribe_announcements(self.streams)
        restart = topics.STATE_RESTART
        self.create_subscription(restart.kind, restart.name, self._receive_restart, COMMAND)
        if self._imu.used:
            self.streams.subscribe(topics.imu(), self._receive_imu)
        self.streams.subscribe(topics.POSE, self._receive_pose)
        self.streams.subscribe(topics.VELOCITY, self._receive_velocity)
        if self._mode.clocked:
            measured = topics.MEASURED_SPEEDS
            self.streams.listen(measured.kind, measured.name, self._receive_speeds)
        self.create_service(Trigger, '~/reset', self._reset)
        self._publish(None)
        self.diagnostics.start(
            self._levels, self._values, self.streams, self.watchdog.watch,
            self._publish_announced, log=self.belief.log)

    def _use(self) -> None:
        self.detector: Detector = self.belief.built
        failures = self.belief.current.in_force.failures
        self.detector.announce(failures.health, failures.stuck)
        self.found.outdated = True

    def _publish_announced(self) -> None:
        """Publish what is announced, after a change of it."""
        if self.found.outdated:
            self._publish(self._observed)

    def _levels(self) -> list[Level]:
        unset = [(WARN, self._no_lag)] * bool(self._no_lag)
        return [*self.belief.levels(), *self.watchdog.levels(self.state), *unset]

    def state(self) -> Level:
        """Return which rotors have failed, or may be failing."""
        detector, failed = self.detector, failures_found(self.detector)
        if (held := self.belief.reductions(self.found.held)) != self.belief.sound:
            failed.append(f'{held}, found by another monitor')
        if failed:
            return ERROR, '; '.join([', '.join(failed), *not_acted_on(self.found.withheld)])
        if not self.watchdog.awake:
            return STALE, f'{self._missing()} yet'
        if detector.suspect is not None:
            return WARN, f'rotor {detector.suspect + 1} suspected'
        if level := self._imu.level(self._stated is not None):
            return level
        if self._lag_check.fault:
            return WARN, self._lag_check.fault
        if detector.standing:
            return OK, 'on the ground'
        if not detector.testing or self._settles(self._observed or 0):
            return WARN, UNTESTED
        return OK, 'all rotors deliver their thrust'

    def _missing(self) -> str:
        """Return in words what is missing."""
        pose, velocity, what = self._pose, self._velocity, 'state'
        equal = not (pose and velocity) or pose.header.stamp == velocity.header.stamp
        if self._stated is None and not equal:
            what = 'pose and velocity with the same stamp'
        elif monotonic() - self._repeated < self.watchdog.timeout:
            what = 'state with a new stamp'
        return f'no {what}{self._imu.missing()}'

    def _values(self) -> dict[str, object]:
        total = self._lag_check.total
        return {
            **self.belief.values(), **self._counts, **self._imu.values(self),
            **values_of(self.detector, self.found.withheld),
            'lag and delay of motors [ms]': 'unknown' if total is None else f'{1e3 * total:.0f}',
        }

    def _receive_command(self, message: Float64MultiArray, command: Array) -> None:
        time = messages.speeds_stamp(message)
        time = self._observed if time is None else time
        # By the stamps, a second answer to a repeated state would be a second command.
        if time is None or (time == self._commanded and not self._mode.clocked):
            return
        self._commanded = time
        self.detector.command(time, command)
        self._lag_check.command(time, command)
        if self._imu.used:
            self._imu.command(command)
        self._observe()

    def _receive_speeds(self, message: Float64MultiArray) -> None:
        speeds, time = np.array(message.data), messages.speeds_stamp(message)
        if fault := self._bounds.fault_of_measured(speeds):
            self.diagnostics.drop('speeds', fault)
        elif time is not None:
            age = 0 if self._commanded is None else self._commanded - time
            if age > oldest_measurement(self.detector.settings):
                self.diagnostics.drop(
                    'age',
                    f'measured rotor speeds that are {age / 1e9:.3f} s older than the last '
                    'command')
                return
            if self.detector.measure(time, speeds):
                self._publish(time)
            if not self.detector.standing:
                self._lag_check.measure(speeds, self.detector.health)

    def _receive_held(self, message: Float64MultiArray) -> None:
        if self.found.hear(message):
            self._publish(self._observed)

    def _receive_restart(self, message: Header) -> None:
        time = messages.nanoseconds(message.stamp)
        if self._observed is not None and abs(time - self._observed) > RESTART:
            seconds = (time - self._observed) / 1e9
            self.diagnostics.drop('restart', f'a restart {seconds:g} s after the state')
            return
        self._counts['restarts'] += 1
        self._settled = time + SETTLING

    def _receive_pose(self, message: PoseStamped) -> None:
        if self._is_in(message, 'world_frame'):
            if messages.nanoseconds(message.header.stamp) == self._stated:
                self._repeated = monotonic()
            self._pose = message
            self._observe()

    def _receive_velocity(self, message: TwistStamped) -> None:
        if self._is_in(message, 'command_frame'):
            self._velocity = message
            self._observe()

    def _is_in(self, message: PoseStamped | TwistStamped, name: str) -> bool:
        """Return whether a part of a state is in the frame of this parameter; drop it if not."""
        expected = getattr(self.parameters.settings, name)
        fault = messages.wrong_frame(message.header.frame_id, expected, name)
        if fault:
            self.diagnostics.drop('frame', f'state {fault}')
        return not fault

    def _receive_imu(self, message: Any) -> None:
        before, sample = self._imu.alone, self._imu.take(message)
        if sample is not None and not self._mode.clocked:
            self._observe()
        # Commands have the clock of the states.
        elif sample is not None and self._imu.alone and not self._imu.fault:
            if not before:
                self._interrupt()
            # The log has said of a timeout that nothing comes: this says that the Imu does again.
            again = self.watchdog.expired and self.watchdog.over
            if self._stated is not None and (again or not before):
                self.get_logger().warning(ALONE)
            self._take(*sample)

    def _observe(self) -> None:
        pose, velocity = self._pose, self._velocity
        if pose is None or velocity is None or pose.header.stamp != velocity.header.stamp:
            return
        time = messages.nanoseconds(pose.header.stamp)
        each = not self._mode.clocked
        if self._imu.lacks(time):
            return
        if time == self._stated:
            if each:
                self._publish(time)
            return
        if each and self._observed is not None:
            if time < self._observed:
                self._counts['restarts'] += 1
                self._commanded = None
            elif self._commanded is None or self._commanded < self._observed:
                # The command that answers the state before is still to come.
                if time == self._ahead:
                    # Its sender may not have known of this node yet: this asks for it again.
                    self._publish(self._observed)
                self._ahead = time
                return
        force = self._imu.force(self._observed, time)
        if self._imu.turns_wrong() and not any(self.detector.evidence):
            # What was learnt with a wrong force hides failures.
            self.detector.reset()
        _, attitude = messages.pose_arrays(pose)
        if self._imu.alone:
            self._interrupt()
        motion = messages.twist_arrays(velocity)
        if self._take(time, attitude, motion, force):
            # After a timeout the watchdog says it.
            if self._imu.alone and self._stated is not None and not self.watchdog.expired:
                self.get_logger().info('states have returned')
            self._stated = time
            self._imu.hear(time, attitude, motion[0])

    def _settles(self, time: int) -> bool:
        """Return whether motors may not follow yet at a time [ns], which may have stepped back."""
        return 0 < self._settled - time <= SETTLING + RESTART

    def _interrupt(self) -> None:
        """Take the next state as one that does not continue those before."""
        self.detector.interrupt()
        self._lag_check.interrupt()

    def _take(
        self, time: int, attitude: Array, motion: tuple[Array, Array], force: Array | None
    ) -> bool:
        """Observe a state, whose motion is velocity and angular velocity; False if it is none."""
        if self._settles(time):
            self._interrupt()
        try:
            changed = self.detector.observe(time, attitude, *motion, force)
        except ValueError as error:
            self.diagnostics.drop('state', f'state: {error}')
            return False
        self.watchdog.feed()
        self._observed = time
        # What is announced holds after the state of its stamp, as for those who answer this one.
        self._mode.advance(time)
        if not self.detector.standing:
            self._lag_check.observe(time, motion[1], self.detector.health)
        if changed or not self._mode.clocked:
            self._publish(time)
        return True

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget all failures, but not those that are announced."""
        self.detector.reset()
        self.found.begin(messages.RESET)
        self.found.hold()
        self._publish(self._observed)
        response.success, response.message = True, 'all rotors are as announced'
        return response


def _make(settings: Any, report: Audit, before: Detector | None) -> Detector:
    # In flight what was found holds; the detector is told of failures (`announce`).
    return make_detector(report.vehicle, settings.detector) if before is None else before


ABOUT = 'Detect rotor failures (rotor_health) from states and commanded rotor speeds.'
main = partial(run, 'monitor', MonitorNode, ABOUT)
