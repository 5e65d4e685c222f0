"""The servos of rotors that tilt: axes, limits, and the directions of the thrusts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, BoolArray, constant
from ca_ros.settings import ParameterError
from ca_ros.vehicle.settings import RotorSettings
from ca_ros.vehicle.validation import repeated

FIXED = 1e-9  # range of a tilt angle below which a rotor is fixed [rad]

ROUNDING = 1e-6  # how far limits may be off half a circle or a circle [rad]

NO_ANGLES = constant(np.zeros(0))  # of a vehicle without servos


@dataclass(frozen=True, eq=False)
class Servos:
    """The servos of a vehicle's rotors; most vehicles have none.  `len` is their number k.

    A rotor's thrust has the direction ``R(t, alpha) R(s, beta) d``: d is its direction in
    `rotors.axes`, t its tilt axis, normal to d, and s = d x t.  Most rotors have alpha alone.  A
    rotor on a gimbal has both angles, which keep its thrust in a cone about d.

    - `axes` (n, 3): t, unit vectors; zero for a rotor without a servo
    - `lower` and `upper` (n,): limits of alpha [rad]; a range of a circle is an azimuth thruster,
      which turns on beyond them: its angle then is a circle less, or more
    - `gimbal` (n,): half angle of the cone of a rotor on a gimbal, or zero [rad]
    - `nominal` (n, 3): d
    - `driven` (n,): which rotors have servos, also if they are stuck
    - `rate_max` (n,): greatest rates that are commanded [rad/s]; 0: no limit
    - `unstuck`: the servos before the first one stuck, or None

    Without servos, angles are empty arrays.
    """

    axes: Array
    lower: Array
    upper: Array
    gimbal: Array
    nominal: Array
    driven: BoolArray
    rate_max: Array
    unstuck: Servos | None = None

    @classmethod
    def none(cls, directions: Array) -> Servos:
        """Return the servos of rotors that are fixed in directions (n, 3): there are none."""
        n = len(directions)
        zeros, axes = np.zeros(n), np.zeros((n, 3))
        return cls(axes, zeros, zeros, zeros, directions, np.zeros(n, bool), zeros)

    def __len__(self) -> int:
        return len(self.rotors)

    @property
    def sound(self) -> Servos:
        """The same servos, none of them stuck."""
        return self.unstuck or self

    @property
    def stuck_rotors(self) -> list[int]:
        """The rotors, from 0, whose servos stick."""
        whole = self.sound
        apart = (self.lower != whole.lower) | (self.upper != whole.upper)
        return np.flatnonzero(apart).tolist()

    @property
    def resting(self) -> Array:
        """The angle of each servo that is nearest to zero [rad]."""
        low, high = self.limits
        return np.minimum(np.maximum(0.0, low), high)

    @cached_property
    def rotors(self) -> list[int]:
        """The rotor of each servo; a gimbal has two, alpha before beta."""
        driven = np.flatnonzero(self.driven).tolist()
        return [i for i in driven for _ in range(1 + (self.gimbal[i] > 0))]

    @cached_property
    def planar(self) -> list[int]:
        """The rotors with a single servo, not on a gimbal."""
        return np.flatnonzero(self.driven & (self.gimbal == 0.0)).tolist()

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """Least and greatest angle of each servo [rad]."""
        rotors = self.rotors
        cone = self.gimbal[rotors] > 0.0
        return (
            constant(np.where(cone, -self.gimbal[rotors], self.lower[rotors])),
            constant(np.where(cone, self.gimbal[rotors], self.upper[rotors])),
        )

    @cached_property
    def middles(self) -> tuple[Array, Array]:
        """Directions (n, 3) in the middles of the tilt ranges, and a quarter turn further."""
        return self.turned((self.lower + self.upper) / 2.0)

    @cached_property
    def endless(self) -> BoolArray:
        """Whether each servo (k,) turns an azimuth thruster."""
        return (self.upper - self.lower)[self.rotors] > 2.0 * pi - ROUNDING

    def within(self, angles: Array) -> Array:
        """Return angles (k,) within the limits: the same direction for those without end."""
        if not self.rotors:
            return angles
        low, high = self.limits
        if self.endless.any():
            whole = 2.0 * pi * self.endless
            angles = np.where(angles < low, angles + whole, angles)
            angles = np.where(angles > high, angles - whole, angles)
        return np.minimum(np.maximum(angles, low), high)

    def turned(self, angles: Array) -> tuple[Array, Array]:
        """Return directions (n, 3) for alphas (n,), and those a quarter turn further (n, 3)."""
        side = np.cross(self.axes, self.nominal)
        cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
        return cosine * self.nominal + sine * side, cosine * side - sine * self.nominal

    def directions(self, angles: Array) -> Array:
        """Return the directions (n, 3) of the thrusts for servo angles (k,) [rad]."""
        if not self.rotors:
            return self.nominal
        alphas, betas = self.lower.copy(), np.zeros(len(self.lower))
        for rotor, angle, second in zip(self.rotors, angles, self._second, strict=True):
            (betas if second else alphas)[rotor] = angle
        cosine, sine = np.cos(betas)[:, None], np.sin(betas)[:, None]
        return cosine * self.turned(alphas)[0] + sine * self.axes

    def angles(self, forces: Callable[[], Array], present: Array | None = None) -> Array:
        """Return servo angles (k,) within their limits that point rotors along forces (n, 3).

        The forces are computed only if there are servos.  A direction out of reach is replaced by
        the nearest limit.  Of equivalent angles, that which is nearest to `present` (k,) counts,
        by default to the middle of the range.
        """
        if not self.rotors:
            return NO_ANGLES
        owners, frames, middle = self._frames
        if present is not None:
            middle = present
        along, side, across = np.einsum('kj,akj->ak', forces().take(owners, 0), frames)
        found = middle + (np.arctan2(side, along) - middle + pi) % (2.0 * pi) - pi
        if len(found) > len(self.planar):
            betas = np.arctan2(across, np.hypot(along, side))
            found = np.where(self._second, betas, found)
        return self.within(found)

    def command(self, speeds: Array, angles: Callable[[], Array]) -> Array:
        """Return speeds (..., n) with the angles behind them (..., n + k), if there are any."""
        return np.concatenate([speeds, angles()], axis=-1) if self.rotors else speeds

    def stuck(self, rotor: int, angle: float) -> Servos:
        """Return the servos with that of a rotor (from 0) stuck at an angle [rad].

        Raises a ParameterError if the rotor has no servo, or is on a gimbal, or the angle is
        beyond its limits.
        """
        if not self.rotors:
            raise ParameterError('rotor: no rotor of this vehicle tilts')
        if not 0 <= rotor < len(self.driven) or not self.driven[rotor] or self.gimbal[rotor]:
            raise ParameterError(f'rotor: {rotor + 1} has no single servo that may stick')
        low, high = float(self.sound.lower[rotor]), float(self.sound.upper[rotor])
        if not low <= angle <= high:
            raise ParameterError(f'angle: expected {low:g} to {high:g} rad, got {angle:g}')
        held = np.arange(len(self.driven)) == rotor
        lower, upper = (np.where(held, angle, ends) for ends in (self.lower, self.upper))
        return replace(self, lower=lower, upper=upper, unstuck=self.sound)

    def refuse(self, taker: str) -> None:
        """Raise a `ParameterError` if there are servos, which the `taker` cannot command."""
        if self.rotors:
            raise ParameterError(
                f'rotors.tilt_max, rotors.gimbal: the {taker} takes fixed rotors only; expected '
                'none that tilts'
            )

    @cached_property
    def _second(self) -> BoolArray:
        return np.diff(self.rotors, prepend=-1) == 0

    @cached_property
    def _frames(self) -> tuple[NDArray[np.intp], Array, Array]:
        """The rotor (k,) of each servo, its d, s and t (3, k, 3), and the middles of ranges."""
        owners = np.array(self.rotors, np.intp)
        frames = np.array([self.nominal, np.cross(self.axes, self.nominal), self.axes])
        return owners, frames[:, owners], np.sum(self.limits, axis=0) / 2.0


def servos_of(
    rotors: RotorSettings, nominal: Array, speed_min: Array, speed_max: Array
) -> Servos:
    """Return the servos of a vehicle's settings.

    If no rotor has one, the rotors still may be turned by tilts with a range of zero.

    Raises a ParameterError if a setting has a wrong size, contradicts another one, or makes no
    convex set.
    """
    n = len(nominal)
    lower = repeated('rotors.tilt_min', rotors.tilt_min, n)
    upper = repeated('rotors.tilt_max', rotors.tilt_max, n)
    gimbal = repeated('rotors.gimbal', rotors.gimbal, n)
    rate_max = repeated('rotors.tilt_rate_max', rotors.tilt_rate_max, n)
    if not (lower.any() or upper.any() or gimbal.any()):
        if rate_max.any():
            raise ParameterError('rotors.tilt_rate_max: expected 0, since no rotor tilts')
        return Servos.none(nominal)
    given = np.asarray(rotors.tilt_axes, float)
    if given.size not in (3, 3 * n):
        raise ParameterError(
            f'rotors.tilt_axes: expected 3 or {3 * n} numbers for {n} rotors, got {given.size}'
        )
    axes = np.broadcast_to(given.reshape(-1, 3), (n, 3))
    lengths = np.linalg.norm(axes, axis=1)
    axes = axes / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    for i in range(n):
        limits = float(lower[i]), float(upper[i]), float(gimbal[i])
        _check_tilt(i, axes[i], nominal[i], *limits, float(speed_min[i]), float(speed_max[i]))
    driven = (gimbal > 0.0) | (upper - lower > FIXED)
    servos = Servos(axes, lower, upper, gimbal, np.array(nominal), driven, rate_max)
    return servos if driven.any() else Servos.none(servos.turned(lower)[0])


def _check_tilt(
    i: int, axis: Array, nominal: Array, lower: float, upper: float, gimbal: float,
    speed_min: float, speed_max: float,
) -> None:
    """Raise a ParameterError if what tilts rotor i is contradictory, or makes no convex set."""
    span, place = upper - lower, f'of rotor {i + 1}'
    if span < 0.0:
        raise ParameterError(
            f'rotors.tilt_min: {lower:g} rad {place} is above tilt_max, {upper:g} rad'
        )
    if span <= FIXED and not gimbal:
        if lower and not axis.any():
            raise ParameterError(f'rotors.tilt_axes: the axis {place} is zero, but it tilts')
        return
    if not axis.any() or abs(axis @ nominal) > ROUNDING:
        raise ParameterError(
            f'rotors.tilt_axes: expected an axis normal to rotors.axes {place}, got '
            f'{axis.tolist()}'
        )
    if gimbal and span > FIXED:
        raise ParameterError(
            f'rotors.gimbal: {gimbal:g} rad {place} beside tilt_min and tilt_max; expected '
            'one of them'
        )
    whole = -ROUNDING < span - 2.0 * pi < 1e-3
    if (span > pi + ROUNDING and not whole) or gimbal > pi / 2 + ROUNDING:
        raise ParameterError(
            f'rotors.tilt_max: {span or 2.0 * gimbal:g} rad from limit to limit {place}; '
            'expected up to half a circle, or a whole one: others are not convex'
        )
    if speed_min < 0.0 or (speed_min > 0.0 and span > pi + ROUNDING):
        raise ParameterError(
            f'rotors.speed_min: {speed_min:g} rad/s {place}, which tilts; expected at '
            'least 0, and 0 for a whole circle: other thrusts are not a convex set'
        )
    if speed_min == speed_max:
        raise ParameterError(
            f'rotors.speed_min: {speed_min:g} rad/s {place}, which tilts; expected less '
            'than its speed_max, which is the same'
        )
