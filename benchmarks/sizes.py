"""How much a benchmark measures."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Numbers of wrenches of each set and of the flight, repetitions, and so on.

    A contender that would take longer than `budget` [s] takes part in fewer repetitions, in at
    least `least`.  `batches` has the number of batches of each size, `looped` the wrenches of the
    loop beside them, `rounds` the repetitions of batches and set-ups, `blocks` the number of
    blocks of commands to a node at each rate, and their duration [s].
    """

    wrenches: int
    flight: int
    repetitions: int
    least: int
    budget: float
    batches: Mapping[int, int]
    looped: int
    rounds: int
    blocks: tuple[int, float]
    rotors: tuple[int, ...] = (4, 6, 8, 12, 16, 24, 32)


MANY = {10_000: 100, 100_000: 10, 1_000_000: 1}
FULL = Sizes(5000, 5000, 21, 5, 5.0, MANY, 100_000, 11, (20, 2.0))

FEW = {1_000: 20, 100_000: 1, 1_000_000: 1}
QUICK = Sizes(100, 1000, 31, 2, 0.1, FEW, 5_000, 3, (3, 0.3))
