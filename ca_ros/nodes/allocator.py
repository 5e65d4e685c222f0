"""The allocator node: wrenches in, rotor speeds out."""

from __future__ import annotations

from collections import Counter
from importlib.util import find_spec
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros.allocation import Allocation, Status
from ca_ros.allocation import Allocator as Method
from ca_ros.allocation.options import allocator_from_parameters
from ca_ros.control_allocation_matrix import rotor_wrenches
from ca_ros.nodes.messages import speeds_message, wrench_array, wrench_message
from ca_ros.nodes.qos import COMMAND, offered, requested
from ca_ros.nodes.vehicle_node import VehicleNode, run
from ca_ros.parameters import AXES
from ca_ros.vehicle_audit import Audit


class Allocator(VehicleNode):
    """Answers each command/wrench with command/motor_speed, and says what became of it."""

    method: Method

    def __init__(self, name: str) -> None:
        self._counts: Counter[str] = Counter()
        self._last: Status | None = None
        self._level = 1.0
        super().__init__(name)
        self._speeds = self.create_publisher(
            Float64MultiArray, 'command/motor_speed', offered(self.mode)
        )
        self._allocated = self.create_publisher(
            WrenchStamped, '~/allocated_wrench', offered(self.mode)
        )
        self._residual = self.create_publisher(WrenchStamped, '~/residual', offered(self.mode))
        self._saturation = self.create_publisher(
            Int8MultiArray, '~/saturation', offered(self.mode)
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', COMMAND)
        self.create_subscription(
            WrenchStamped, 'command/wrench', self._serve, requested(self.mode)
        )
        self.create_timer(1.0, self._diagnose)
        if find_spec('osqp') is None:
            self.get_logger().info(
                'osqp is not installed: allocation.exact.solver can only be newton, '
                'which gives the same answers'
            )

    def build(self, parameters: dict[str, Any]) -> tuple[Audit, Method]:
        """Make the allocation method for the axes that the rotors can command."""
        report = self.audited(parameters)
        return report, allocator_from_parameters(parameters, report.vehicle)

    def adopt(self, built: tuple[Audit, Method]) -> None:
        """Allocate with this method from the next command on."""
        report, self.method = built
        self.note(report)
        self._wrenches = rotor_wrenches(report.vehicle)
        self._rows = [AXES.index(axis) for axis in report.vehicle.axes]

    def _serve(self, command: WrenchStamped) -> None:
        self._counts['received'] += 1
        wrench = wrench_array(command)
        try:
            # Also what is not commanded must be sound: it is part of the residual.
            if not np.isfinite(wrench).all():
                raise ValueError(f'wrench: expected finite numbers, got {wrench}')
            answer = self.method.allocate(wrench[self._rows])
        except ValueError as error:
            self._counts['dropped'] += 1
            self.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        status = Status(answer.status)
        if status is not Status.REJECTED:
            self._speeds.publish(speeds_message(answer.speeds, command.header.stamp))
        self._report(command, wrench, answer)
        self._counts[status.name.lower()] += 1
        self._level = float(answer.level)
        if status is not self._last:
            self._last = status
            self._diagnose()

    def _report(self, command: WrenchStamped, wrench: np.ndarray, answer: Allocation) -> None:
        """Publish what the rotors give, in all six components, to whoever listens."""
        given = self._wrenches @ answer.thrusts
        if self._allocated.get_subscription_count():
            self._allocated.publish(wrench_message(given, command.header))
        if self._residual.get_subscription_count():
            self._residual.publish(wrench_message(wrench - given, command.header))
        if self._saturation.get_subscription_count():
            self._saturation.publish(Int8MultiArray(data=answer.saturation.tolist()))

    def _diagnose(self) -> None:
        status = DiagnosticStatus(
            name=f'{self.get_fully_qualified_name()}: allocation', hardware_id='rotors'
        )
        served = self._last in (None, Status.EXACT)
        status.level = DiagnosticStatus.OK if served else DiagnosticStatus.WARN
        status.message = 'no command yet' if self._last is None else self._last.name
        if self.audit is not None and not self.audit.sound:
            status.level = DiagnosticStatus.ERROR
        values = {
            'method': self.parameters['allocation.method'],
            'audit': self.audit,
            'level of the last answer': self._level,
            **self._counts,
        }
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def main() -> int:
    """Run the node."""
    return run(
        Allocator, 'Allocate wrenches (command/wrench) to rotor speeds (command/motor_speed).'
    )


if __name__ == '__main__':
    raise SystemExit(main())
