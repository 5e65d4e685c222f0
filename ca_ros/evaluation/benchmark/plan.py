"""How much a benchmark measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """The sizes of all parts of a benchmark.

    Attributes
    ----------
    wrenches, flight : int
        Wrenches of the loads other than the flight, and of the flight.
    repetitions, least : int
        Repetitions, and the least number of them in which a slow contender takes part.
    budget : float
        Time of a slow contender on a load [s].
    batches : mapping of int to int
        Number of batches of each size in a repetition.
    looped : int
        Number of wrenches of the loop that batches are compared with.
    rounds : int
        Repetitions of batches and flights.
    rotors : tuple of int
    duration : float
        Duration of the closed loop [s].
    """

    wrenches: int
    flight: int
    repetitions: int
    least: int
    budget: float
    batches: Mapping[int, int]
    looped: int
    rounds: int
    rotors: tuple[int, ...] = (4, 6, 8, 12, 16, 24, 32)
    duration: float = 10.0


FULL = Plan(5000, 5000, 21, 5, 5.0, {10_000: 100, 100_000: 10, 1_000_000: 1}, 100_000, 11)

QUICK = Plan(100, 1000, 31, 2, 0.1, {1_000: 20, 100_000: 1, 1_000_000: 1}, 5_000, 3)
