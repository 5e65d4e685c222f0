"""YAML without tags, aliases and dates, as ROS reads it."""

import re
from typing import Any

import yaml

from ca_ros.settings import ParameterError

DEPTH_MAX = 20  # largest depth of nested lists and mappings in a YAML text


class PlainLoader(yaml.SafeLoader):
    """Reads strings, numbers, booleans, lists and mappings; any fault raises `yaml.YAMLError`.

    As in ROS, aliases are refused, dates are strings, and numbers are those of `NUMBERS`.
    """

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node, unless it is an alias or nested too deep."""
        if self.check_event(yaml.AliasEvent):
            fault = 'aliases (*name) are not supported'
        elif self.depth == DEPTH_MAX:
            fault = f'nested more than {DEPTH_MAX} levels deep'
        else:
            self.depth += 1
            node = super().compose_node(parent, index)
            self.depth -= 1
            return node
        raise yaml.MarkedYAMLError(problem=fault, problem_mark=self.peek_event().start_mark)  # type: ignore[no-untyped-call]

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Construct a mapping, unless a key stands in it twice."""
        found = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in found:
                raise yaml.MarkedYAMLError(
                    problem=f'the key {key.value!r} is there twice', problem_mark=key.start_mark
                )
            found.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct a node; errors of Python's own conversions get a place in the text."""
        try:
            return super().construct_object(node, deep)
        except (LookupError, ValueError):
            word = node.value if len(node.value) <= 20 else f'{node.value[:20]}...'
            raise yaml.MarkedYAMLError(
                problem=f'{word!r} is not of the type {node.tag.rpartition(":")[2]}',
                problem_mark=node.start_mark,
            ) from None


NUMBERS = {
    'int': r'[-+]?(?:0b[01_]+|0x[0-9a-fA-F_]+|0[0-7_]*|[1-9][0-9_]*)',
    'float': r'[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?'
             r'|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)',
}
"""Numbers as ROS reads them: 1e-4 is one, and 1:30, 90 in YAML 1.1, is a word."""

PLAIN = ('str', 'int', 'float', 'bool', 'null', 'seq', 'map')
PlainLoader.yaml_constructors = {
    tag: constructor for tag, constructor in yaml.SafeLoader.yaml_constructors.items()
    if tag is None or tag.rpartition(':')[2] in PLAIN
}
PlainLoader.yaml_implicit_resolvers = {
    first: [pair for pair in pairs if pair[0].rpartition(':')[2] not in ('timestamp', *NUMBERS)]
    for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for kind, pattern in NUMBERS.items():
    PlainLoader.add_implicit_resolver(  # type: ignore[no-untyped-call]
        f'tag:yaml.org,2002:{kind}', re.compile(f'(?:{pattern})$'), [*'-+.0123456789'])


def read_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    Raises a ParameterError if the text is not plain YAML: see `PlainLoader`.
    """
    try:
        return yaml.load(text, PlainLoader)
    except yaml.YAMLError as error:
        text = str(error).replace(' in "<unicode string>"', '')
        raise ParameterError(f'not readable YAML: {" ".join(text.split())}') from None
