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
