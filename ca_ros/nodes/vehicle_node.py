"""What the three nodes have in common: parameters, start and end."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ca_ros.parameters import PARAMETERS, REQUIRED, ParameterError, complete, find
from ca_ros.vehicle import Vehicle
from ca_ros.vehicle_audit import Audit, audit

DEFAULT_VEHICLE = 'hexarotor'


class VehicleNode(Node):
    """A node with the vehicle's parameters, rebuilt when they change, all or nothing."""

    audit: Audit | None = None

    def __init__(self, name: str) -> None:
        super().__init__(name)
        given = {}
        for key, parameter in PARAMETERS.items():
            descriptor = ParameterDescriptor(
                description=parameter.description,
                additional_constraints=parameter.range(),
                read_only=not parameter.mutable,
                dynamic_typing=True,
            )
            default = None if parameter.default is REQUIRED else parameter.default
            given[key] = self.declare_parameter(key, default, descriptor).value
        given.update({key: override.value for key, override in self._parameter_overrides.items()})
        self.parameters = complete(given)
        self._candidate: tuple[dict[str, Any], Any] | None = None
        self.mode = str(self.parameters['mode'])
        self.adopt(self.build(self.parameters))
        self.add_on_set_parameters_callback(self._consider)
        self.add_post_set_parameters_callback(self._accept)

    def audited(self, parameters: dict[str, Any]) -> Audit:
        """Return what the vehicle's rotors can command.

        Raises
        ------
        ParameterError
            If an axis or hover is lost at the start, and `allocation.lost_axes` is refuse.
        """
        report = audit(Vehicle.from_parameters(parameters))
        starting = self.audit is None
        if starting and not report.sound and parameters['allocation.lost_axes'] == 'refuse':
            raise ParameterError(
                f'allocation.lost_axes: this vehicle is refused: {report} (drop would fly it)'
            )
        return report

    def note(self, report: Audit) -> None:
        """Keep an audit, and say it if it is another than before."""
        if str(report) != str(self.audit):
            if report.sound:
                self.get_logger().info(f'audit: {report}')
            else:
                self.get_logger().error(f'audit: {report}')
        self.audit = report

    def build(self, parameters: dict[str, Any]) -> Any:
        """Make what `adopt` will take over; raise a ValueError if the parameters are wrong."""
        raise NotImplementedError

    def adopt(self, built: Any) -> None:
        """Take over what `build` made, between two messages."""
        raise NotImplementedError

    def close(self) -> None:
        """Say the last word before the node ends."""

    def _consider(self, changes: list[Parameter]) -> SetParametersResult:
        ours = {change.name: change.value for change in changes if change.name in PARAMETERS}
        if not ours:
            return SetParametersResult(successful=True)
        try:
            parameters = complete({**self.parameters, **ours})
            self._candidate = parameters, self.build(parameters)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, _: list[Parameter]) -> None:
        if self._candidate is not None:
            self.parameters, built = self._candidate
            self._candidate = None
            self.adopt(built)


def split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our own arguments and those for ROS, from each --ros-args up to the next --."""
    # Raises here, in one line, what starting ROS would raise in two.
    remove_ros_args(args=['', *argv])
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in argv:
        inside = inside or argument == '--ros-args'
        (ros if inside else own).append(argument)
        inside = inside and argument != '--'
    return own, ros


def parse(prog: str, description: str, argv: Sequence[str]) -> list[str]:
    """Read a node's own arguments; return those for ROS, with the vehicle's parameter file."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description=description,
        epilog='ROS arguments follow --ros-args, for instance: '
        '--ros-args --params-file FILE -r __ns:=/uav1',
    )
    parser.add_argument(
        '--vehicle',
        metavar='NAME|FILE',
        help=f'a shipped vehicle or a parameter file (default: {DEFAULT_VEHICLE}, unless '
        '--params-file gives one)',
    )
    own, ros = split(argv)
    vehicle = parser.parse_args(own).vehicle
    if vehicle is None and '--params-file' not in ros:
        vehicle = DEFAULT_VEHICLE
        print(
            f"{prog}: no --vehicle and no --params-file: this is the paper's {vehicle}",
            file=sys.stderr,
        )
    if vehicle is None:
        return ros
    Vehicle.load(vehicle)
    # Before the user's own files, which may then override single values of it.
    return ['--ros-args', '--params-file', str(find(vehicle)), '--', *ros]


def run(node_class: type[VehicleNode], description: str, argv: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM; return its exit code.

    The signals set a flag rather than end the context, so that the node can publish its last word.
    """
    prog = node_class.__name__.lower()
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    node = executor = None
    try:
        rclpy.init(
            args=parse(prog, description, sys.argv[1:] if argv is None else argv),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        node = node_class(prog)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop:
            executor.spin_once(timeout_sec=0.1)
        return 0
    except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(f'{prog}: {error}', file=sys.stderr)
        return 1
    except (rclpy_implementation.RCLError, rclpy_implementation.RCLInvalidROSArgsError) as error:
        # The message goes on with the places in ROS's own sources.
        print(f'{prog}: {str(error).split(", at ")[0].strip()}', file=sys.stderr)
        return 1
    finally:
        if node is not None:
            node.close()
        if executor is not None:
            # Left to the interpreter's end, it may find its context gone.
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
