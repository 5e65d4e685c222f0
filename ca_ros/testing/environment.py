"""The environment variables of a graph."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

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
    import pytest

    with pytest.MonkeyPatch.context() as changes:
        for name, value in settings.items():
            changes.setenv(name, value)
        for module in [*sys.modules.values()]:
            if CHECK.lower() in getattr(module, '__dict__', {}):
                changes.setattr(module, CHECK.lower(), settings[CHECK])
        yield
