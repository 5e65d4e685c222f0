"""A node whose parameters are settings; a change takes effect completely or not at all."""

from math import isfinite
from traceback import format_exc
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ca_ros.nodes.rclpy_internals import given_parameters
from ca_ros.nodes.settings import with_own_methods
from ca_ros.settings import (
    Field,
    MissingParameterError,
    ParameterError,
    Settings,
    check_given,
    flat,
    read,
    renamed,
    table,
)


def descriptor(field: Field) -> ParameterDescriptor:
    """Return what ROS tells of a setting; tools show a slider if both of its ends are finite."""
    low, high = 0.0 if field.positive else field.minimum, field.maximum
    found = ParameterDescriptor(
        description=field.description, additional_constraints=field.range(),
        read_only=not field.mutable, dynamic_typing=True,
    )
    if isfinite(low) and isfinite(high):
        if int in field.kinds:
            found.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            found.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return found


class _Starting(type):
    """Calls `start` on each new node, after the constructors of all its classes."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        node = super().__call__(*args, **kwargs)
        node.start()
        return node


class ParameterNode(Node, metaclass=_Starting):
    """A node with settings.

    A subclass defines `build` and `adopt`.  The constructors, which take the arguments of
    `rclpy.node.Node`, only set attributes and declare the parameters.  After all of them `start`
    runs, which calls `build` and `adopt`, so these methods can use every attribute.  A subclass
    extends `start` for what needs the built object, such as publishers and subscriptions.

    Raises a ParameterError if a parameter is missing or wrong; the names of given parameters that
    are not in `known` are in the list `unknown`.
    """

    declared: type[Settings]
    """The settings of the node."""

    known: type[Settings]
    """The settings that its files may have, those of other nodes included."""

    settings: Any
    """The present settings, of the class `declared`."""

    def __init__(self, node_name: str, **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        given = renamed({name: each.value for name, each in given_parameters(self).items()})
        method = str(given.get('allocation.method'))
        self.known = with_own_methods(self.known, method)
        self.declared = with_own_methods(self.declared, method)
        # Before rclpy compares the values with the ranges, because its message says less.
        check_given(given, known := table(self.known))
        try:
            self.settings = read(self.declared, given)
        except MissingParameterError as error:
            name = self.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None
        values, self._fields = flat(self.settings), table(self.declared)
        for name, field in self._fields.items():
            self.declare_parameter(name, values[name], descriptor(field), ignore_override=True)
        # Files from `ros2 param dump` also have rclpy's own parameters.
        self.unknown = [
            name for name in given if not (name in known or self.has_parameter(name))
            and not name.startswith('qos_overrides.')
        ]

    def start(self) -> None:
        """Build and adopt from the settings; `set_parameters_atomically` does it on changes."""
        self._use(self.settings, self.build(self.settings))

    def build(self, settings: Any) -> Any:
        """Build from the settings; the result goes to `adopt`.

        A change of settings that are declared without `rebuild` does not call `build`.  An
        exception, a ValueError if settings are wrong, refuses the change, and ends the node only
        at its start.
        """
        raise NotImplementedError

    def adopt(self, built: Any) -> None:
        """Take over what `build` returned; called between two messages."""
        raise NotImplementedError

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Set one parameter after another; see `set_parameters_atomically`."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none, as rclpy does, and adopt the settings.

        Raises a ParameterNotDeclaredException that, unlike rclpy's, names what is not declared.
        """
        unknown = [change.name for change in parameter_list if not self.has_parameter(change.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        given = {each.name: each.value for each in parameter_list if each.name in self._fields}
        try:
            # Before rclpy compares the values with the ranges, because its message says less.
            settings = read(self.declared, {**flat(self.settings), **given})
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        changed, built = [self._fields[name] for name in given], self._built
        # A rebuild takes longer than an allocation; a change that rclpy refuses needs none.
        if all(field.mutable for field in changed) and any(field.rebuild for field in changed):
            try:
                built = self.build(settings)
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
            except Exception as error:
                self.get_logger().error(format_exc())
                reason = f'{type(error).__name__}: {error}'
                return SetParametersResult(successful=False, reason=reason)
        result = super().set_parameters_atomically(parameter_list)
        if result.successful and given:
            self._use(settings, built)
        return result

    def _use(self, settings: Any, built: Any) -> None:
        self.settings, self._built = settings, built
        self.adopt(built)
