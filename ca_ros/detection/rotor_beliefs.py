"""What is believed of each rotor: what is announced, less what was found."""

from collections.abc import Iterable

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem.audit import audit
from ca_ros.vehicle.vehicle import Vehicle

USELESS = 0.2  # a rotor with less health is lost
IN_A_ROW = 3  # tests, or measured speeds, one after the other, that change what is believed
CERTAIN = 0.995  # least probability of a failure that was named
REFINED = 0.495  # time after a failure in which its health is estimated further [s]

TOLD = 0.995
"""Time after its name in which it may show which rotor of an arm has failed [s].  Later, what
this rotor lacks has been learnt as a mean disturbance, and points to the other one."""


def words_of(rotors: Iterable[int], arms: Iterable[tuple[int, int]]) -> dict[int, str]:
    """Return by rotor its name, such as '3', and for the first of an arm '1 or 2'.

    `rotors` and `arms`, of which one rotor has failed, are counted from 1.
    """
    others = dict(arms)
    return {
        rotor: f'{rotor} or {others[rotor]}' if rotor in others else str(rotor)
        for rotor in rotors if rotor not in others.values()}


class RotorBeliefs:
    """What is announced of each rotor, and what was found by motion or measured speeds.

    - `vehicle`: with the announced health
    - `delivered` (n,): share of its thrust that each rotor gives
    - `found` (n,): probability of each failure that was found, 0 for the others
    - `since`: when it was found [ns], or None
    - `order`: the number of its name, from 1, which rotors of one test share; 0: none
    - `evidence`: what it was found by
    - `angles`: by rotor, from 0, where its servo was found to stick [rad]
    - `arms`: the named arms, and for each how many tests in a row tell the same rotor of it:
      positive for the first, negative for the second
    - `refined`: time since each failure that was found [s]
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.reset()

    def reset(self) -> None:
        """Forget what was found."""
        n = self.vehicle.n
        self.delivered, self._stuck = np.array(self.vehicle.health), np.zeros(n, bool)
        self.angles: dict[int, float] = {}
        self.found: Array = np.zeros(n)
        self.since: list[int | None] = [None] * n
        self.order, self.evidence = [0] * n, [''] * n
        self.refined: dict[int, float] = {}
        self.arms: dict[tuple[int, int], int] = {}

    @property
    def health(self) -> Array:
        """The announced health, less what was found, (n,)."""
        return np.where(self._stuck, 0.0, self.delivered)

    @property
    def held(self) -> list[int]:
        """The rotors of named arms."""
        return [rotor for pair in self.arms for rotor in pair]

    def announce(self, vehicle: Vehicle) -> bool:
        """Take a vehicle with what is announced; return whether a health changes."""
        before, self.vehicle = self.delivered, vehicle
        unfound = [since is None for since in self.since]
        self.delivered = np.where(unfound, vehicle.health, np.minimum(before, vehicle.health))
        return not np.array_equal(self.delivered, before)

    @property
    def next_name(self) -> int:
        """The order of the next name."""
        return max(self.order) + 1

    def find(self, rotor: int, time: int, order: int, evidence: str) -> None:
        """Take note of a failure that was found at a time [ns]; see `next_name`."""
        self.since[rotor], self.order[rotor], self.evidence[rotor] = time, order, evidence

    def reduce(self, rotor: int, share: float) -> float:
        """Take a share of a rotor's health; return by how much it gets less."""
        before, whole = float(self.delivered[rotor]), float(self.vehicle.health[rotor])
        left = min(max(before - share, 0.0), whole)
        self.delivered[rotor] = left = 0.0 if left < USELESS * whole else left
        return before - left

    def lost(self, rotor: int) -> float:
        """Return what a rotor is taken to have lost of its announced health."""
        return float(self.vehicle.health[rotor] - self.delivered[rotor])

    def name_arm(self, first: int, second: int) -> None:
        """Let one of two rotors have failed, and which one be unknown."""
        self.arms[first, second] = 0

    @property
    def new_arms(self) -> list[tuple[int, int]]:
        """The named arms of which it may show which rotor has failed."""
        return [pair for pair in self.arms if self.refined[pair[0]] < TOLD]

    def lost_by_arms(self) -> Array:
        """Return what both rotors of each named arm are taken to have lost (m,)."""
        return np.array([self.lost(rotor) for rotor, _ in self.arms])

    def close_arms(self) -> None:
        """Let both rotors of each named arm that gives nothing have failed."""
        for pair in [pair for pair in self.arms if not self.delivered[list(pair)].any()]:
            del self.arms[pair]
            self.found[list(pair)] = CERTAIN

    def tell_arm(self, failed: int, sound: int) -> None:
        """Let one rotor of a named arm have failed."""
        del self.arms[min(failed, sound), max(failed, sound)]
        self.found[failed] = CERTAIN

    def give_back(self, rotor: int) -> None:
        """Let a rotor that was found to have failed be sound."""
        self.found[rotor], self.since[rotor] = 0.0, None
        self.order[rotor], self.evidence[rotor] = 0, ''
        self.refined.pop(rotor, None)

    def stick(self, rotor: int, angle: float) -> None:
        """Let a servo stick; its rotor is out of use, if the vehicle can do without it."""
        self.angles[rotor] = angle
        without = np.where(np.arange(self.vehicle.n) == rotor, 0.0, self.health)
        self._stuck[rotor] = audit(self.vehicle.with_health(without)).sound

    def age(self, step: float) -> None:
        """Let a further time go by [s]."""
        self.refined = {rotor: age + step for rotor, age in self.refined.items()}

    def failed(self, within: float) -> list[int]:
        """Return the rotors that were found to have failed within a time [s]."""
        return [rotor for rotor, age in self.refined.items() if age < within]
