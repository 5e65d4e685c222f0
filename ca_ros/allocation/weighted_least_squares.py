"""Weighted least squares by an active-set method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.option_values import weights_per_rotor, whole
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array, constant
from ca_ros.problem.problem import AllocationProblem
from ca_ros.schema import Parameter, check
from ca_ros.vehicle.parameters import AXES
from ca_ros.vehicle.vehicle import Vehicle

WV = ('thrust 100', 'roll 1000', 'pitch 1000', 'yaw 1')
"""The default of Wv, that of Paparazzi."""

RATIO_MAX = 1e10
"""Greatest ratio of the weights of the wrench to those of the thrusts."""

ROUNDING = 1e-10
"""Size of multipliers that count as zero, relative to their terms."""


class WeightedLeastSquares(Allocator):
    """Weighted least squares of wrench and preferred thrusts, by an active-set method.

    The thrusts minimise ``|Wu (f - f_p)|^2 + gamma |Wv (Gamma f - u)|^2`` subject to the bounds,
    the program WLS of [1]_ and the cost of [2]_.  The weights trade the axes against each other
    and against the preferred thrusts f_p, so the wrench is never met exactly, except where f_p
    gives it.  The cost depends on the units of wrench and thrusts: [2]_ has angular accelerations
    in place of torques, and thrusts as shares of a command.

    Parameters
    ----------
    vehicle : Vehicle or AllocationProblem
    gamma : float
        Weight of the wrench against the preferred thrusts.  The default is that of QCAT, the
        toolbox of the author of [1]_.
    wu : float or (n,) array
        The diagonal of Wu, positive, at most 1e4 times each other: a weight for each rotor.
    wv : sequence of str, or float or (m,) array
        The diagonal of Wv, not negative: words such as ``roll 1000``, or the numbers.  Of the
        words, those for axes that the vehicle has not are ignored; an axis without a word has the
        weight 1.
    preferred : 'zero', 'minimum', 'middle' or (n,) array
        f_p [N]: no thrust (the default of Paparazzi [3]_), the lower bounds, the middles of the
        bounds, or numbers.
    iterations : float
        Greatest number of least-squares problems for one wrench.

    Raises
    ------
    ValueError
        If an option is wrong.

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
        'min |Wu (f - f_p)|^2 + gamma |Wv (Gamma f - u)|^2 within the bounds, by an '
        'active set (as in Paparazzi)'
    )
    parameters: ClassVar = {
        'gamma': Parameter(
            'weight of the wrench against the preferred thrusts',
            default=1e6,
            positive=True,
            mutable=True,
        ),
        'wu': Parameter(
            'Wu: weight of each deviation from a preferred thrust, one number, or one for each '
            'rotor',
            array=True,
            default=1.0,
            positive=True,
            mutable=True,
        ),
        'wv': Parameter(
            'Wv: weights of the axes; an axis that is not named has the weight 1',
            str,
            array=True,
            default=list(WV),
            mutable=True,
        ),
        'preferred': Parameter(
            'preferred thrusts. zero: none; minimum: the lower bounds; middle: the middles of '
            'the bounds',
            str,
            default='zero',
            choices=('zero', 'minimum', 'middle'),
            mutable=True,
        ),
        'iterations': Parameter(
            'greatest number of least-squares problems for one wrench',
            default=100.0,
            minimum=1.0,
            mutable=True,
        ),
    }

    def __init__(
        self,
        vehicle: Vehicle | AllocationProblem,
        gamma: float = 1e6,
        wu: ArrayLike = 1.0,
        wv: Sequence[str] | ArrayLike = WV,
        preferred: str | ArrayLike = 'zero',
        iterations: float = 100.0,
    ) -> None:
        super().__init__(vehicle)
        problem, table = self.problem, self.parameters
        check('gamma', gamma, table)
        self.gamma = float(gamma)
        self.wu = weights_per_rotor('wu', wu, problem.n, table)
        self.wv = _weights(wv, problem.axes)
        self.preferred = _preferred(preferred, problem)
        self.iterations = whole('iterations', iterations, table)
        self._scale = np.sqrt(self.gamma) * self.wv
        if self._scale.max() > RATIO_MAX * self.wu.min():
            raise ValueError(
                f'gamma: sqrt(gamma) Wv, up to {self._scale.max():g}, is more than {RATIO_MAX:g} '
                f'times Wu, {self.wu.min():g}, too much for the digits of the thrusts'
            )
        self._matrix = np.vstack([self._scale[:, None] * problem.gamma, np.diag(self.wu)])
        self._lengths = np.sqrt((self._matrix**2).sum(axis=0))

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self._solve(u)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts))

    def _solve(self, u: Array) -> Array:
        """Minimise |A f - b| within the bounds by a primal active-set method.

        The method starts at the middles of the bounds, as in Paparazzi.  Each iteration solves for
        the free thrusts.  If a bound is in the way, the thrusts go as far as the bound, which
        becomes active.  Otherwise the active bound with the most negative multiplier is released.
        """
        problem, matrix = self.problem, self._matrix
        low, high = problem.lower, problem.upper
        thrusts = problem.middle.copy()
        target = np.concatenate([self._scale * u, self.wu * self.preferred])
        residual = target - matrix @ thrusts
        # +1 at an active upper bound, -1 at a lower one; fixed rotors stay out of the problem.
        active = np.zeros(problem.n)
        free = high > low
        for _ in range(self.iterations):
            basis, triangle = np.linalg.qr(matrix[:, free])
            image = basis.T @ residual
            step = np.zeros(problem.n)
            step[free] = np.linalg.solve(triangle, image)
            goal = thrusts + step
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
            multipliers = active * (residual @ matrix)
            worst = int(multipliers.argmin())
            if multipliers[worst] >= -ROUNDING * self._lengths[worst] * np.linalg.norm(residual):
                break
            active[worst], free[worst] = 0.0, True
        return thrusts


def _weights(wv: Sequence[str] | ArrayLike, axes: Sequence[str]) -> Array:
    """Return the diagonal of Wv (m,)."""
    words = [wv] if isinstance(wv, str) else wv
    if not (isinstance(words, Sequence) and all(isinstance(word, str) for word in words)):
        numbers = np.asarray(wv, dtype=float)
        if numbers.shape not in ((), (len(axes),)):
            raise ValueError(
                f'wv: expected 1 or {len(axes)} numbers ({", ".join(axes)}), got shape '
                f'{numbers.shape}'
            )
    else:
        given: dict[str, float] = {}
        for word in words:
            name, _, number = str(word).partition(' ')
            if name in given or name not in (*axes, *AXES):
                known = ', '.join(dict.fromkeys((*axes, *AXES)))
                raise ValueError(f'wv: expected each axis once, of {known}; got {word!r}')
            try:
                given[name] = float(number)
            except ValueError:
                raise ValueError(
                    f"wv: expected an axis and its weight, such as 'roll 1000', got {word!r}"
                ) from None
        numbers = np.array([given.get(axis, 1.0) for axis in axes])
    if not (np.isfinite(numbers).all() and (numbers >= 0.0).all() and (numbers > 0.0).any()):
        raise ValueError(f'wv: expected finite weights, at least 0 and not all 0, got {wv!r}')
    return constant(np.broadcast_to(numbers, (len(axes),)))


def _preferred(preferred: str | ArrayLike, problem: AllocationProblem) -> Array:
    """Return the preferred thrusts (n,) [N]."""
    if isinstance(preferred, str):
        check('preferred', preferred, WeightedLeastSquares.parameters)
        named = {'zero': np.zeros(problem.n), 'minimum': problem.lower, 'middle': problem.middle}
        return constant(named[preferred])
    thrusts = np.asarray(preferred, dtype=float)
    if thrusts.shape not in ((), (problem.n,)) or not np.isfinite(thrusts).all():
        raise ValueError(
            f"preferred: expected 'zero', 'minimum', 'middle' or {problem.n} finite numbers, "
            f'got {preferred!r}'
        )
    return constant(np.broadcast_to(thrusts, (problem.n,)))
