"""Who takes part in a benchmark."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from time import perf_counter
from typing import Any

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.peers import PEERS, Call
from ca_ros.evaluation.benchmark.timing import Track
from ca_ros.problem.problem import AllocationProblem

BASELINE = 'clipped_pinv'
"""The clipped pseudo-inverse, in whose time all others are expressed."""


@dataclass(frozen=True, eq=False)
class Contender:
    """A way to answer a wrench.

    Attributes
    ----------
    call : callable
    kind : str
        'baseline', 'method' of this package, or 'peer'.
    about : mapping
        What a call does, with which version and settings, and how long the set-up took [s].
    """

    call: Call
    kind: str
    about: Mapping[str, Any]

    def track(self, wrenches: Array) -> Track:
        """Return the contender with the wrenches (W, m) that it is to allocate."""
        thrusts = attrgetter('thrusts') if self.kind == 'method' else _as_it_is
        return Track(self.call, wrenches, thrusts)


def baseline(problem: AllocationProblem) -> Contender:
    """Return the clipped pseudo-inverse in bare NumPy: no checks, no result object."""
    inverse, low, high = np.linalg.pinv(problem.gamma), problem.lower, problem.upper
    minimum, maximum = np.minimum, np.maximum

    def call(u: Array) -> Array:
        return minimum(maximum(inverse @ u, low), high)

    return Contender(
        call, 'baseline', {'interface': 'np.minimum(np.maximum(inverse @ u, low), high)'}
    )


def method(make: Callable[[], Allocator]) -> Contender:
    """Return a method of this package, or of the user's own."""
    start = perf_counter()
    allocator = make()
    about = {'interface': 'allocate, checks and result included', 'setup': perf_counter() - start}
    return Contender(allocator.allocate, 'method', about)


def peer(name: str, problem: AllocationProblem) -> Contender:
    """Return a solver of `PEERS`; raise an ImportError if it is not installed."""
    found, start = PEERS[name], perf_counter()
    call = found.call(problem)
    return Contender(
        call,
        'peer',
        {
            'package': found.package,
            'version': found.version(),
            'interface': found.interface,
            'settings': dict(found.settings),
            'setup': perf_counter() - start,
        },
    )


def peers(problem: AllocationProblem) -> tuple[dict[str, Contender], dict[str, str]]:
    """Return the solvers that are installed, and of the others how to install them."""
    there: dict[str, Contender] = {}
    absent: dict[str, str] = {}
    for name, found in PEERS.items():
        try:
            there[name] = peer(name, problem)
        except ImportError:
            absent[name] = f'pip install {found.package}'
    return there, absent


def _as_it_is(answer: Any) -> Any:
    return answer
