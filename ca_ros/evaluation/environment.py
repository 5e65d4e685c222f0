"""The environment that results depend on: versions, machine, threads, load."""

from __future__ import annotations

import os
import platform
import re
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = ('ca_ros', 'numpy', 'scipy', 'osqp', 'pandas', 'matplotlib')

THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""Number of threads of linear algebra libraries; they read it when they are loaded."""

STALL = 5e-4
"""Half of the time that the answer to a command may take at 1 kHz [s]."""


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


def environment() -> dict[str, Any]:
    """Return machine, versions and settings of this process."""
    blas: Any = np.show_config(mode='dicts')
    blas = blas.get('Build Dependencies', {}).get('blas', {})
    return {
        'machine': machine(),
        'load_average': load_average(),
        'stalls': stalls(),
        'versions': versions(),
        'blas': f'{blas.get("name", "unknown")} {blas.get("version", "")}'.strip(),
        'threads': {name: os.environ.get(name, 'not set') for name in THREADS},
    }


def load_average() -> list[float]:
    """Return the load averages of the last 1, 5 and 15 minutes."""
    return [round(load, 2) for load in os.getloadavg()]


def stalls(seconds: float = 1.0) -> float:
    """Return how often a busy process is stopped for `STALL` or longer [1/s]."""
    count, last = 0, time.perf_counter()
    end = last + seconds
    while (now := time.perf_counter()) < end:
        count += now - last >= STALL
        last = now
    return count / seconds


def stolen(since: float = 0.0) -> float:
    """Return the processor time that went to other virtual machines, less `since` [s]."""
    ticks = Path('/proc/stat').read_text(encoding='ascii').split(maxsplit=9)[8]
    return int(ticks) / os.sysconf('SC_CLK_TCK') - since
