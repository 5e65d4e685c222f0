"""The watchdog for commands, and the rotor speeds of the timeout actions."""

from time import monotonic

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.vehicle import Vehicle

TICK = 0.02  # period of the check of watchdogs and of the timeout action [s]


class Watchdog:
    """Expires when commands cease, by the steady clock, since ROS time may pause or jump.

    The watchdog is asleep until the first command, because the rotors rest until then.  `timeout`
    is the longest time without a command [s], `expired` tells whether it had passed at the last
    look, and `begun` whether that was the first look after it.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        self.timeout = timeout
        self.expired = self.begun = False
        self._last: float | None = None
        self._over = False

    @property
    def awake(self) -> bool:
        """Whether there has been a command."""
        return self._last is not None

    @property
    def over(self) -> bool:
        """Whether the timeout has passed; after `look` has seen this, only a command resets it."""
        return self._over or (self._last is not None and monotonic() > self._last + self.timeout)

    def feed(self) -> None:
        """Note a command."""
        self._last, self._over = monotonic(), False

    def look(self) -> bool:
        """Return whether the timeout has passed, and remember it."""
        before, self._over = self._over, self.over
        self.expired, self.begun = self._over, self._over and not before
        return self.expired


def fallback(action: str, vehicle: Vehicle, last: Array) -> Array:
    """Return rotor speeds (n,) [rad/s]: idle, the nearest to zero; stop, zero; hold, the last.

    Tilt angles, which follow the speeds in `last`, stay.
    """
    if action == 'hold':
        return last
    speeds = vehicle.idle_speeds if action == 'idle' else np.zeros(vehicle.n)
    return np.concatenate([speeds, last[vehicle.n :]])
