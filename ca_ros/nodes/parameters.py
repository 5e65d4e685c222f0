"""The parameters of a node are settings; a change takes effect completely or not at all."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from math import isfinite
from traceback import format_exc
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ca_ros.allocation.settings import own_methods
from ca_ros.nodes.mode import mode_of
from ca_ros.nodes.rclpy_internals import given_parameters
from ca_ros.parameter_files import FileSettings
from ca_ros.setting_names import check_given, renamed
from ca_ros.settings import (
    Field,
    MissingParameterError,
    ParameterError,
    Settings,
    flat,
    read,
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


NUMBERS_MAX = 10_000
"""Entries of the arrays of a request: 100 rotors have as many in a matrix, checked in 10 ms."""

REASON_MAX = 1000  # characters of a reason: a refused text comes back in it

CONTRACT = 'without effect: the qualities of service are part of the contract (docs/topics.md)'


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
    mode : RealTime
        The mode of the node.
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
        self._declared = declared
        self._own = own = own_methods(str(given.get('allocation.method')))
        # Checked before rclpy compares the values with the ranges: its message says less.
        check_given(given, names := table(known, own=own))
        try:
            self.settings: Any = read(declared, given, own=own)
        except MissingParameterError as error:
            name = node.get_fully_qualified_name()
            raise MissingParameterError(f'{error}; looked for by the node {name}') from None
        values, self._fields = flat(self.settings), table(declared, own=own)
        for name, field in self._fields.items():
            node.declare_parameter(name, values[name], descriptor(field), ignore_override=True)
        # Files from `ros2 param dump` also have rclpy's own parameters.
        others = [name for name in given if not (name in names or node.has_parameter(name))]
        self.unknown = [name for name in others if not name.startswith('qos_overrides.')]
        if self.unknown:
            listed = ', '.join(self.unknown)
            node.get_logger().warning(f'no parameters of this node: {listed}')
        for name in {*others} - {*self.unknown}:
            # rclpy itself reads the overrides of these two topics when it subscribes.
            if not name.startswith(('qos_overrides./clock.', 'qos_overrides./parameter_events.')):
                node.get_logger().warning(f'{name}: {CONTRACT}')
        self.mode = mode_of(self.settings)
        self._prepared: tuple[Any, Any] | None = None
        for service in node.services:
            if service.srv_type is SetParameters:
                service.callback = self._set_each
            elif service.srv_type is SetParametersAtomically:
                service.callback = self._set_all

    def on_change(
        self, prepare: Callable[[Any], Any], use: Callable[[Any], None] = lambda _: None
    ) -> None:
        """Follow changes: `prepare` gets the new settings, and `use` what that returned.

        `prepare` changes nothing; its exception, a ValueError if the settings are wrong, refuses
        the change.  `use` is called when all is set, and must not fail: it only assigns.
        """
        self._prepare, self._use = prepare, use
        self._node.add_pre_set_parameters_callback(self._name_unknown)
        self._node.add_on_set_parameters_callback(self._check)
        self._node.add_post_set_parameters_callback(self._take_over)

    def _set_each(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        """Set one parameter after the other, as rclpy does, unless the request is refused."""
        parameters, known = request.parameters, len(self._fields)
        reason = ''
        if len(parameters) > 2 * known:
            reason = f'{len(parameters)} parameters in one request, of {known}'
        # The bound counts for all of them, since the node does nothing else meanwhile.
        reason = reason or too_many(parameters)
        response.results = [
            SetParametersResult(successful=False, reason=reason) if reason else self._set([each])
            for each in parameters
        ]
        return response

    def _set_all(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        """Set all parameters or none, as rclpy does, unless the request is refused."""
        response.result = self._set(request.parameters)
        return response

    def _set(self, parameters: Sequence[ParameterMessage]) -> SetParametersResult:
        if reason := refusal(parameters):
            return SetParametersResult(successful=False, reason=reason)
        changes = [Parameter.from_parameter_msg(each) for each in parameters]
        try:
            return self._node.set_parameters_atomically(changes)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

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
            settings = read(self._declared, given, own=self._own, before=self.settings)
            self._prepared = settings, self._prepare(settings)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error)[:REASON_MAX])
        except Exception as error:
            # What is built may be anybody's.
            self._node.get_logger().error(format_exc())
            reason = f'{", ".join(given)}: {type(error).__name__}: {error}'
            return SetParametersResult(successful=False, reason=reason[:REASON_MAX])
        return SetParametersResult(successful=True)

    def _take_over(self, _: object) -> None:
        if self._prepared is not None:
            self.settings, prepared = self._prepared
            self._prepared = None
            self._use(prepared)


ARRAYS = {
    ParameterType.PARAMETER_BYTE_ARRAY: 'byte_array_value',
    ParameterType.PARAMETER_BOOL_ARRAY: 'bool_array_value',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer_array_value',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value',
    ParameterType.PARAMETER_STRING_ARRAY: 'string_array_value',
}
TYPES = range(ParameterType.PARAMETER_NOT_SET, ParameterType.PARAMETER_STRING_ARRAY + 1)


def too_many(parameters: Iterable[ParameterMessage]) -> str:
    """Return why the arrays of a request are too long; empty if they are not."""
    sizes = {
        each.name: len(getattr(each.value, ARRAYS[each.value.type]))
        for each in parameters if each.value.type in ARRAYS
    }
    if sum(sizes.values()) <= NUMBERS_MAX:
        return ''
    name = max(sizes, key=lambda each: sizes[each])
    return f'{name}: {sizes[name]} values: expected up to {NUMBERS_MAX} in one request'


def refusal(parameters: Iterable[ParameterMessage]) -> str:
    """Return why parameters are not set that are to be set together, before they are read."""
    parameters = list(parameters)
    for each in parameters:
        if each.value.type not in TYPES:
            return f'{each.name}: {each.value.type} is no type of a parameter'
    names = Counter(each.name for each in parameters)
    twice = [name for name, times in names.items() if times > 1]
    return f'{twice[0]}: given twice in one request' if twice else too_many(parameters)
