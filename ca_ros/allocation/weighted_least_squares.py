"""Weighted least squares by an active-set method."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array, constant
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.problem import UNITS_MIN, AllocationProblem
from ca_ros.settings import Numbers, ParameterError, Settings, Words, setting
from ca_ros.solver.convex_sets import ConvexSets, Interval
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.validation import check_ratio, repeated

WV = ('thrust 100', 'roll 1000', 'pitch 1000', 'yaw 1')  # the default of Wv, that of Paparazzi
RATIO_MAX = 1e10  # greatest ratio of the weights of the wrench to those of the thrusts
FREE = 1e-3  # least weight of an axis of vectors, for the digits of what it may miss
STEPS_MAX = 100  # least-squares problems for one wrench, at most
ROUNDING = 1e-10  # size of multipliers that count as zero, relative to their terms


@dataclass(frozen=True, kw_only=True)
class WeightedLeastSquaresSettings(Settings):
    """The settings of `WeightedLeastSquares`."""

    gamma: float = setting(
        1e6, 'weight of the wrench against the preferred thrusts', positive=True,
        python_only=True)
    wu: Numbers = setting(
        1.0,
        'Wu: weight of each deviation from a preferred thrust, as a share of half of its range, '
        'one number, or one for each rotor, at most 1e4 times each other', positive=True,
        mutable=True)
    wv: Words | Numbers = setting(
        WV, 'Wv: weights of the errors of the axes, as shares of half of their ranges; an axis '
        'that is not named has the weight 1', mutable=True)
    preferred: Literal['zero', 'minimum', 'middle'] | Numbers = setting(
        'zero',
        'preferred thrusts. zero: none; minimum: the lower bounds; middle: the middles of the '
        'bounds; or numbers [N]', mutable=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ratio('wu', self.wu)


class WeightedLeastSquares(Allocator):
    """Weighted least squares of wrench and preferred thrusts, by an active-set method.

    The thrusts minimise ``|Wu (f - f_p) / h|^2 + gamma |Wv (Gamma f - u) / r|^2`` subject to the
    bounds, the program WLS of [1]_ and the cost of [2]_.  The weights trade the axes against each
    other and against the preferred thrusts f_p, so the wrench is never met exactly, except where
    f_p gives it.

    h (n,) and r (m,) are half of the ranges of the thrusts and of the components of the wrench,
    the `half_range` and the `extent` of the problem.  So the same weights suit vehicles of any
    size and units; [2]_ has angular accelerations and shares of a command for the same purpose.
    Multiply weights for newtons and newton metres by h and r.

    By default, gamma is that of QCAT, the toolbox of the author of [1]_; Wv and f_p are those of
    Paparazzi [3]_.  Words of Wv for axes that the vehicle has not are ignored.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    gamma : float, default 1e6
        Weight of the wrench against the preferred thrusts, beside Wv.
    wu : float or (n,) array, default 1
        Weight of each deviation from a preferred thrust, as a share of h, positive, at most 1e4
        times each other.
    wv : sequence of str or (m,) array, default ('thrust 100', 'roll 1000', 'pitch 1000', 'yaw 1')
        Weights of the errors of the axes, as shares of r; an axis that is not named has the
        weight 1.
    preferred : {'zero', 'minimum', 'middle'} or (n,) array, default 'zero'
        f_p: zero, the lower bounds, the middles of the bounds, or the thrusts [N].

    References
    ----------
    .. [1] O. Harkegard, "Efficient active set algorithms for solving constrained least squares
       problems in aircraft control allocation", IEEE Conference on Decision and Control, 2002.
    .. [2] E. Smeur, D. Hoppener and C. De Wagter, "Prioritized control allocation for quadrotors
       subject to saturation", International Micro Air Vehicle Conference, 2017.
    .. [3] Paparazzi UAV, stabilization_indi.c and wls_alloc.c, as of 2023:
       https://github.com/paparazzi/paparazzi
    """

    solves = (
        'min |Wu (f - f_p) / h|^2 + gamma |Wv (Gamma f - u) / r|^2 within the bounds, with half '
        'ranges h and r, by an active set (as in Paparazzi)'
    )

    takes_vectors = True

    settings_type = WeightedLeastSquaresSettings
    settings: WeightedLeastSquaresSettings

    def _set_up(self) -> None:
        problem, sets = self.problem, self.problem.sets
        wu = problem.spread('wu', self.settings.wu)
        wv = np.sqrt(self.settings.gamma) * _weights(self.settings.wv, problem.axes)
        self.preferred = _preferred(self.settings.preferred, problem)
        if wv.max() > RATIO_MAX * wu.min():
            raise ParameterError(
                f'wv: sqrt(gamma) Wv, up to {wv.max():g}, is more than {RATIO_MAX:g} '
                f'times Wu, {wu.min():g}, too much for the digits of the thrusts'
            )
        # All components of a vector have the range along its axis.
        half, extent = problem.half_range[sets.first][sets.owners], problem.extent
        half = np.where(half > 0.0, half, 1.0)
        extent = np.where(extent > UNITS_MIN * extent.max(), extent, 1.0)
        self._wu, self._scale = wu / half, wv / extent
        self._matrix = np.vstack([self._scale[:, None] * problem.gamma, np.diag(self._wu)])
        self._lengths = np.sqrt((self._matrix**2).sum(axis=0))
        self._solve = self._over_box
        if isinstance(sets, ConvexSets):
            if isinstance(self.settings.preferred, str):
                # Vectors cannot be preferred outside of their sets.
                self.preferred = constant(problem.clip(self.preferred))
            # What the wrench misses is one more effector for each axis, as good as unbounded.
            slack = np.diag(extent / np.maximum(wv, FREE))
            ends = [Interval(-1e9, 1e9)] * len(problem.axes)
            self._newton = sets_newton(
                np.hstack([problem.gamma, slack]), ConvexSets([*sets.sets, *ends]),
                np.concatenate([self._wu, np.ones(len(ends))]),
                np.concatenate([self.preferred, np.zeros(len(ends))]),
            )
            self._solve = self._over_sets

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self._solve(u)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))

    def _over_sets(self, u: Array) -> Array:
        return self._newton.solve(u[None]).points[0, : self.problem.n]

    def _over_box(self, u: Array) -> Array:
        """Minimise |A f - b| within the bounds, from their middles on, as in Paparazzi."""
        problem, matrix = self.problem, self._matrix
        low, high = problem.lower, problem.upper
        thrusts = problem.middle.copy()
        target = np.concatenate([self._scale * u, self._wu * self.preferred])
        residual = target - matrix @ thrusts
        # +1 at an active upper bound, -1 at a lower one; fixed rotors stay out of the problem.
        active = np.zeros(problem.n)
        free = high > low
        for _ in range(STEPS_MAX):
            basis, triangle = np.linalg.qr(matrix[:, free])
            image = basis.T @ residual
            step = np.zeros(problem.n)
            step[free] = np.linalg.solve(triangle, image)
            goal = thrusts + step
            # The thrusts go as far as the first bound in the way, which becomes active.
            beyond = free & ((goal < low) | (goal > high))
            if beyond.any():
                ends = np.where(step > 0.0, high, low)
                shares = np.full(problem.n, np.inf)
                shares[beyond] = (ends - thrusts)[beyond] / step[beyond]
                first = int(shares.argmin())
                thrusts = problem.clip(thrusts + shares[first] * step)
                thrusts[first] = ends[first]
                residual -= shares[first] * (basis @ image)
                active[first], free[first] = np.sign(step[first]), False
                continue
            thrusts = goal
            # A second projection removes what rounding has left in the space of the free columns.
            residual -= basis @ image
            residual -= basis @ (basis.T @ residual)
            # The active bound with the most negative multiplier is released.
            multipliers = active * (residual @ matrix)
            worst = int(multipliers.argmin())
            if multipliers[worst] >= -ROUNDING * self._lengths[worst] * np.linalg.norm(residual):
                break
            active[worst], free[worst] = 0.0, True
        return thrusts


def _weights(wv: Words | Numbers, axes: Sequence[str]) -> Array:
    """Return the diagonal of Wv (m,)."""
    words = wv if isinstance(wv, tuple) else (wv,)
    if not all(isinstance(word, str) for word in words):
        numbers = repeated('wv', wv, len(axes), f'axis ({", ".join(axes)})')
    else:
        given: dict[str, float] = {}
        for word in words:
            name, _, number = str(word).partition(' ')
            if name in given or name not in (*axes, *AXES):
                known = ', '.join(dict.fromkeys((*axes, *AXES)))
                raise ParameterError(f'wv: expected each axis once, of {known}; got {word!r}')
            try:
                given[name] = float(number)
            except ValueError:
                raise ParameterError(
                    f"wv: expected an axis and its weight, such as 'roll 1000', got {word!r}"
                ) from None
        numbers = np.array([given.get(axis, 1.0) for axis in axes])
    if not (np.isfinite(numbers).all() and (numbers >= 0.0).all() and (numbers > 0.0).any()):
        raise ParameterError(f'wv: expected finite weights, at least 0 and not all 0, got {wv!r}')
    return constant(numbers)


def _preferred(preferred: str | Numbers, problem: AllocationProblem) -> Array:
    """Return the preferred thrusts (n,) [N]."""
    if isinstance(preferred, str):
        named = {'zero': np.zeros(problem.n), 'minimum': problem.lower, 'middle': problem.middle}
        return constant(named[preferred])
    return problem.spread('preferred', preferred, along=True)
