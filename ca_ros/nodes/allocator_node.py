"""The allocator of a vehicle: it answers wrenches with rotor speeds."""

from collections import deque
from importlib.util import find_spec
from math import ceil, inf
from time import monotonic, perf_counter_ns, sleep
from traceback import format_exc
from typing import Any, ClassVar

import numpy as np
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.allocation import ALLOCATORS, Allocation, Allocator, Status
from ca_ros.allocation.settings import allocator_of
from ca_ros.allocation.slew import PERIOD_MAX, allocate_next, within_rates
from ca_ros.arrays import Array
from ca_ros.nodes import messages, topics
from ca_ros.nodes.answers import Answers
from ca_ros.nodes.diagnostics import OK, STALE, WARN
from ca_ros.nodes.health_node import HealthNode
from ca_ros.nodes.messages import WrenchCommand, fill_speeds, speeds_message, wrench_message
from ca_ros.nodes.settings import AllocatorSettings, CommandSettings
from ca_ros.nodes.watchdog import TICK, fallback
from ca_ros.problem.vehicle_problem import TiltingVehicleProblem, vehicle_of
from ca_ros.settings import ParameterError
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.validation import ABSURD

ACKNOWLEDGED_MAX = 2.0  # longest wait for the motors to acknowledge the last command [s]
EXPLAINED_MAX = 10000  # choices of rotors up to which answers are explained, in time
LATENCIES = 5000  # number of latest latencies that the percentiles cover
LOST = -2  # saturation of a lost rotor; one at its lower bound has -1
REPEATS = 5  # repeats of the last command, since best-effort delivery is not acknowledged


class AllocatorNode(HealthNode):
    """Answers each command/wrench with command/motor_speed, and publishes the residual.

    If rotors tilt, command/tilt_angle has the angles of their servos with the same stamp.

    When commands cease, the node publishes the timeout action until commands return.
    """

    declared: type[CommandSettings] = AllocatorSettings
    subject = 'allocation'
    settings: Any
    method: Allocator
    topic: ClassVar[topics.Topic] = topics.SPEED_COMMAND

    def __init__(self, node_name: str = 'allocator', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self._loaded = dict.fromkeys((*ALLOCATORS, self.settings.allocation.method))
        self._answer: Allocation | None = None
        # Before the first command, at 0 in lockstep, the rotors have all the time that counts.
        self._newest = -round(1e9 * PERIOD_MAX)
        self._held: WrenchCommand | None = None
        self._answers = Answers()
        self._refused = -inf, ''
        self._last: Array = np.zeros(1)
        # The command before that of the newest moment [ns], and its moment.
        self._moment, self._before = self._newest, (self._last, self._newest)
        self._angles: Publisher | None = None
        self._others: list[tuple[Publisher, Float64MultiArray, str]] = []
        self._latencies: deque[int] = deque(maxlen=LATENCIES)

    def connect(self) -> None:
        super().connect()
        self._speeds = self.publish_stream(self.topic)
        if len(self._last) > self._n:
            self._angles = self.publish_stream(topics.TILT_COMMAND)
            angles = self._last[self._n :]
            self._angles_message = speeds_message(angles, None, messages.TILT_ANGLE)
        for option, topic, label, convert in (
            ('publish_throttle', topics.THROTTLE, 'throttle', 'throttles'),
            ('publish_pwm', topics.PWM, 'pulse width [us]', 'pulses'),
        ):
            # Effectors without a vehicle have neither.
            if getattr(self.settings, option, False):
                message = speeds_message(self._last[: self._n], None, label)
                self._others.append((self.publish_stream(topic), message, convert))
        reports = topics.ALLOCATED_WRENCH, topics.RESIDUAL, topics.SATURATION
        self._allocated, self._residual, self._saturation = map(self.publish_stream, reports)
        self.subscribe_stream(topics.WRENCH, self._serve, messages.read_wrench)
        if find_spec('osqp') is None:
            known = 'allocation.exact.solver can only be newton, which gives the same answers'
            self.get_logger().info(f'osqp is not installed: {known}')

    def build(self, settings: AllocatorSettings) -> tuple[Any, Allocator]:
        """Create the method for the axes that the rotors can control; in flight no code loads."""
        self.check_loaded(settings.allocation.method)
        report = self.audited(settings)
        method = allocator_of(settings.allocation, report.independent)
        # This refuses methods that cannot keep the rates.
        within_rates(method)
        return report, method

    def check_loaded(self, method: str) -> None:
        """Raise a ParameterError if a method in flight would load code."""
        if method not in self._loaded:
            text = 'was not loaded at the start; in flight it can be'
            known = ', '.join(self._loaded)
            raise ParameterError(f'allocation.method: {method} {text} {known}')

    def adopt(self, built: tuple[Any, Allocator]) -> None:
        report, self.method = built
        self.audit = report
        vehicle = report.vehicle
        self._wrenches = rotor_wrenches(vehicle)
        self._rows = [AXES.index(axis) for axis in vehicle.axes]
        self._lost = vehicle.lost
        # The action hold repeats the last speeds, idle before the first answer, within the bounds
        # that health and voltage leave.
        last, self._n = self._last if self.counts['served'] else vehicle.idle_command, vehicle.n
        speeds, angles = np.split(last, [vehicle.n])
        if vehicle.tilts is not None:
            angles = vehicle.tilts.within(angles)
        low, high = vehicle.speed_limits
        speeds = np.minimum(np.maximum(speeds, np.minimum(low, 0.0)), high)
        self._last, self._message = np.concatenate([speeds, angles]), speeds_message(speeds, None)

    def state(self) -> tuple[bytes, str]:
        if self._answer is None:
            return STALE, 'no command yet'
        status = self._answer.status
        return OK if status is Status.EXACT else WARN, status.name

    def values(self) -> dict[str, object]:
        # Not np.percentile: at its first call it imports for a tenth of a second, in flight.
        latencies = np.sort(np.array(self._latencies)) / 1e3
        ranks = {'p50': 0.5, 'p99': 0.99, 'max': 1.0} if self._latencies else {}
        return {
            'method': self.settings.allocation.method,
            'engine': self.method.engine,
            'audit': self.audit,
            'level of the last answer': self._answer.level if self._answer else 1.0,
            **self._why(),
            **super().values(),
            **{
                f'latency {name} [us]': f'{latencies[ceil(rank * len(latencies)) - 1]:.0f}'
                for name, rank in ranks.items()
            },
        }

    def _why(self) -> dict[str, object]:
        """Return what was served of each axis, and what limits it, for the last answer."""
        answer = self._answer
        if answer is None or answer.problem.facet_choices > EXPLAINED_MAX:
            return {}
        why = answer.explanation
        found: dict[str, object] = {'margin of the last demand': f'{why.margin:.4g}'}
        for axis, share in zip(answer.problem.axes, why.served, strict=True):
            found[f'{axis} served [%]'] = f'{100.0 * share:.1f}'
            if axis in why.limits:
                found[f'{axis} limited by'] = why.limits[axis]
        return found

    @property
    def missing(self) -> str:
        time, why = self._refused
        return why if monotonic() - time <= self._watchdog.timeout else super().missing

    def destroy_node(self) -> None:
        """Command idle, or stop if that is the timeout action, and destroy the node."""
        try:
            self._rest()
        finally:
            super().destroy_node()

    def _rest(self) -> None:
        if not self._watchdog.awake:
            return
        action = 'stop' if self.settings.timeout_action == 'stop' else 'idle'
        for _ in range(REPEATS):
            self.fall_back(action)
            sleep(TICK)
        if self.mode == 'realtime':
            # In lockstep the queue is deep, and Fast DDS asks for its acknowledgement after 3 s.
            self._speeds.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_MAX))

    def health_came(self) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._serve(held)

    def _serve(self, command: WrenchCommand) -> None:
        if self.waits_for_health(command.time):
            self._held = command
            return
        began = perf_counter_ns()
        self.counts['received'] += 1
        time = command.time
        if fault := self._fault(command, time):
            self.drop(*fault)
            return
        lockstep = self.mode == 'lockstep'
        if lockstep and (kept := self._answers.again(time, command, self.method)):
            answer, found = kept
            self._publish(found, time)
            for key in 'served', answer.status.name.lower():
                self.counts[key] += 1
            self._report(command, answer)
            return
        try:
            # Without a stamp a wrench counts as commanded when it arrives.
            moment = time if time or lockstep else self.get_clock().now().nanoseconds
            answer = self._allocate(command, moment)
            if not isinstance(answer, Allocation) or answer.thrusts.dtype.kind not in 'iuf':
                raise TypeError(f'expected an Allocation with real thrusts, got {answer!r}')
            status = Status(answer.status)
            # Speeds out of bounds never reach the motors, even if a method returns them.
            found = self.commands(answer)
        except Exception:
            # A method may be anybody's, and one command must not end a flight.
            self.drop('answer', f'a fault of the method: {format_exc().rstrip()}')
            self._refuse('only commands that the method fails to answer')
            return
        self._answer = answer
        if status is Status.REJECTED:
            self._refuse('only rejected commands')
        else:
            self._publish(found, time)
            self._watchdog.feed()
            self._last, self._newest, self._moment = found, time, moment
            if lockstep:
                self._answers.keep(command, self.method, (answer, found))
            self.counts['served'] += 1
            self._latencies.append(perf_counter_ns() - began)
        self.counts[status.name.lower()] += 1
        self._report(command, answer)

    def _allocate(self, command: WrenchCommand, moment: int) -> Allocation:
        """Return the answer to a wrench, within what the rotors reach since the one before."""
        u = [command.wrench[row] for row in self._rows]
        if moment != self._moment:
            # A second wrench with the same stamp replaces the first.
            self._before = self._last, self._moment
        if moment == 0 and self.audit is not None:
            # A flight in lockstep begins, maybe after a reset of the simulator.
            self._before = self.audit.vehicle.idle_command, -round(1e9 * PERIOD_MAX)
        last, before = self._before
        return allocate_next(self.method, u, last, moment, before)

    def _refuse(self, why: str) -> None:
        """Leave the rotors to the watchdog, from the first command on."""
        self._refused = monotonic(), why
        if not self._watchdog.awake:
            self._watchdog.feed()

    def _fault(self, command: WrenchCommand, time: int) -> tuple[str, str] | None:
        """Return why a command is dropped, as a key and a message; None if it is served."""
        wrench, settings = command.wrench, self.settings
        # All six components are checked, because all are part of the residual.
        if not sum(map(abs, wrench)) <= ABSURD:
            return 'numbers', f'wrench {[*wrench]}: expected finite numbers up to {ABSURD:g}'
        wrong = messages.wrong_frame(command.frame, settings.command_frame, 'command_frame')
        if wrong:
            return 'frame', f'wrench {wrong}'
        # A stamp ahead of the clock would pass the age limit for too long.
        age_max = settings.command_age_max * 1e9
        if age_max and abs(age := self.get_clock().now().nanoseconds - time) > age_max:
            off = f'{abs(age) / 1e9:.3f} s {"old" if age > 0 else "ahead"}'
            return 'age', f'wrench that is {off} (parameter command_age_max)'
        if time < self._newest:
            self.counts['out of order'] += 1
            # After a timeout, a restarted sender may have an earlier clock.
            if settings.command_order == 'newer' and not self._watchdog.over:
                return 'order', 'wrench older than its predecessor (parameter command_order)'
        return None

    def commands(self, answer: Allocation) -> Array:
        """Return what is published of an answer: rotor speeds, tilt angles [rad/s, rad]."""
        return answer.speeds if self._angles is None else answer.command

    def at_rest(self, action: str) -> Array:
        """Return the rotor speeds and tilt angles of a timeout action [rad/s, rad]."""
        return fallback(action, vehicle_of(self.method.problem), self._last)

    def fall_back(self, action: str) -> None:
        self._last = self.at_rest(action)
        self._publish(self._last, None)

    def _publish(self, command: Array, time: int | None) -> None:
        """Publish speeds and angles that answer a wrench with a stamp [ns], or none."""
        speeds = command
        if self._angles is not None:
            speeds, angles = command[: self._n], command[self._n :]
            self._angles.publish(fill_speeds(self._angles_message, angles, time))
        self._speeds.publish(fill_speeds(self._message, speeds, time))
        if self._others:
            vehicle = vehicle_of(self.method.problem)
            for publisher, message, convert in self._others:
                publisher.publish(fill_speeds(message, getattr(vehicle, convert)(speeds), time))

    def _produced(self, answer: Allocation) -> Array:
        """Return force and torque (6,) of an answer [N, N m]."""
        if isinstance(answer.problem, TiltingVehicleProblem):
            # With rates, the directions are those of this answer.
            return answer.problem.wrenches @ answer.thrusts
        return self._wrenches @ answer.thrusts

    def _report(self, command: WrenchCommand, answer: Allocation) -> None:
        """Publish the allocated wrench, residual and saturation that have subscribers."""
        allocated = self._allocated.get_subscription_count()
        residual = self._residual.get_subscription_count()
        if allocated or residual:
            given = self._produced(answer)
            if allocated:
                self._allocated.publish(wrench_message(given, command.header))
            if residual:
                self._residual.publish(wrench_message(command.wrench - given, command.header))
        if self._saturation.get_subscription_count():
            saturation = np.where(self._lost, LOST, answer.saturation)
            self._saturation.publish(Int8MultiArray(data=saturation.tolist()))
