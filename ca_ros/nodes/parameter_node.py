"""A node whose parameters are a table; a change takes effect completely or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from math import isfinite
from traceback import format_exception
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ca_ros.nodes.executor import Executor
from ca_ros.nodes.parameters import NODE
from ca_ros.nodes.rclpy_internals import given_parameters
from ca_ros.schema import REQUIRED, MissingParameterError, ParameterError, check_given, complete
from ca_ros.schema import Parameter as Declared


def slider(parameter: Declared) -> list[FloatingPointRange]:
    """Return the range in which tools show a slider; none unless both ends are finite."""
    low = 0.0 if parameter.positive else parameter.minimum
    if not (isfinite(low) and isfinite(parameter.maximum)):
        return []
    return [FloatingPointRange(from_value=low, to_value=parameter.maximum)]


class _Starting(type):
    """Calls `start` on each new node, after the constructors of all its classes."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        node = super().__call__(*args, **kwargs)
        node.start()
        return node


class ParameterNode(Node, metaclass=_Starting):
    """A node with a table of parameters.

    A subclass defines `build` and `adopt`.  The constructors only set attributes and declare the
    parameters.  After all of them `start` runs, which calls `build` and `adopt`, so these methods
    can use every attribute.  A subclass extends `start` for what needs the built object, such as
    publishers and subscriptions.

    Parameters
    ----------
    node_name : str
    **kwargs
        As for `rclpy.node.Node`: context, namespace, parameter_overrides and others.

    Raises
    ------
    ParameterError
        If a parameter is missing or wrong.

    Attributes
    ----------
    declared : mapping
        The parameters that the node declares.
    known : mapping
        The parameters that its files may have, those of other nodes included.
    parameters : dict
        The present values by name.
    unknown : list of str
        The names of given parameters that are not in `known`.
    """

    declared: Mapping[str, Declared]
    known: Mapping[str, Declared]

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self._candidate: tuple[dict[str, Any], Any] | None = None
        self.parameters: dict[str, Any] = self._declare()

    def _declare(self) -> dict[str, Any]:
        """Declare the parameters and return their values by name."""
        values = {}
        given = {name: override.value for name, override in given_parameters(self).items()}
        # Before rclpy compares the values with the ranges, because its message says less.
        check_given(given, self.known)
        for name, parameter in self.declared.items():
            descriptor = ParameterDescriptor(
                description=parameter.description,
                additional_constraints=parameter.range(),
                floating_point_range=slider(parameter),
                read_only=not parameter.mutable,
                dynamic_typing=True,
            )
            default = None if parameter.default is REQUIRED else parameter.default
            values[name] = self.declare_parameter(name, default, descriptor).value
        # Files from `ros2 param dump` also have rclpy's own parameters.
        self.unknown = [
            name
            for name in given
            if not (name in self.known or self.has_parameter(name))
            and not name.startswith('qos_overrides.')
        ]
        try:
            return complete({**values, **given}, self.declared)
        except MissingParameterError as error:
            name = self.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None

    def start(self) -> None:
        """Build and adopt from the parameters, now and on each change of them."""
        self._built = self.build(self.parameters)
        self.adopt(self._built)
        self.add_on_set_parameters_callback(self._consider)
        self.add_post_set_parameters_callback(self._accept)

    def build(self, parameters: dict[str, Any]) -> Any:
        """Build from the parameters; the result goes to `adopt`.

        A change of parameters that are all in `NODE` does not call `build`.  An exception refuses
        the change, and ends the node only at its start.  In flight `build` runs in a thread of its
        own, while the node serves its streams, so it must change nothing.

        Raises
        ------
        ValueError
            If the parameters are wrong.
        """
        raise NotImplementedError

    def adopt(self, built: Any) -> None:
        """Take over what `build` returned; called between two messages."""
        raise NotImplementedError

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none, as rclpy does.

        Raises
        ------
        ParameterNotDeclaredException
            If the node does not declare one of them; unlike rclpy's, it names them.
        """
        unknown = [change.name for change in parameter_list if not self.has_parameter(change.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        try:
            # As in `_declare`, before rclpy.
            self._checked(parameter_list)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return super().set_parameters_atomically(parameter_list)

    def _checked(self, changes: list[Parameter]) -> dict[str, Any]:
        """Return the checked values of those changes that are in `declared`."""
        ours = {change.name: change.value for change in changes if change.name in self.declared}
        return complete(ours, {name: self.declared[name] for name in ours})

    def _build_beside(self, parameters: dict[str, Any]) -> Future[Any]:
        """Return the end of `build`; until then the streams are served by what it replaces.

        Executors of rclpy cannot serve them meanwhile.
        """
        executor = self.executor
        with ThreadPoolExecutor(1) as pool:
            building = pool.submit(self.build, parameters)
            if isinstance(executor, Executor):
                building.add_done_callback(lambda _: executor.wake())
                while not building.done():
                    executor.spin_streams()
        return building

    def _consider(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            checked = self._checked(changes)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if not checked:
            return SetParametersResult(successful=True)
        parameters, built = {**self.parameters, **checked}, self._built
        # A rebuild takes longer than an allocation, and happens only where necessary.
        if any(name not in NODE for name in checked):
            building = self._build_beside(parameters)
            if fault := building.exception():
                reason = str(fault)
                if not isinstance(fault, ValueError):
                    reason = f'{type(fault).__name__}: {fault}'
                    self.get_logger().error(''.join(format_exception(fault)))
                return SetParametersResult(successful=False, reason=reason)
            built = building.result()
        self._candidate = parameters, built
        return SetParametersResult(successful=True)

    def _accept(self, _: list[Parameter]) -> None:
        if self._candidate is not None:
            self.parameters, self._built = self._candidate
            self._candidate = None
            self.adopt(self._built)
