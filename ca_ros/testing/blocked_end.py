"""Nodes that Fast DDS blocks while they are destroyed (docs/reliability.md)."""

from __future__ import annotations

import re

BLOCKED = re.compile(
    r'Timeout \(.*\)!\nThread \S+ \(most recent call first\):\n'
    r'  File ".*/rclpy/node\.py", line \d+ in destroy_node\n'
)
"""What a node of this package prints then."""


def blocked(exit_code: int, err: str) -> bool:
    """Return whether Fast DDS blocked at the end of a node, after its last command."""
    return exit_code == 1 and bool(BLOCKED.search(err))


def excuse() -> None:
    """End a test as an expected failure."""
    import pytest

    pytest.xfail('Fast DDS blocked at the end of a node, after its last command: issue 6513')
