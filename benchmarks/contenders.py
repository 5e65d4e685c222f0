"""The contenders of the benchmark: the baseline, our methods, and the solvers of others."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks import peers
from benchmarks.peers import Call
from ca_ros.allocation import Allocator, make_allocator
from ca_ros.problem.problem import AllocationProblem

BASELINE = 'clipped_pinv'  # the clipped pseudo-inverse; its time is the unit of all others


@dataclass(frozen=True)
class Contender:
    """A way to answer wrenches; `build` returns the call for a problem.

    A solver of others has a `package`; `settings`, the arguments of `build`, are those that are
    not its defaults.
    """

    build: Callable[..., Call]
    package: str = ''
    settings: Mapping[str, Any] = field(default_factory=dict)

    def call(self, problem: AllocationProblem) -> Call:
        """Return the call for a problem; raise an ImportError without the package."""
        return self.build(problem, **self.settings)

    @property
    def about(self) -> str:
        """The package, its version, and the settings; '' for a method of this package."""
        words = [f'{self.package} {version(self.package)}' if self.package else '']
        return ', '.join([*words, *(f'{name}={value}' for name, value in self.settings.items())])


def method(make: Callable[[Any], Allocator]) -> Contender:
    """Return a method of this package, or of one's own; `make` gets the vehicle, or a problem."""
    return Contender(lambda problem: make(getattr(problem, 'vehicle', problem)).allocate)


def peer(package: str, build: Callable[..., Call], **settings: Any) -> Contender:
    """Return a solver of others as a contender."""
    return Contender(build, package, settings)


def _clipped_pinv(problem: AllocationProblem) -> Call:
    inverse, low, high = np.linalg.pinv(problem.gamma), problem.lower, problem.upper
    minimum, maximum = np.minimum, np.maximum
    return lambda u: minimum(maximum(inverse @ u, low), high)


EXACT = method(partial(make_allocator, 'exact'))
POLICIES = {
    f'exact_{policy}': method(partial(make_allocator, 'exact', policy=policy))
    for policy in ('scale', 'reject')
}
"""The policies of the exact allocator other than prioritize, its default, by name."""

CONTENDERS: dict[str, Contender] = {
    BASELINE: Contender(_clipped_pinv), 'osqp': peer('osqp', peers.osqp),
    'osqp_polished': peer('osqp', peers.osqp, eps_abs=1e-5, eps_rel=1e-5, polishing=True),
    'daqp': peer('daqp', peers.daqp), 'daqp_reused': peer('daqp', peers.daqp_reused),
    'daqp_hierarchical': peer('daqp', peers.daqp_hierarchical),
    'quadprog': peer('quadprog', peers.quadprog), 'piqp': peer('piqp', peers.piqp),
    'proxqp': peer('proxsuite', peers.proxqp, eps_abs=1e-9, eps_rel=0.0, max_iter=100),
    'clarabel': peer('clarabel', peers.clarabel, max_threads=1, presolve_enable=False),
    'highs': peer('highspy', peers.highs, threads=1),
}
"""The baseline and the solvers of others by name; a run adds the methods."""


def set_up(
    contenders: Mapping[str, Contender], problem: AllocationProblem
) -> tuple[dict[str, Call], dict[str, str]]:
    """Return the calls of the contenders, and what to install for those that are absent."""
    calls, absent = {}, {}
    for name, contender in contenders.items():
        try:
            calls[name] = contender.call(problem)
        except ImportError:
            absent[name] = f'pip install {contender.package}'
    return calls, absent
