"""What the rotors are told when commands cease."""

from __future__ import annotations

from time import monotonic

import numpy as np

from ca_ros.arrays import Array
from ca_ros.vehicle.vehicle import Vehicle

TICK = 0.02
"""How often watchdogs are looked at, and the timeout action is repeated [s]."""


class Watchdog:
    """Watches for commands that cease, by the steady clock: ROS time may stand still or jump.

    It sleeps until the first command: nothing has been started that would have to be stopped.

    Attributes
    ----------
    timeout : float
        Time without a command after which it is over [s].
    expired : bool
        Whether it was over when last looked at.
    begun : bool
        Whether that was so for the first time since the last command.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        self.timeout = timeout
        self.expired = self.begun = False
        self._last: float | None = None
        self._missed: float | None = None

    @property
    def awake(self) -> bool:
        """Whether there has been a command."""
        return self._last is not None

    @property
    def over(self) -> bool:
        """Whether the time is over; once it has been, only a command ends that."""
        if self._last is None:
            return False
        return self._missed == self._last or monotonic() - self._last > self.timeout

    def wake(self) -> None:
        """Take note that somebody commands, though it is nothing that can be served."""
        if not self.awake:
            self.feed()

    def feed(self) -> None:
        """Take note of a command."""
        self._last = monotonic()

    def look(self) -> bool:
        """Tell whether the time is over, and remember it."""
        # A command may have come and gone since the last look.
        anew = self._missed != self._last
        self.expired = self.over
        self.begun = self.expired and anew
        self._missed = self._last if self.expired else None
        return self.expired


def fallback(action: str, vehicle: Vehicle, last: Array) -> Array:
    """Return the rotor speeds (n,) [rad/s] of a timeout action.

    Parameters
    ----------
    action : 'idle', 'stop' or 'hold'
        The least speeds, rotors that stand still, or the speeds as they are.
    vehicle : Vehicle
    last : (n,) array
        The last speeds [rad/s].
    """
    if action == 'hold':
        return last
    return vehicle.speeds(vehicle.thrust_min) if action == 'idle' else np.zeros(vehicle.n)
