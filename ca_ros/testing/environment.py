"""The environment variables of a graph, for its processes and for nodes in the test's process."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

SETTINGS = {
    # Shared memory of killed processes would delay later starts by seconds.
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    # Without the check an int in a field of type double is sent as a wrong number.
    'ROS_PYTHON_CHECK_FIELDS': '1',
    # The log of a process is complete when it is read.
    'PYTHONUNBUFFERED': '1',
}


@contextmanager
def applied(settings: Mapping[str, str]) -> Iterator[None]:
    """Apply environment variables, also to the message modules that have read them already."""
    before = {name: os.environ.get(name) for name in settings}
    check = 'ros_python_check_fields'
    modules = {
        name: vars(module)[check]
        for name, module in [*sys.modules.items()]
        if check in getattr(module, '__dict__', ())
    }
    os.environ.update(settings)
    for name in modules:
        setattr(sys.modules[name], check, settings['ROS_PYTHON_CHECK_FIELDS'])
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        for name, value in modules.items():
            setattr(sys.modules[name], check, value)
