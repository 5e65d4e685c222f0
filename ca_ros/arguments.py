"""Command lines that hold our arguments and those of ROS."""

from __future__ import annotations

from collections.abc import Sequence


def split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our own arguments and those for ROS, from each --ros-args up to the next --."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for argument in argv:
        inside = inside or argument == '--ros-args'
        (ros if inside else own).append(argument)
        inside = inside and argument != '--'
    return own, ros


def renamed(ros: Sequence[str], name: str, default: str) -> str:
    """Return what ROS arguments make of ``__ns`` or ``__node``: the first such rule counts."""
    rule = f'{name}:='
    return next((word[len(rule) :] for word in ros if word.startswith(rule)), default)


def full_name(namespace: str, node: str) -> str:
    """Return the name of a node with its namespace, such as ``/uav1/allocator``."""
    return f'/{namespace.strip("/")}/{node}'.replace('//', '/')
