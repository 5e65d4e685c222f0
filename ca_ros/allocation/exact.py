"""The exact allocator, the paper's proposal."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np
from numpy import empty, ndarray
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.box_backend import BoxBackend, BoxKernel, BoxNumpy
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.explanation import Explanation
from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.allocation.sets_backend import SetsKernel, SetsNumpy
from ca_ros.arrays import Array, floats
from ca_ros.kernel import INVALID, chosen, warn_if_missing
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.audit import Audit
from ca_ros.problem.problem import AllocationProblem
from ca_ros.solver.convex_sets import Box

EXACT = Status.EXACT  # a name of its own is found faster than a member
new = object.__new__

STATUSES = {int(status): status for status in Status}  # ten times as fast as the enumeration
THREAD_MIN = 8192  # wrenches of a batch for each thread, at least


def processors() -> int:
    """Return the number of processors that this process may use."""
    # macOS has no affinities.
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


Backend = BoxBackend | SetsNumpy | SetsKernel


def backend_of(problem: AllocationProblem, settings: ExactSettings) -> Backend:
    """Return the backend of a problem: for a box or for convex sets, in C or in NumPy.

    NumPy does what the kernel was not built for, or has no room for.  Raises a ValueError if the
    problem's admissible set has no volume, or a setting does not suit the problem.
    """
    if isinstance(problem.sets, Box):
        kernel = chosen(problem.n, len(problem.axes))
        if kernel is not None:
            return BoxKernel(kernel, problem, settings)
        warn_if_missing()
        return BoxNumpy(problem, settings)
    backend = SetsNumpy(problem, settings)
    if backend.engine == 'NumPy':
        warn_if_missing()
    made = backend.kernel()
    return backend if made is None else SetsKernel(made, backend)


class Exact(Allocator):
    """Allocate the wrench exactly, with the smallest thrusts, Eqs. (20)-(22).

    The allocator solves ``min |f|^2`` subject to ``Gamma f = u`` and the bounds of the thrusts.
    With weights or preferred thrusts the cost is ``|W (f - f_p)|^2``.
    The problem is feasible for every u in the admissible set.  For a u outside the set, the policy
    chooses an attainable wrench, which is then allocated exactly.  A batch uses all processors
    that the process may run on.

    Where facets of the admissible set are almost parallel, because the vehicle is symmetric except
    for the rounding of its file, `residual_slack` keeps the thrusts from jumping.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    policy : {'prioritize', 'scale', 'reject'}, default 'prioritize'
        What is allocated for an unattainable wrench: its axes in the order of their priorities,
        the wrench scaled towards a reference, or nothing.
    order : sequence of str, default ('roll pitch', 'thrust', 'yaw', 'force_x force_y')
        Priorities of 'prioritize': groups of axes, the most important first.
    axis_reversal : {'prevent', 'allow'}, default 'prevent'
        Whether an axis after the first group may get the opposite of its demand.  'prevent':
        thrust deviates from its demand as far as prevents it.
    airmode_limit : float or (2,) array, default 1
        How far thrust may rise above its demand for roll and pitch, and for yaw, as shares of its
        range.
    scale_reference : (m,) array, optional
        The reference of 'scale' [N, N m]; by default hover.
    residual_slack : float, default 1e-9
        Greatest error of an attainable wrench u, as a share of max(1, |u|).
    weights : float or (n,) array, default 1
        Diagonal of W, positive, at most 1e4 times each other.
    preferred : float or (n,) array, default 0
        Preferred thrusts f_p [N].

    Attributes
    ----------
    engine : str
        'C' if the kernel (`ca_ros.kernel`) solves the problem, or 'NumPy'; see `backend_of`.

    Raises
    ------
    ValueError
        If an option is wrong, or the vehicle's admissible set has no volume.

    Examples
    --------
    >>> allocator = Exact(Vehicle.load('hexarotor'), policy='scale')
    >>> answer = allocator.allocate([9.81, 3.0, 0.0, 0.0])
    >>> print(answer)
    SCALED: thrust 9.81, roll 2.744 of 3, pitch 0, yaw 0
    >>> answer.speeds.round(1)
    array([186., 400., 400., 186.,  40.,  40.])
    """

    solves = 'quadratic program: min |f|^2 with Gamma f = u within the bounds'
    guarantees = 'the bounds, and Gamma f = u for every admissible u'
    takes_vectors = True
    keeps_tilt_rates = True
    settings_type = ExactSettings
    settings: ExactSettings

    def _set_up(self) -> None:
        problem, settings = self.problem, self.settings
        self._m, self._n = problem.gamma.shape
        self._preference = settings.preference(problem)
        self._backend = backend_of(problem, settings)
        self._solve: Any = self._backend.allocate
        self.engine = self._backend.engine
        if settings.policy == 'prioritize':
            self.missed = Status.PRIORITIZED

    @classmethod
    def suited(cls, report: Audit, settings: ExactSettings) -> tuple[AllocationProblem, Any]:
        """Return problem and settings after failures; see `Allocator.suited`.

        Lost axes are the last group of 'prioritize', and no part of the problem of the others.
        A reference of 'scale' that failures have put out of reach is replaced by the default.
        """
        if settings.policy == 'prioritize':
            problem, lost = report.independent, [
                axis for axis in report.lost if axis in report.independent.axes]
            groups = settings.groups(problem.axes)
            if lost and {axis for group in groups[-len(lost):] for axis in group} != {*lost}:
                kept = [tuple(axis for axis in group if axis not in lost) for group in groups]
                order = [' '.join(group) for group in [*kept, tuple(lost)] if group]
                settings = replace(settings, order=order)
            return problem, settings
        problem = report.controllable
        if settings.scale_reference is not None:
            full = report.full.check(settings.scale_reference, name='scale_reference')
            rows = [report.full.axes.index(axis) for axis in problem.axes]
            settings = replace(settings, scale_reference=full[rows])
            if report.full.failed and problem.interior.has_volume:
                inner = AdmissibleSet(problem).center
                # What the failures leave may not reach it: the default takes its place.
                if problem.reach(inner, full[rows] - inner, 1.0) < 1.0:
                    settings = replace(settings, scale_reference=None)
        return problem, settings

    def __reduce__(self) -> tuple[type[Exact], tuple[object, ...]]:
        # The kernel cannot be copied; its set-up takes microseconds.
        return type(self), (self.problem, self.settings)

    def allocate(self, u: ArrayLike) -> Allocation:
        """Allocate one wrench; see `Allocator.allocate`."""
        demand, thrusts = empty(self._m), empty(self._n)
        try:
            answer = self._solve(u if type(u) is ndarray else floats(u), demand, thrusts)
        except (TypeError, ValueError):
            # The check converts other numbers, or names what is wrong.
            answer = self._solve(self.problem.check(u), demand, thrusts)
        # As Allocation(...) does, in half of its time.
        result = new(Allocation)
        fields = result.__dict__
        fields['problem'] = self.problem
        fields['demand'] = demand
        fields['thrusts'] = thrusts
        if self._preference is not None:
            fields['preference'] = self._preference
        if answer is None:
            fields['status'] = EXACT
            return result
        number, level = answer
        if number == INVALID:
            self.problem.check(demand)
        fields['status'] = STATUSES[number]
        if level != 1.0:
            fields['level'] = level
        fields['_explain'] = self._explain
        return result

    def allocate_within(self, u: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Allocation:
        """Allocate one wrench within narrower bounds; see `Allocator.allocate_within`."""
        demand, thrusts = empty(self._m), empty(self._n)
        try:
            wrench = u if type(u) is ndarray else floats(u)
            answer = self._solve(wrench, demand, thrusts, lower, upper)
        except (TypeError, ValueError):
            lower, upper = self.problem.check_bounds(lower, upper)
            answer = self._solve(self.problem.check(u), demand, thrusts, lower, upper)
        number, level = answer or (int(EXACT), 1.0)
        bounds: Any = lower, upper
        if number == INVALID:
            self.problem.check(demand)
            bounds = self.problem.check_bounds(lower, upper)
        return Allocation(
            self.problem, demand, thrusts, STATUSES[number], level, 0.0, self._preference,
            bounds, _explain=None if answer is None else self._explain,
        )

    def _explain(self, answer: Allocation) -> Explanation:
        return self._backend.explain(answer)

    def _allocate(self, u: Array) -> Allocation:
        return self.allocate(u)

    def _allocate_batch(self, demands: Array) -> AllocationBatch:
        if self._backend.allocate_batch is None:
            return replace(super()._allocate_batch(demands), preference=self._preference)
        size = len(demands)
        demands = np.ascontiguousarray(demands)
        thrusts = np.empty((size, self._n))
        status, levels = np.empty(size, dtype=np.int8), np.empty(size)
        threads = max(1, min(processors(), size // THREAD_MIN))
        ends = [i * size // threads for i in range(threads + 1)]

        def work(first: int, last: int) -> None:
            part = slice(first, last)
            self._backend.allocate_batch(
                demands[part], thrusts[part], status[part], levels[part], None
            )

        if threads > 1:
            # Imported here: few programs allocate great batches.
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(work, ends[:-1], ends[1:]))
        elif size:
            work(0, size)
        violations = np.zeros(size)
        return AllocationBatch(
            self.problem, demands, thrusts, status, levels, violations, self._preference)
