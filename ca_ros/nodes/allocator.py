"""The allocator node: wrenches in, rotor speeds out."""

from __future__ import annotations

from collections import Counter
from importlib.util import find_spec
from math import inf
from time import monotonic, perf_counter_ns, sleep
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.allocation import Allocation, Status
from ca_ros.allocation import Allocator as Method
from ca_ros.allocation.options import allocator_from_parameters
from ca_ros.arrays import Array
from ca_ros.nodes.diagnostics import ERROR, OK, STALE, WARN, Latencies
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import (
    fill_speeds,
    nanoseconds,
    speeds_message,
    wrench_message,
    wrench_numbers,
    wrong_frame,
)
from ca_ros.nodes.parameters import ALLOCATOR
from ca_ros.nodes.qos import offered
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.nodes.watchdog import TICK, Watchdog, fallback
from ca_ros.problem.audit import Audit
from ca_ros.problem.problem import ABSURD
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.parameters import AXES

LAST_WORD = 2.0
"""How long the node waits at its end for the motors to have its last word [s]."""

LAST_WORDS = 5
"""How often it is said: best-effort motors cannot say that they missed it."""


class Allocator(VehicleNode):
    """Answers each command/wrench with command/motor_speed, and says what became of it.

    When commands cease, the timeout action goes out in their place until they return.
    """

    declared = ALLOCATOR
    method: Method

    def __init__(self, name: str) -> None:
        self._answer: Allocation | None = None
        self._answers: Counter[Status] = Counter()
        self._heard: set[Publisher] = set()
        self._newest = 0
        self._rejected = -inf
        self._last: Array = np.zeros(1)
        self._watchdog = Watchdog()
        self._latencies = Latencies()
        super().__init__(name)
        self._speeds = self.offer(Float64MultiArray, 'command/motor_speed')
        self._allocated = self._create_aside(WrenchStamped, '~/allocated_wrench')
        self._residual = self._create_aside(WrenchStamped, '~/residual')
        self._saturation = self._create_aside(Int8MultiArray, '~/saturation')
        self.listen(WrenchStamped, 'command/wrench', self._serve)
        self.observe('allocation')
        if find_spec('osqp') is None:
            self.get_logger().info(
                'osqp is not installed: allocation.exact.solver can only be newton, '
                'which gives the same answers'
            )

    def build(self, parameters: dict[str, Any]) -> tuple[Audit, Method]:
        """Make the allocation method for the axes that the rotors can command."""
        report = self.audited(parameters)
        return report, allocator_from_parameters(parameters, report.problem)

    def adopt(self, built: tuple[Audit, Method]) -> None:
        """Allocate with this method from the next command on."""
        report, self.method = built
        self.note(report)
        vehicle = report.vehicle
        self._wrenches = rotor_wrenches(vehicle)
        self._rows = [AXES.index(axis) for axis in vehicle.axes]
        # What is held: all but the speeds of lost rotors; and if nothing has been said yet, idle.
        if not self.counts['served']:
            self._last = fallback('idle', vehicle, self._last)
        self._last = np.where(vehicle.speed_limits[1] > 0.0, self._last, 0.0)
        self._message = speeds_message(self._last, None)
        self._watchdog.timeout = self.parameters['command_timeout']
        self._frame = self.parameters['command_frame']
        self._age_max = self.parameters['command_age_max'] * 1e9
        self._newer_only = self.parameters['command_order'] == 'newer'

    def levels(self) -> list[tuple[bytes, str]]:
        """Return what is to be said of the node, with its levels."""
        levels = super().levels()
        if self._watchdog.expired:
            return [*levels, (ERROR, f'{self._missing}: {self.parameters["timeout_action"]}')]
        if self._answer is None:
            return [*levels, (STALE, 'no command yet')]
        status = Status(self._answer.status)
        return [*levels, (OK if status is Status.EXACT else WARN, status.name)]

    def values(self) -> dict[str, object]:
        """Return details of the node by name."""
        return {
            'method': self.parameters['allocation.method'],
            'audit': self.audit,
            'level of the last answer': self._answer.level if self._answer else 1.0,
            **super().values(),
            **{status.name.lower(): count for status, count in self._answers.items()},
            **self._latencies.values(),
        }

    def watch(self) -> None:
        """Send the timeout action while no commands come; in lockstep time may stand still."""
        if self.mode == 'lockstep':
            return
        expired = self._watchdog.expired
        if not self._watchdog.look():
            if expired:
                self.get_logger().info('commands have returned')
            return
        action = str(self.parameters['timeout_action'])
        if self._watchdog.begun:
            self.counts['timeouts'] += 1
            self.get_logger().error(f'{self._missing} for {self._watchdog.timeout:g} s: {action}')
        self._fall_back(action)

    @property
    def _missing(self) -> str:
        """What there is none of when the time is over."""
        rejected = monotonic() - self._rejected <= self._watchdog.timeout
        return 'none but rejected commands' if rejected else 'no command'

    def close(self) -> None:
        """Leave the rotors idle, or still if that is the timeout action."""
        if not self._watchdog.awake:
            return
        action = 'stop' if self.parameters['timeout_action'] == 'stop' else 'idle'
        for _ in range(LAST_WORDS):
            self._fall_back(action)
            sleep(TICK)
        self._speeds.wait_for_all_acked(Duration(seconds=LAST_WORD))

    def _serve(self, command: WrenchStamped) -> None:
        began = perf_counter_ns()
        self.counts['received'] += 1
        wrench = wrench_numbers(command)
        time = nanoseconds(command.header.stamp)
        if fault := self._fault(wrench, command.header.frame_id, time):
            self.drop(*fault)
            return
        answer = self.method.allocate([wrench[row] for row in self._rows])
        self._answer = answer
        if answer.status is Status.REJECTED:
            self._rejected = monotonic()
            self._watchdog.wake()
        else:
            try:
                speeds = answer.speeds
            except ValueError as error:
                # Whatever a method may do, nothing out of bounds goes out to the motors.
                self.drop('answer', f'{error}: a fault of the method')
                return
            self._speeds.publish(fill_speeds(self._message, speeds, time))
            self._watchdog.feed()
            self._newest = time
            self._last = speeds
            self.counts['served'] += 1
            self._latencies.add(perf_counter_ns() - began)
        self._answers[answer.status] += 1
        if self._heard:
            self._report(command, wrench, answer)

    def _fault(self, wrench: list[float], frame: str, time: int) -> tuple[str, str] | None:
        """Return why a command is not to be served, in a word and at length."""
        # Also what is not commanded must be sound: it is part of the residual.
        if not sum(map(abs, wrench)) <= ABSURD:
            return 'numbers', f'wrench {wrench}: expected finite numbers up to {ABSURD:g}'
        if wrong := wrong_frame(frame, self._frame):
            return 'frame', f'wrench {wrong} (parameter command_frame)'
        # One from the future would be young for long.
        if self._age_max and abs(age := self.get_clock().now().nanoseconds - time) > self._age_max:
            off = f'{abs(age) / 1e9:.3f} s {"old" if age > 0 else "ahead"}'
            return 'age', f'wrench that is {off} (parameter command_age_max)'
        if time < self._newest:
            self.counts['out of order'] += 1
            # After a pause whoever sends may have begun anew, with an earlier clock.
            if self._newer_only and not self._watchdog.over:
                return 'order', 'wrench older than its predecessor (parameter command_order)'
        return None

    def _fall_back(self, action: str) -> None:
        self._last = fallback(action, self.method.problem.vehicle, self._last)
        self._speeds.publish(fill_speeds(self._message, self._last, None))

    def _create_aside(self, kind: type, topic: str) -> Publisher:
        """Create a publisher of what is worked out only while somebody listens."""

        def matched(change: Any) -> None:
            # To be told costs less than to ask with every command.
            (self._heard.add if change.current_count else self._heard.discard)(publisher)

        events = PublisherEventCallbacks(matched=matched, use_default_callbacks=False)
        publisher = self.create_publisher(kind, topic, offered(self.mode), event_callbacks=events)
        return publisher

    def _report(self, command: WrenchStamped, wrench: list[float], answer: Allocation) -> None:
        """Publish what the rotors give, in all six components, to whoever listens."""
        given = self._wrenches @ answer.thrusts
        if self._allocated in self._heard:
            self._allocated.publish(wrench_message(given, command.header))
        if self._residual in self._heard:
            self._residual.publish(wrench_message(wrench - given, command.header))
        if self._saturation in self._heard:
            self._saturation.publish(Int8MultiArray(data=answer.saturation.tolist()))


def main() -> int:
    """Run the node."""
    return run(
        Allocator, 'Allocate wrenches (command/wrench) to rotor speeds (command/motor_speed).'
    )


if __name__ == '__main__':
    raise SystemExit(main())
