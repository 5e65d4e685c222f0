"""What a result depends on besides its inputs: versions and machine."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ('ca_ros', 'numpy', 'scipy', 'osqp', 'matplotlib')


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that are installed."""
    found = {'python': platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = 'not installed'
    return found


def machine() -> dict[str, str | int]:
    """Return processor, number of cores and system."""
    processor = platform.processor() or platform.machine()
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        names = [line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')]
        processor = names[0] if names else processor
    except OSError:
        pass
    return {
        'processor': processor,
        'cores': os.cpu_count() or 1,
        'system': platform.platform(terse=True),
    }
