"""What times depend on besides the code: machine, versions, threads."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.evaluation.record import machine, versions

THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
"""How linear algebra libraries are told how many threads to use; read when they are loaded."""

STALL = 5e-4
"""Half of the time that the answer to a command may take at 1 kHz [s]."""


def one_thread() -> dict[str, str]:
    """Return an environment in which those libraries use one thread."""
    return {**os.environ, **dict.fromkeys(THREADS, '1')}


def is_one_thread() -> bool:
    """Tell whether this process was started so."""
    return all(os.environ.get(name) == '1' for name in THREADS)


def environment() -> dict[str, Any]:
    """Return machine, versions and settings of this process."""
    return {
        'machine': machine(),
        'load_average': load_average(),
        'stalls': stalls(),
        'versions': versions(),
        'blas': _blas(),
        'threads': {name: os.environ.get(name, 'not set') for name in THREADS},
        'clock': f'time.perf_counter_ns, {time.get_clock_info("perf_counter").resolution:.0e} s',
        'garbage_collector': 'off while calls are timed',
    }


def load_average() -> list[float]:
    """Return the mean numbers of processes that wanted to run in the last 1, 5 and 15 minutes."""
    return [round(load, 2) for load in os.getloadavg()]


def stalls(seconds: float = 1.0) -> float:
    """Return how often this process stands still for `STALL` or longer while it is busy [1/s]."""
    count, last = 0, time.perf_counter()
    end = last + seconds
    while (now := time.perf_counter()) < end:
        count += now - last >= STALL
        last = now
    return count / seconds


def stolen(since: float = 0.0) -> float | None:
    """Return how long others had this machine's processors, less `since` [s]; None if unknown."""
    try:
        ticks = Path('/proc/stat').read_text(encoding='ascii').split(maxsplit=9)[8]
    except OSError:
        return None
    return int(ticks) / os.sysconf('SC_CLK_TCK') - since


def _blas() -> str:
    found: Any = np.show_config(mode='dicts')
    blas = found.get('Build Dependencies', {}).get('blas', {})
    return f'{blas.get("name", "unknown")} {blas.get("version", "")}'.strip()
