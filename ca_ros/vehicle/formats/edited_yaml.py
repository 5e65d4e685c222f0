"""A parameter file with other values; its comments and its order stay."""

from collections.abc import Mapping

import yaml

from ca_ros.settings import ParameterError


def with_values(text: str, values: Mapping[str, object]) -> str:
    """Return the text of a parameter file with other values of parameters.

    - `text`: a ROS parameter file with one section, with nested or dotted names
    - `values`: numbers, or lists of them, by the dotted names of parameters; new ones are added

    Raises a ParameterError if the file has no section, or several.
    """
    for name, value in values.items():
        text = _with_value(text, name, value)
    return text


def _with_value(text: str, name: str, value: object) -> str:
    node = yaml.compose(text)
    while isinstance(node, yaml.MappingNode) and 'ros__parameters' not in _keys(node):
        if len(node.value) != 1:
            raise ParameterError('expected a parameter file with one section')
        node = node.value[0][1]
    if not isinstance(node, yaml.MappingNode):
        raise ParameterError("expected a ROS parameter file with 'ros__parameters:'")
    below, rest = _keys(node)['ros__parameters'], name
    while True:
        if not isinstance(below, yaml.MappingNode) or below.flow_style:
            raise ParameterError(f'{name}: expected a nested block of parameters above it')
        keys = _keys(below)
        key = next((key for key in keys if rest == key or rest.startswith(f'{key}.')), None)
        if key is None:
            # A new entry stands before the first one, with the same indent.
            first = below.value[0][0].start_mark
            words = f'{rest}: {value}\n' + ' ' * first.column
            return text[: first.index] + words + text[first.index :]
        if rest == key:
            found = keys[key]
            return text[: found.start_mark.index] + str(value) + text[found.end_mark.index :]
        below, rest = keys[key], rest[len(key) + 1 :]


def _keys(node: yaml.MappingNode) -> dict[str, yaml.Node]:
    return {key.value: value for key, value in node.value}
