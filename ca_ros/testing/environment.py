"""The environment variables of a graph."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

CHECK = 'ROS_PYTHON_CHECK_FIELDS'

SETTINGS = {
    # Shared memory of killed processes would delay later starts by seconds.
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    # Without this check an int in a field of type double is sent as a wrong number.
    CHECK: '1',
    'PYTHONUNBUFFERED': '1',
}


@contextmanager
def applied(settings: Mapping[str, str]) -> Iterator[None]:
    """Apply environment variables, also in the message modules, which read `CHECK` at import."""
    modules = [getattr(module, '__dict__', {}) for module in [*sys.modules.values()]]
    readers = [module for module in modules if CHECK.lower() in module]
    changes: list[tuple[Any, str, str]] = [
        *((os.environ, name, value) for name, value in settings.items()),
        *((module, CHECK.lower(), settings[CHECK]) for module in readers),
    ]
    before = [place.get(name) for place, name, _ in changes]
    for place, name, value in changes:
        place[name] = value
    try:
        yield
    finally:
        for (place, name, _), old in zip(changes, before, strict=True):
            if old is None:
                place.pop(name, None)
            else:
                place[name] = old
