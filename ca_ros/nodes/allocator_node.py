"""The allocator node: it answers wrenches with rotor speeds."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from math import ceil, inf
from time import monotonic, perf_counter, perf_counter_ns, sleep
from traceback import format_exc
from typing import Any, ClassVar

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.allocation import ALLOCATORS, Allocation, Status
from ca_ros.allocation.settings import check_other_methods
from ca_ros.arrays import Array
from ca_ros.nodes import messages, topics
from ca_ros.nodes.belief import Belief
from ca_ros.nodes.cuts import Cuts, explained
from ca_ros.nodes.diagnostics import OK, STALE, WARN, Diagnostics, Level
from ca_ros.nodes.messages import WrenchCommand, fill_speeds, speeds_message, wrench_message
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.rotors import Rotors
from ca_ros.nodes.stream import TICK, Streams
from ca_ros.nodes.watchdog import CommandWatch
from ca_ros.parameter_files import AllocatorSettings, FileSettings, NodeSettings
from ca_ros.settings import ParameterError, Settings, names_class
from ca_ros.vehicle.settings import ThrustCurveSettings
from ca_ros.vehicle.validation import ABSURD

ACKNOWLEDGED_MAX = 2.0  # longest wait for the motors to acknowledge the last command [s]
LATENCIES = 5000  # number of latest latencies that the percentiles cover
LOST = -2  # saturation of a lost rotor; one at its lower bound has -1
REPEATS = 5  # repeats of the last command, since best-effort delivery is not acknowledged


def checked(answer: Any, u: list[float]) -> Allocation:
    """Return an answer to a wrench, with a `Status`; raise a TypeError or ValueError otherwise.

    A method may be anybody's, and all that the node says later is of this answer.
    """
    if not isinstance(answer, Allocation) or answer.thrusts.dtype.kind not in 'iuf':
        raise TypeError(f'expected an Allocation with real thrusts, got {answer!r}')
    if len(answer.demand) != len(u):
        raise ValueError(f'expected the demand {u}, got {answer.demand}')
    if type(answer.status) is not Status:
        answer = replace(answer, status=Status(answer.status))
    return answer


class AllocatorNode(Node):
    """Answers each command/wrench with command/motor_speed, and publishes the residual.

    If rotors tilt, command/tilt_angle has the angles of their servos with the same stamp.

    When commands cease, the node publishes the timeout action until commands return.

    A subclass is for other effectors than rotors: it has other settings and effectors, which
    its `belief_type` keeps up to date.  The arguments are those of `rclpy.node.Node`.  Raises a
    ParameterError if a parameter is missing or wrong.
    """

    declared: ClassVar[type[NodeSettings]] = AllocatorSettings
    known: ClassVar[type[Settings]] = FileSettings
    topic: ClassVar[topics.Topic] = topics.SPEED_COMMAND
    belief_type: ClassVar[Any] = Belief
    effectors_type: ClassVar[Callable[..., Any]] = Rotors

    def __init__(self, node_name: str = 'allocator', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared, self.known)
        settings = self.parameters.settings
        self._mode = self.parameters.mode
        self._loaded = dict.fromkeys((*ALLOCATORS, settings.allocation.method))
        self._durations: dict[str, float] = {}
        self._answer: Allocation | None = None
        self._held: WrenchCommand | None = None
        self._cuts = Cuts()
        self._refused = -inf, ''
        self._latencies: deque[int] = deque(maxlen=LATENCIES)
        self.diagnostics = Diagnostics(self, 'allocation', self.hardware_id(settings))
        self._counts = self.diagnostics.counts
        self.belief = self.belief_type(
            self, self.parameters, self.diagnostics, self._make, self._use)
        self._use()
        self._newest = -1
        self._last: Array = self._effectors.idle
        self.watchdog = CommandWatch(
            self, self.parameters, self.diagnostics, fall_back=self._fall_back,
            missing=self._missing)
        self.streams = Streams(self, self._mode, self.diagnostics.drop, self._counts)
        self.belief.subscribe(self.streams, self._serve_held, tells=True)
        self._offer()
        serve = self._serve if self._mode.clocked else self._serve_in_lockstep
        self.streams.subscribe(topics.WRENCH, serve, messages.read_wrench)
        self.diagnostics.start(
            self._levels, self._values, self.streams, self.watchdog.watch, self._cuts.update,
            log=self.belief.log)
        if find_spec('osqp') is None:
            self.get_logger().info(
                'osqp is not installed: allocation.method cannot be osqp; exact solves the same '
                'program')

    @staticmethod
    def hardware_id(settings: Any) -> str:
        """Return what the diagnostics are about."""
        return str(settings.vehicle.name)

    def _offer(self) -> None:
        effectors, publish = self._effectors, self.streams.publish
        self._message = speeds_message(self._last[: effectors.n], None, effectors.label)
        self._speeds = publish(self.topic)
        angles = self._last[effectors.n :]
        self._angles = [
            (publish(topic), speeds_message(angles, None, messages.TILT_ANGLE))
            for topic in topics.needed(topics.COMMAND_PARTS, len(angles))[1:]
        ]
        self._others: list[tuple[Publisher, Float64MultiArray, str]] = []
        # Effectors without a vehicle have no rotors.
        rotors = getattr(self.parameters.settings, 'rotors', None)
        curve = rotors.thrust_curve if rotors else ThrustCurveSettings()
        for given, topic, label, convert in (
            (curve != ThrustCurveSettings(), topics.THROTTLE, 'throttle', 'throttles'),
            (curve.pwm != 0.0, topics.PWM, 'pulse width [us]', 'pulses'),
        ):
            if given:
                message = speeds_message(self._last[: effectors.n], None, label)
                self._others.append((publish(topic), message, convert))
        reports = topics.ALLOCATED_WRENCH, topics.RESIDUAL, topics.SATURATION
        self._allocated, self._residual, self._saturation = map(publish, reports)

    def _make(self, settings: Any, report: Any, before: Any) -> Any:
        """Make the method, with what else an answer needs; in flight no code loads."""
        method = settings.allocation.method
        if method not in self._loaded:
            text = 'was not loaded at the start; in flight it can be'
            known = ', '.join(self._loaded)
            raise ParameterError(f'allocation.method: {method} {text} {known}')
        took, limit = self._durations.get(method, 0.0), settings.command_timeout
        in_flight = before is not None and self._mode.clocked
        if in_flight and names_class(method) and took > limit:
            raise ParameterError(
                f'allocation.method: {method} took {took:.3g} s to build at the start, longer '
                f'than command_timeout ({limit:g} s): it is not built in flight'
            )
        begun = perf_counter()
        effectors = self.effectors_type(settings, report)
        self._durations.setdefault(method, perf_counter() - begun)
        present = None if before is None else self.parameters.settings
        if present is not settings:
            others = None if present is None else present.allocation
            check_other_methods(settings.allocation, effectors.method.problem, others)
        return effectors

    def _use(self) -> None:
        self._effectors = self.belief.built

    def _levels(self) -> list[Level]:
        return [*self.belief.levels(), *self.watchdog.levels(self._state)]

    def _state(self) -> Level:
        if self._answer is None:
            return STALE, 'no command yet'
        status = self._answer.status
        return OK if status is Status.EXACT else WARN, status.name

    def _values(self) -> dict[str, object]:
        # Not np.percentile: at its first call it imports for a tenth of a second, in flight.
        latencies = np.sort(np.array(self._latencies)) / 1e3
        ranks = {'p50': 0.5, 'p99': 0.99, 'max': 1.0} if self._latencies else {}
        return {
            'method': self.parameters.settings.allocation.method,
            'engine': self._effectors.method.engine,
            'audit': self.belief.audit,
            'level of the last answer': self._answer.level if self._answer else 1.0,
            **self._why(),
            **self._cuts.values(),
            **self.belief.values(),
            **self._counts,
            **{
                f'latency {name} [us]': f'{latencies[ceil(rank * len(latencies)) - 1]:.0f}'
                for name, rank in ranks.items()
            },
        }

    def _why(self) -> dict[str, object]:
        """Return what was served of each axis, and what limits it, for the last answer."""
        answer = self._answer
        if answer is None or not explained(answer):
            return {}
        why = answer.explanation
        found: dict[str, object] = {'margin of the last demand': f'{why.margin:.4g}'}
        for axis, share in zip(answer.problem.axes, why.served, strict=True):
            found[f'{axis} served [%]'] = f'{100.0 * share:.1f}'
            if axis in why.limits:
                found[f'{axis} limited by'] = why.limits[axis]
        return found

    def _missing(self) -> str:
        time, why = self._refused
        return why if monotonic() - time <= self.watchdog.timeout else 'no command'

    def destroy_node(self) -> None:
        """Command idle, or stop if that is the timeout action, and destroy the node."""
        try:
            self._rest()
        finally:
            super().destroy_node()

    def _rest(self) -> None:
        if not self.watchdog.awake:
            return
        action = 'stop' if self.watchdog.action == 'stop' else 'idle'
        for _ in range(REPEATS):
            self._fall_back(action)
            sleep(TICK)
        if self._mode.clocked:
            # Of a deep queue Fast DDS asks for the acknowledgement after 3 s.
            self._speeds.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED_MAX))

    def _serve_held(self) -> None:
        """Serve what waited for the health; the monitor gets again the command that it lacks."""
        held, self._held = self._held, None
        if held is not None:
            self._serve_in_lockstep(held)
        elif self.belief.monitored.lacks_answer(self._newest):
            self._publish(self._last, self._newest)

    def _serve_in_lockstep(self, command: WrenchCommand) -> None:
        """Serve a wrench, or hold it until the health with its stamp comes."""
        if self.belief.monitored.waits(command.time):
            self._held = command
        else:
            self._serve(command)

    def _serve(self, command: WrenchCommand) -> None:
        began, time, mode = perf_counter_ns(), command.time, self._mode
        self._counts['received'] += 1
        if fault := self._fault(command, time):
            self.diagnostics.drop(*fault)
            return
        if not mode.clocked and self._serves_again(command, time):
            return
        effectors, wrench = self._effectors, command.wrench
        # Without a stamp a wrench counts from its arrival.
        moment = time if time or not mode.clocked else self.get_clock().now().nanoseconds
        try:
            u = [wrench[row] for row in effectors.rows]
            last, elapsed = mode.previous(self._last, moment, effectors.idle)
            answer = checked(effectors.within_rates.allocate(u, last, elapsed, 0), u)
            # Speeds out of bounds never reach the motors, even if a method returns them.
            found, status = answer.command, answer.status
        except Exception:
            # A method may be anybody's, and one command must not end a flight.
            self.diagnostics.drop('answer', f'a fault of the method: {format_exc().rstrip()}')
            self._refuse('only commands that the method fails to answer')
            return
        self._answer = answer
        if status is Status.REJECTED:
            self._refuse('only rejected commands')
        else:
            self._publish(found, time)
            self.watchdog.feed()
            self._last, self._newest = found, time
            mode.commanded(moment)
            if not mode.clocked:
                mode.remember(command, effectors, (answer, found))
            self._counts['served'] += 1
            self._latencies.append(perf_counter_ns() - began)
        if status is not Status.EXACT:
            self._cuts.add(time, answer)
        self._counts[status.name.lower()] += 1
        self._report(command, answer)

    def _serves_again(self, command: WrenchCommand, time: int) -> bool:
        """Come to the time of a wrench [ns]; tell whether it is a copy, and answer that again."""
        self._mode.advance(time)
        known = self._mode.recall(time, command, self._effectors)
        if known:
            answer, found = known
            self._publish(found, time)
            for key in 'served', answer.status.name.lower():
                self._counts[key] += 1
            self._report(command, answer)
        return known is not None

    def _refuse(self, why: str) -> None:
        """Leave the rotors to the watchdog, from the first command on."""
        self._refused = monotonic(), why
        if not self.watchdog.awake:
            self.watchdog.feed()

    def _fault(self, command: WrenchCommand, time: int) -> tuple[str, str] | None:
        """Return why a command is dropped, as a key and a message; None if it is served."""
        wrench, settings = command.wrench, self.parameters.settings
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
            self._counts['out of order'] += 1
        return None

    def _fall_back(self, action: str) -> None:
        """Publish a timeout action."""
        self._last = self._effectors.at_rest(action, self._last)
        self._publish(self._last, None)
        self._mode.commanded()

    def _publish(self, command: Array, time: int | None) -> None:
        """Publish speeds and angles that answer a wrench with a stamp [ns], or none."""
        n = self._effectors.n
        speeds, angles = command[:n], command[n:]
        for publisher, message in self._angles:
            publisher.publish(fill_speeds(message, angles, time))
        self._speeds.publish(fill_speeds(self._message, speeds, time))
        for publisher, message, convert in self._others:
            if publisher.get_subscription_count():
                given = getattr(self._effectors.vehicle, convert)(speeds)
                publisher.publish(fill_speeds(message, given, time))

    def _report(self, command: WrenchCommand, answer: Allocation) -> None:
        """Publish the allocated wrench, residual and saturation that have subscribers.

        After a rejected wrench they are those of the last command, which the rotors keep.
        """
        allocated = self._allocated.get_subscription_count()
        residual = self._residual.get_subscription_count()
        rejected = answer.status is Status.REJECTED
        if allocated or residual:
            effectors, last = self._effectors, self._last
            given = effectors.held(last)[0] if rejected else effectors.produced(answer)
            if allocated:
                self._allocated.publish(wrench_message(given, command.header))
            if residual:
                self._residual.publish(wrench_message(command.wrench - given, command.header))
        if self._saturation.get_subscription_count():
            at_bounds = self._effectors.held(self._last)[1] if rejected else answer.saturation
            saturation = np.where(self._effectors.lost, LOST, at_bounds)
            self._saturation.publish(Int8MultiArray(data=saturation.tolist()))
