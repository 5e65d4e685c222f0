"""The thrust curve of a motor with its propeller: thrust, speed, throttle and PWM."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, constant
from ca_ros.settings import ParameterError
from ca_ros.vehicle.settings import ThrustCurveSettings

APART_MAX = 2.0  # ratio of full thrusts by curve and k_f; beyond, a unit is wrong

NONE: Array = constant(np.zeros(0))


@dataclass(frozen=True, eq=False)
class ThrustCurve:
    """Thrust and throttle of a motor with its propeller over its speed.

    The thrust is ``f = a w^2 + b w + c``, with other numbers in each of K segments; without
    segments it is ``f = k_f w^2``.  It is zero at rest, continuous and increasing, so that each
    thrust has one speed.

    The throttle, from 0 to 1, is piecewise linear in the speed.  Where none was measured, it is
    the x of ``f / f_max = expo x^2 + (1 - expo) x``, the thrust model of PX4 (THR_MDL_FAC).
    Raises a ParameterError if the thrust or the throttle does not increase, or the thrust is not
    zero at rest.

    - `coefficient`: k_f [kg m].  A rotor with another k_f has the thrust of the curve in the ratio
      of both
    - `starts` (K,): speeds at which the segments begin [rad/s]; the first is 0
    - `segments` (K, 3): a, b and c of each segment
    - `throttle_speeds` and `throttles` (L,): speeds [rad/s] and their throttles; empty: `expo`
      gives the throttle
    - `expo`: in [0, 1]
    - `pwm`: pulse widths of no throttle and of full throttle [us]
    """

    coefficient: float = 1.0
    starts: Array = field(default_factory=lambda: NONE)
    segments: Array = field(default_factory=lambda: NONE.reshape(0, 3))
    throttle_speeds: Array = field(default_factory=lambda: NONE)
    throttles: Array = field(default_factory=lambda: NONE)
    expo: float = 0.0
    pwm: tuple[float, float] = (1000.0, 2000.0)

    @classmethod
    def polynomial(cls, numbers: ArrayLike, low: float, high: float) -> ThrustCurve:
        """Return the curve ``f = a w^2 + b w + c`` from the speeds `low` to `high` [rad/s].

        Below `low` the thrust falls with the square of the speed, to zero at rest.
        """
        a, b, c = np.asarray(numbers, dtype=float).tolist()
        at_low = (a * low + b) * low + c
        if low <= 0.0 and c != 0.0:
            raise ParameterError(f'polynomial: {c:g} N at rest: expected c = 0 or speed_min > 0')
        slope = min(2.0 * a * low + b, 2.0 * a * high + b)
        if slope < 0.0 or at_low < 0.0 or (low > 0.0 and at_low == 0.0) or not (a or b):
            raise ParameterError(
                f'polynomial: {at_low:g} N at {low:g} rad/s, least slope {slope:g} N s/rad: '
                f'expected thrusts that are positive and increase from speed_min to {high:.4g} '
                'rad/s, at full throttle'
            )
        if low <= 0.0:
            return cls(starts=constant([0.0]), segments=constant([[a, b, c]]))
        rows = [[at_low / low**2, 0.0, 0.0], [a, b, c]]
        return cls(starts=constant([0.0, low]), segments=constant(rows))

    @classmethod
    def table(cls, speeds: ArrayLike, thrusts: ArrayLike) -> ThrustCurve:
        """Return the curve through speeds [rad/s] and thrusts [N]; it is quadratic between them.

        Below the first point the thrust falls with the square of the speed, to zero at rest.
        """
        w, f = points(speeds, 'thrusts', thrusts)
        if (w[0] == 0.0) != (f[0] == 0.0):
            raise ParameterError(f'thrusts: {f[0]:g} N at {w[0]:g} rad/s: expected 0 only at rest')
        a = np.diff(f) / np.diff(w**2)
        rows = np.column_stack([a, np.zeros(len(a)), f[:-1] - a * w[:-1] ** 2])
        return cls(starts=constant(w[:-1]), segments=constant(rows))

    @classmethod
    def from_settings(
        cls, settings: ThrustCurveSettings, coefficient: Array, low: Array, high: Array,
        full: float,
    ) -> ThrustCurve:
        """Return the curve of rotors with k_f and bounds of the speeds (n,) [kg m, rad/s].

        `full` is the greatest speed of full throttle [rad/s], up to which the throttle needs the
        thrust if it was not measured.  Raises a ParameterError also if the curve does not reach
        the greatest speed, or fits neither k_f nor rotors that reverse.
        """
        made, k_f, top = cls(), float(coefficient[0]), float(high.max())
        if settings.polynomial != 0.0 or settings.thrusts != 0.0:
            if (coefficient != k_f).any() or (low < 0.0).any():
                raise ParameterError(
                    'polynomial, thrusts: expected rotors with one thrust_coefficient that do not '
                    'reverse (speed_min >= 0)'
                )
            if settings.polynomial != 0.0:
                end = top if settings.throttles != 0.0 else full
                made = cls.polynomial(settings.polynomial, float(low.min()), end)
            else:
                made = cls.table(settings.speeds, settings.thrusts)
        made = replace(made, coefficient=k_f, expo=settings.expo)
        if settings.pwm != 0.0:
            first, last = np.asarray(settings.pwm, dtype=float).tolist()
            made = replace(made, pwm=(first, last))
        if settings.speeds != 0.0 and (end := np.max(settings.speeds)) < top * (1.0 - 1e-9):
            raise ParameterError(f'speeds: they end at {end:g} rad/s, before speed_max, {top:g}')
        apart = float(made.thrust(top)) / (k_f * top**2)
        if not 1.0 / APART_MAX <= apart <= APART_MAX:
            raise ParameterError(
                f'polynomial, thrusts: {float(made.thrust(top)):g} N at speed_max, but '
                f'thrust_coefficient gives {k_f * top**2:g} N: expected the same unit'
            )
        if settings.throttles == 0.0:
            return made
        w, t = points(settings.speeds, 'throttles', settings.throttles)
        return replace(made, throttle_speeds=constant(w), throttles=constant(t))

    @cached_property
    def square(self) -> bool:
        """Whether the thrust is k_f w^2."""
        return not len(self.starts)

    def thrust(self, speeds: ArrayLike) -> Array:
        """Return the thrusts (...) [N] at speeds (...), not negative [rad/s]."""
        w = np.asarray(speeds, dtype=float)
        if self.square:
            return np.asarray(self.coefficient * np.square(w))
        a, b, c = self.segments.T[:, np.searchsorted(self.starts, w, 'right') - 1]
        return np.asarray((a * w + b) * w + c)

    @property
    def rows(self) -> Array:
        """Start [rad/s], a, b and c of each segment (K, 4), also of ``k_f w^2``."""
        if self.square:
            return np.array([[0.0, self.coefficient, 0.0, 0.0]])
        return np.column_stack([self.starts, self.segments])

    def speed(self, thrusts: ArrayLike) -> Array:
        """Return the speeds (...) [rad/s] of thrusts (...), not negative [N]."""
        f = np.asarray(thrusts, dtype=float)
        if self.square:
            return np.asarray(np.sqrt(f / self.coefficient))
        a, b, c = self.segments.T[:, np.searchsorted(self.levels, f, 'right') - 1]
        return np.asarray(root(a, b, f - c))

    def inverse(self, ratio: Array) -> Array:
        """Return the speeds (...) [rad/s] of thrusts over k_f (...), not negative [rad^2/s^2]."""
        return np.sqrt(ratio) if self.square else self.speed(self.coefficient * ratio)

    @property
    def levels(self) -> Array:
        """The thrusts (K,) at which the segments begin [N]."""
        return self.thrust(self.starts)

    def throttle(self, speeds: ArrayLike, full: ArrayLike) -> Array:
        """Return the throttles (...) of speeds (...) [rad/s], negative backwards.

        `full` (...): the speed of full throttle [rad/s], where no throttles were measured.
        """
        w = np.abs(np.asarray(speeds, dtype=float))
        if len(self.throttles):
            found = np.interp(w, self.throttle_speeds, self.throttles)
        else:
            share = np.minimum(self.thrust(w) / self.thrust(full), 1.0)
            found = root(np.full(1, self.expo), np.full(1, 1.0 - self.expo), share)
        return np.asarray(np.copysign(found, speeds))

    def pulse(self, throttles: ArrayLike, reverses: ArrayLike = False) -> Array:
        """Return the pulse widths (...) [us] of throttles (...).

        Rotors that reverse have the middle of the range at rest.
        """
        low, high = self.pwm
        share = np.where(reverses, 0.5 + np.multiply(0.5, throttles), throttles)
        return np.asarray(low + (high - low) * share)


def rotor_speeds(
    thrusts: Array, forwards: Array, backwards: Array, low: Array, high: Array,
    inverse: Callable[[Array], Array] = np.sqrt,
) -> Array:
    """Return the speeds (..., n) for thrusts (..., n) [N], clipped to their bounds, Eq. (11).

    Quotient, square root and comparisons give the same bits in C, in the precision of the arrays.

    - `forwards` and `backwards` (n,): k_f of rotors that turn so, positive [kg m]
    - `low` and `high` (n,): bounds of the speeds [rad/s]
    - `inverse`: from thrust over k_f to speed, of rotors that turn forwards
    """
    backward = thrusts < 0.0
    ratio = np.abs(thrusts) / np.where(backward, backwards, forwards)
    speeds = np.where(backward, -np.sqrt(ratio), inverse(ratio))
    return np.minimum(np.maximum(speeds, low), high)


def root(a: Array, b: Array, f: Array) -> Array:
    """Return the greater w with ``a w^2 + b w = f``, without cancellation; a may be 0."""
    s = np.sqrt(np.maximum(b * b + 4.0 * a * f, 0.0))
    forwards = b >= 0.0
    top = np.where(forwards, 2.0 * f, s - b)
    bottom = np.where(forwards, b + s, 2.0 * a)
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom != 0.0)


def to_thrust(throttle: ArrayLike, expo: float) -> Array:
    """Return the shares of the greatest thrust at throttles, both in [0, 1]: PX4's THR_MDL_FAC."""
    x = np.asarray(throttle, dtype=float)
    return np.asarray((expo * x + (1.0 - expo)) * x)


def points(speeds: ArrayLike, name: str, values: ArrayLike) -> tuple[Array, Array]:
    """Return speeds and values as arrays (k,), from rest on: from (0, 0) if neither is 0.

    Raises a ParameterError if they do not increase, or there is not one value for each speed.
    """
    found = []
    for what, numbers in (('speeds', speeds), (name, values)):
        array = np.asarray(numbers, dtype=float)
        sound = np.isfinite(array).all() and (np.diff(array) > 0.0).all()
        if array.ndim != 1 or len(array) < 2 or array[0] < 0.0 or not sound:
            raise ParameterError(
                f'{what}: expected two or more numbers from 0 on that increase, got '
                f'{array.tolist()}'
            )
        found.append(array)
    w, v = found
    if len(w) != len(v):
        raise ParameterError(f'{name}: {len(v)} for {len(w)} speeds: expected one for each')
    if w[0] > 0.0 and v[0] > 0.0:
        return np.insert(w, 0, 0.0), np.insert(v, 0, 0.0)
    return w, v
