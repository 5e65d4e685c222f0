"""How much a benchmark measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

WORDS = {
    'wrenches': 'wrenches of each load but the flight',
    'flight': 'wrenches of the flight',
    'repetitions': 'repetitions',
    'least': 'repetitions at least of a slow contender',
    'budget': 'seconds for a slow contender on a load',
    'rotors': 'numbers of rotors',
    'batches': 'batches of each size in a repetition',
    'looped': 'wrenches of the loop beside the batches',
    'rounds': 'repetitions of batches and flights',
    'duration': 'seconds of the closed loop',
}
"""What the fields of a plan are."""


@dataclass(frozen=True)
class Plan:
    """The sizes of all parts; see `WORDS`."""

    wrenches: int
    flight: int
    repetitions: int
    least: int
    budget: float
    batches: Mapping[int, int]
    looped: int
    rounds: int
    rotors: tuple[int, ...] = field(default=(4, 6, 8, 12, 16, 24, 32))
    duration: float = 10.0


FULL = Plan(
    wrenches=1000,
    flight=1000,
    repetitions=41,
    least=5,
    budget=5.0,
    batches={10_000: 100, 100_000: 10, 1_000_000: 1},
    looped=100_000,
    rounds=11,
)

QUICK = Plan(
    wrenches=100,
    flight=1000,
    repetitions=31,
    least=2,
    budget=0.1,
    batches={10_000: 5, 100_000: 1, 1_000_000: 1},
    looped=5_000,
    rounds=3,
)
"""Everything, with less of each but the flight: a shorter one would be another one."""
