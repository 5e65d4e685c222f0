"""The environment that results depend on: versions and machine."""

from __future__ import annotations

import os
import platform
import re
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ('ca_ros', 'numpy', 'scipy', 'osqp', 'pandas', 'matplotlib')


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that are installed."""
    found = {'python': platform.python_version(), **dict.fromkeys(PACKAGES, 'not installed')}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def machine() -> dict[str, str | int]:
    """Return processor, number of cores and system."""
    names = re.findall('^model name.*?: (.*)', Path('/proc/cpuinfo').read_text(), re.MULTILINE)
    processor = names[0].strip() if names else platform.processor() or platform.machine()
    system = platform.platform(terse=True)
    return {'processor': processor, 'cores': os.cpu_count() or 1, 'system': system}
