"""The contenders of a benchmark: the baseline, our methods, and the solvers of others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from time import perf_counter
from typing import Any

import numpy as np

from ca_ros.allocation import Allocator, make_allocator
from ca_ros.evaluation.benchmark import peers
from ca_ros.evaluation.benchmark.peers import Call
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem

BASELINE = 'clipped_pinv'
"""The clipped pseudo-inverse; its time is the unit of all others."""


@dataclass(frozen=True)
class Contender:
    """A way to answer wrenches: 'baseline', 'method' of this package, or 'peer'.

    `build` returns the call for a problem; the settings other than the solver's defaults are its
    keyword arguments.
    """

    kind: str
    build: Callable[..., Call]
    package: str = ''
    settings: Mapping[str, Any] = field(default_factory=dict)

    def call(self, problem: AllocationProblem) -> Call:
        """Return the call for a problem; raise an ImportError without the package."""
        return self.build(problem, **self.settings)


def method(make: Callable[[Any], Allocator]) -> Contender:
    """Return a method of this package, or of the user's own, as a contender.

    `make` gets the vehicle, or a problem without a vehicle.
    """

    def build(problem: AllocationProblem) -> Call:
        subject = problem.vehicle if isinstance(problem, VehicleProblem) else problem
        return make(subject).allocate

    return Contender('method', build)


def peer(package: str, build: Callable[..., Call], **settings: Any) -> Contender:
    """Return a solver of others as a contender."""
    return Contender('peer', build, package, settings)


EXACT = method(partial(make_allocator, 'exact'))

POLICIES = {
    f'exact_{policy}': method(partial(make_allocator, 'exact', policy=policy))
    for policy in ('scale', 'reject')
}
"""The policies of the exact allocator other than prioritize, its default, by name."""


def _clipped_pinv(problem: AllocationProblem) -> Call:
    inverse, low, high = np.linalg.pinv(problem.gamma), problem.lower, problem.upper
    minimum, maximum = np.minimum, np.maximum
    return lambda u: minimum(maximum(inverse @ u, low), high)


CONTENDERS: dict[str, Contender] = {
    BASELINE: Contender('baseline', _clipped_pinv),
    'osqp': peer('osqp', peers.osqp),
    'osqp_polished': peer('osqp', peers.osqp, eps_abs=1e-5, eps_rel=1e-5, polishing=True),
    'daqp': peer('daqp', peers.daqp),
    'daqp_reused': peer('daqp', peers.daqp_reused),
    'quadprog': peer('quadprog', peers.quadprog),
    'piqp': peer('piqp', peers.piqp),
    'proxqp': peer('proxsuite', peers.proxqp, eps_abs=1e-9, eps_rel=0.0, max_iter=100),
    'clarabel': peer('clarabel', peers.clarabel, max_threads=1, presolve_enable=False),
    'highs': peer('highspy', peers.highs, threads=1),
}
"""The baseline and the peers by name; a run adds the methods.

docs/performance.md lists the interface of each, and why this one.
"""


def set_up(
    contenders: Mapping[str, Contender], problem: AllocationProblem
) -> tuple[dict[str, Call], dict[str, Any], dict[str, str]]:
    """Set up the contenders whose packages are installed.

    Returns the calls, what benchmark.json has about them (package, version, settings, and the
    time of the set-up [s]), and how to install the packages of the others.
    """
    calls: dict[str, Call] = {}
    about: dict[str, Any] = {}
    absent: dict[str, str] = {}
    for name, each in contenders.items():
        start = perf_counter()
        try:
            calls[name] = each.call(problem)
        except ImportError:
            absent[name] = f'pip install {each.package}'
            continue
        setup = perf_counter() - start
        about[name] = {'kind': each.kind, 'setup': setup, 'package': each.package}
        about[name]['settings'] = dict(each.settings)
        with suppress(PackageNotFoundError):
            about[name]['version'] = version(each.package) if each.package else ''
    return calls, about, absent
