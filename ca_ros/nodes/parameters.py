"""The parameters of a node are settings; a change takes effect completely or not at all."""

from collections.abc import Callable, Sequence
from math import isfinite
from traceback import format_exc
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ca_ros.nodes.rclpy_internals import given_parameters
from ca_ros.nodes.settings import FileSettings, with_own_methods
from ca_ros.settings import (
    Field,
    MissingParameterError,
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


class Parameters:
    """The parameters of a node, declared, read and checked.

    Parameters
    ----------
    node : Node
    declared : type of Settings
        What the node has.
    known : type of Settings
        What its files may have, the settings of other nodes included.

    Attributes
    ----------
    settings : Settings
        The present settings, of the class `declared`, with those of one's own method.
    unknown : list of str
        The names of given parameters that are not known; a warning names them.

    Raises
    ------
    ParameterError
        If a parameter is missing or wrong.
    """

    def __init__(
        self, node: Node, declared: type[Settings], known: type[Settings] = FileSettings
    ) -> None:
        self._node = node
        given = renamed({name: each.value for name, each in given_parameters(node).items()})
        method = str(given.get('allocation.method'))
        self._declared = with_own_methods(declared, method)
        # Before rclpy compares the values with the ranges, because its message says less.
        check_given(given, names := table(with_own_methods(known, method)))
        try:
            self.settings: Any = read(self._declared, given)
        except MissingParameterError as error:
            name = node.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None
        values, self._fields = flat(self.settings), table(self._declared)
        for name, field in self._fields.items():
            node.declare_parameter(name, values[name], descriptor(field), ignore_override=True)
        # Files from `ros2 param dump` also have rclpy's own parameters.
        self.unknown = [
            name for name in given if not (name in names or node.has_parameter(name))
            and not name.startswith('qos_overrides.')
        ]
        if self.unknown:
            listed = ', '.join(self.unknown)
            node.get_logger().warning(f'no parameters of this node: {listed}')
        self._prepared: tuple[Any, Any] | None = None

    def on_change(
        self, prepare: Callable[[Any], Any], adopt: Callable[[Any], None] = lambda _: None
    ) -> None:
        """Follow changes: `prepare` gets the new settings, and `adopt` what that returned.

        `prepare` changes nothing; its exception, a ValueError if the settings are wrong, refuses
        the change.  `adopt` is called when all is set, and must not fail: it only assigns.
        """
        self._prepare, self._adopt = prepare, adopt
        self._node.add_pre_set_parameters_callback(self._name_unknown)
        self._node.add_on_set_parameters_callback(self._check)
        self._node.add_post_set_parameters_callback(self._take_over)

    def _name_unknown(self, changes: list[Parameter]) -> list[Parameter]:
        """Raise a ParameterNotDeclaredException that, unlike rclpy's, names what it is about."""
        unknown = [each.name for each in changes if not self._node.has_parameter(each.name)]
        if unknown:
            raise ParameterNotDeclaredException(unknown)
        return changes

    def _check(self, changes: Sequence[Parameter]) -> SetParametersResult:
        self._prepared = None
        given = {each.name: each.value for each in changes if each.name in self._fields}
        if not given:
            return SetParametersResult(successful=True)
        try:
            settings = read(self._declared, {**flat(self.settings), **given})
            self._prepared = settings, self._prepare(settings)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            # What is built may be anybody's.
            self._node.get_logger().error(format_exc())
            reason = f'{type(error).__name__}: {error}'
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _take_over(self, _: object) -> None:
        if self._prepared is not None:
            self.settings, prepared = self._prepared
            self._prepared = None
            self._adopt(prepared)
