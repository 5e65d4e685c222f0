"""The bounds of what is commanded of the motors and the servos of a vehicle."""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.validation import ABSURD
from ca_ros.vehicle.vehicle import Vehicle

ROUNDING = 1e-9
"""Other programs may exceed a bound by a rounding error: relative, of angles in rad."""


class CommandBounds:
    """Checks commands of a vehicle: rotor speeds (n,) and then servo angles (k,) [rad/s, rad].

    Rotors may stop, whatever their least speed.  A servo that sticks may be commanded.  The
    speeds are those with a full battery.

    `rounding`: how far a command may exceed a bound; relative, of angles in rad.

    - `least` and `greatest` (n,): speeds of the motors [rad/s]
    - `servos`: all of them, as if none stuck
    """

    def __init__(self, vehicle: Vehicle, rounding: float = ROUNDING) -> None:
        least, greatest = vehicle.rated_speeds
        self._n, self.servos = vehicle.n, vehicle.servos.sound
        self.least, self.greatest = np.minimum(least, 0.0), greatest
        least, greatest = self.servos.limits
        lower = np.concatenate([self.least, least])
        upper = np.concatenate([self.greatest, greatest])
        low = np.concatenate([self.least * (1.0 + rounding), least - rounding])
        high = np.concatenate([self.greatest * (1.0 + rounding), greatest + rounding])
        self._what, self._expected = 'rotor speeds', f'{self._n}'
        if len(self.servos):
            self._what = 'rotor speeds and tilt angles'
            self._expected += f' and {len(least)}'
        self._low, self._high = low, high
        # Lists are compared faster than short arrays.
        self._lower, self._upper = lower.tolist(), upper.tolist()

    def fault(self, *parts: Sequence[float] | Array) -> tuple[str, str] | None:
        """Return why speeds, and angles, are no command: a key and a text; None if they are."""
        numbers, what = np.concatenate(parts), self._what
        if len(parts[0]) != self._n or numbers.shape != self._low.shape:
            given = ' and '.join(str(len(part)) for part in parts)
            return 'length', f'{given} {what}: expected {self._expected}'
        # False for what is not a number, too.
        if ((self._low <= numbers) & (numbers <= self._high)).all():
            return None
        if not np.isfinite(numbers).all():
            return 'numbers', f'{what} {numbers}: expected finite numbers'
        if not (numbers >= self._low).all():
            return 'sign', f'{what} {numbers}: expected at least {self._low} rad/s'
        return 'bounds', f'{what} {numbers}: expected up to {self._high} rad/s'

    def fault_of_measured(self, speeds: Array) -> str | None:
        """Return why numbers are no measured speeds of the motors; None if they are.

        Measurements exceed what is commanded by some noise, but not twice; some have no sign.
        """
        most = 2.0 * np.maximum(-self.least, self.greatest)
        if speeds.shape == most.shape and (abs(speeds) <= most).all():
            return None
        return f'measured rotor speeds {speeds}: expected {self._n} of up to {most} rad/s'

    def followed(self, command: Array) -> Array:
        """Return what motors and servos follow of a command (n + k,): the nearest within bounds.

        Raises a ValueError if it has another shape, or a number is not finite or above 1e100.
        """
        numbers = np.asarray(command, dtype=float)
        if numbers.shape == self._low.shape:
            bounds = zip(self._lower, numbers.tolist(), self._upper, strict=True)
            if all(low <= x <= high for low, x, high in bounds):
                return numbers
        if numbers.shape != self._low.shape or not (abs(numbers) <= ABSURD).all():
            raise ValueError(f'command {command}: expected {len(self._low)} numbers up to 1e100')
        speeds = np.minimum(np.maximum(numbers[: self._n], self.least), self.greatest)
        return np.concatenate([speeds, self.servos.within(numbers[self._n :])])
