"""Golden vectors: wrenches inside, on and outside of the admissible set, with their answers."""

from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.firmware.firmware import Firmware

SIZE = 12  # number of wrenches of each kind for each fault

Entry = tuple[Any, ...]  # of an array of structures in C

BEYOND = 3.0  # greatest distance of a wrench from the centre over that of the boundary


def wrenches(firmware: Firmware, fault: int, size: int, seed: int = 0) -> Array:
    """Return wrenches (3 size, m): attainable ones, then on the boundary, then beyond it."""
    rng = np.random.default_rng((seed, fault))
    inside, on, center = firmware.drawn(fault, rng, size)
    beyond = center + rng.uniform(1.0, BEYOND, (size, 1)) * (on - center)
    return np.vstack([inside, on, beyond]).astype(firmware.dtype)


def sequence(firmware: Firmware) -> list[Entry]:
    """Return a sequence of answers within the rates, from standing rotors."""
    found, last = [], np.zeros(firmware.problem.n, firmware.dtype)
    times = np.random.default_rng(1).choice([0.0, 0.002, 0.02, 9.0], 3 * SIZE)
    for fault in range(len(firmware.faults)):
        for wrench, time in zip(wrenches(firmware, fault, SIZE, 1), times, strict=True):
            status, last = firmware.allocate_within(fault, wrench, time, last)
            found.append((fault, wrench, time, status, last))
    return found


def special(firmware: Firmware) -> Array:
    """Return wrenches (N, m) at rest, at hover, too large, infinite and not a number."""
    hover = firmware.problem.reference
    numbers = [0.0, 1e30, -1e30, np.inf, -np.inf, np.nan]
    found = [np.zeros_like(hover), hover, -hover, 1e6 * hover]
    for k in range(len(hover)):
        for number in numbers:
            found.append(hover.copy())
            found[-1][k] = number
    return np.array(found).astype(firmware.dtype)


def vectors(firmware: Firmware) -> list[Entry]:
    """Return the golden vectors: fault, wrench, status, command and margin, if there is one."""
    last = len(firmware.faults)
    given = [
        (fault, wrench) for fault in range(last)
        for wrench in np.vstack([wrenches(firmware, fault, SIZE), special(firmware)])
    ]
    hover = firmware.problem.reference.astype(firmware.dtype)
    return [
        (fault, wrench, *firmware.allocate(fault, wrench),
         *([firmware.margin(fault, wrench)] if firmware.has_margin else []))
        for fault, wrench in (*given, (-1, hover), (last, hover))
    ]


def healths(firmware: Firmware) -> list[Entry]:
    """Return healths of the rotors, each with its fault: those of all faults, and others."""
    sound, n = firmware.health[0], firmware.problem.n
    given = [*firmware.health]
    for i in range(n):
        for numbers in (0.0, 0.0), (0.4, 0.4), (0.7, 1.0), (np.nan, 1.0), (np.inf, 1.0):
            given.append(sound.copy())
            given[-1][[i, i - 1]] = numbers
    return [(health, firmware.fault_of(health)) for health in given]


def effort(firmware: Firmware, size: int, seed: int) -> tuple[int, int]:
    """Return the greatest numbers of steps and pivots over 3 size wrenches for each fault."""
    work = np.zeros((len(firmware.faults), 3 * size, 2), np.int32)
    for fault, kernel in enumerate(firmware.kernels):
        demands = wrenches(firmware, fault, size, seed)[:, firmware.rows[fault]]
        kernel.allocate_batch(
            np.ascontiguousarray(demands),
            np.empty((3 * size, firmware.problem.n), firmware.dtype),
            np.empty(3 * size, np.int8), np.empty(3 * size, firmware.dtype), work[fault],
        )
    steps, pivots = work.max(axis=(0, 1)).tolist()
    return steps, pivots
