"""The motors of a vehicle with their propellers: the thrust of each speed, and the bounds."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, BoolArray, constant
from ca_ros.settings import ParameterError
from ca_ros.vehicle.fields import VOLTAGES
from ca_ros.vehicle.thrust_curve import ThrustCurve, rotor_speeds

HEALTH_MIN = 1e-9  # a rotor whose health is below this counts as lost

SQUARE = ThrustCurve()  # k_f w^2, with throttles that are shares of the thrust
BOUND_ROUNDING = 1e-9  # how far a thrust may be out, over its bound or 1 N

Part = TypeVar('Part', bound='Motors')


@dataclass(frozen=True, eq=False, init=False, repr=False, kw_only=True)
class Motors:
    """What `Vehicle` has of its n motors and propellers, wherever they are; see its attributes."""

    thrust_coefficient: Array
    thrust_coefficient_reverse: Array
    speed_min: Array
    speed_max: Array
    health: Array
    curve: ThrustCurve = SQUARE
    speed_max_per_volt: Array | float = 0.0
    nominal_voltage: float = 0.0
    voltage: float | None = None
    rated: tuple[Array, Array] | None = None
    acceleration_max: Array | None = None
    deceleration_max: Array | None = None

    @property
    def n(self) -> int:
        """Number of rotors."""
        return len(self.health)

    @property
    def lost(self) -> BoolArray:
        """Which rotors are lost, (n,)."""
        return self.health < HEALTH_MIN

    @cached_property
    def thrust_per_squared_speed(self) -> Array:
        """k_f times health, (n,) [kg m]; zero for a lost rotor."""
        return constant(np.where(self.lost, 0.0, self.health * self.thrust_coefficient))

    @cached_property
    def reverse_thrust_per_squared_speed(self) -> Array:
        """As `thrust_per_squared_speed`, of rotors that turn backwards."""
        return constant(np.where(self.lost, 0.0, self.health * self.thrust_coefficient_reverse))

    @property
    def powerless(self) -> bool:
        """Whether all rotors are lost."""
        return not (self.thrust_min.any() or self.thrust_max.any())

    @cached_property
    def thrust_min(self) -> Array:
        """f_min of Eq. (10), (n,) [N]; zero for a lost rotor, negative for one that reverses."""
        return constant(self.thrusts(self.speed_min))

    @cached_property
    def thrust_max(self) -> Array:
        """f_max of Eq. (10), (n,) [N]; zero for a lost rotor."""
        return constant(self.thrusts(self.speed_max))

    def thrusts(self, speeds: ArrayLike) -> Array:
        """Return the thrusts (..., n) [N] at the given speeds (..., n) [rad/s], Eq. (1)."""
        speeds = np.asarray(speeds, dtype=float)
        if not self.curve.square:
            shares = self.thrust_per_squared_speed / self.curve.coefficient
            return shares * self.curve.thrust(np.maximum(speeds, 0.0))
        forwards = self.thrust_per_squared_speed * np.square(speeds)
        if not np.count_nonzero(speeds < 0.0):
            return forwards
        backwards = self.reverse_thrust_per_squared_speed * np.square(speeds)
        return np.where(speeds < 0.0, -backwards, forwards)

    def speeds(self, thrusts: ArrayLike) -> Array:
        """Return the speeds (..., n) [rad/s] for thrusts (..., n) [N] in bounds, Eq. (11).

        They are within `speed_limits` to the last bit: rounding errors beyond these are clipped.
        Raises a ValueError if there is not one thrust per rotor, or one is out of bounds by more
        than `BOUND_ROUNDING`.
        """
        thrusts = np.asarray(thrusts, float)
        if thrusts.ndim == 1 and len(thrusts) == len(self.health) and self.curve.square:
            # With cold caches, as between two commands, this takes half as long as NumPy.
            speeds = []
            for f, (k, reverse, least, greatest, low, high) in zip(
                thrusts.tolist(), self._rotors, strict=True
            ):
                if not least <= f <= greatest:
                    break
                speed = sqrt(f / k) if f > 0.0 else -sqrt(-f / reverse)
                speeds.append(low if speed < low else high if speed > high else speed)
            else:
                return np.array(speeds)
        k, reverse, least, greatest, low, high = np.array(self._rotors).T
        if thrusts.shape[-1:] != (self.n,):
            raise ValueError(f'thrusts: expected shape (..., {self.n}), got {thrusts.shape}')
        sound = (thrusts >= least) & (thrusts <= greatest)
        if not sound.all():
            *_, i = place = tuple(np.argwhere(~sound)[0])
            raise ValueError(
                f'thrusts: {thrusts[place]:g} N of rotor {i + 1}, expected '
                f'{self.thrust_min[i]:g} to {self.thrust_max[i]:g} N'
            )
        return rotor_speeds(thrusts, k, reverse, low, high, self.curve.inverse)

    def throttles(self, speeds: ArrayLike) -> Array:
        """Return the throttles (..., n) of speeds (..., n) [rad/s], from -1 (or 0) to 1."""
        full, measured = self.full_speeds, self.curve.throttle_speeds
        if full is not None and len(measured):
            speeds = np.asarray(speeds, dtype=float) * measured[-1] / full
        return self.curve.throttle(speeds, self.speed_max if full is None else full)

    @property
    def full_speeds(self) -> Array | None:
        """Speeds (n,) of full throttle at the battery's voltage [rad/s]; None if it is unknown."""
        if self.voltage is None or not np.all(self.speed_max_per_volt):
            return None
        return np.asarray(self.speed_max_per_volt * self.voltage)

    def pulses(self, speeds: ArrayLike) -> Array:
        """Return the pulse widths (..., n) [us] of speeds (..., n) [rad/s]."""
        return self.curve.pulse(self.throttles(speeds), self.speed_min < 0.0)

    @cached_property
    def speed_limits(self) -> tuple[Array, Array]:
        """Least and greatest rotor speeds (n,) [rad/s]; zero for a lost rotor."""
        turning = self.thrust_per_squared_speed > 0.0
        return constant(self.speed_min * turning), constant(self.speed_max * turning)

    @cached_property
    def idle_speeds(self) -> Array:
        """Speeds (n,) within the limits that are nearest to zero [rad/s]."""
        low, high = self.speed_limits
        return constant(np.minimum(np.maximum(0.0, low), high))

    @cached_property
    def _rotors(self) -> list[tuple[float, ...]]:
        """For each rotor: both k_f, and the bounds of thrust (with `BOUND_ROUNDING`) and speed."""
        factors = self.thrust_per_squared_speed, self.reverse_thrust_per_squared_speed
        rounding = BOUND_ROUNDING * np.maximum(1.0, self.thrust_max)
        columns = (
            *(np.where(k_f > 0.0, k_f, 1.0) for k_f in factors), self.thrust_min - rounding,
            self.thrust_max + rounding, *self.speed_limits,
        )
        return [tuple(row) for row in np.column_stack(columns).tolist()]

    def at_voltage(self: Part, voltage: float) -> Part:
        """Return the same vehicle with the greatest speeds that a battery of a voltage [V] allows.

        Raises a ParameterError if the voltage is not within `VOLTAGES` times the nominal one, or
        leaves no rotor speed between the bounds.
        """
        least, most = (share * self.nominal_voltage for share in VOLTAGES)
        if self.nominal_voltage and not least <= voltage <= most:
            raise ParameterError(
                f'battery: {voltage:g} V: expected {least:.4g} to {most:.4g} V, {VOLTAGES[0]} to '
                f'{VOLTAGES[1]} times rotors.battery_voltage (or speed_max / speed_max_per_volt)'
            )
        full = np.where(self.speed_max_per_volt, self.speed_max_per_volt * voltage, np.inf)
        rated = self.rated_speeds
        low, high = np.maximum(rated[0], -full), np.minimum(rated[1], full)
        if not (high > np.maximum(low, 0.0)).all():
            raise ParameterError(
                f'battery: {voltage:g} V turn a rotor with less than its least speed')
        return replace(self, speed_min=low, speed_max=high, voltage=voltage, rated=rated)

    @property
    def rated_speeds(self) -> tuple[Array, Array]:
        """The bounds (n,) of the speeds whatever the voltage is [rad/s]."""
        return self.rated or (self.speed_min, self.speed_max)
