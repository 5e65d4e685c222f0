"""Times of calls, so taken that what else the machine does hits all alike.

Contenders take turns: each allocates up to `TURN` wrenches at a stretch, then the next one, in an
order that is shuffled for each turn.  When all have been through all wrenches, a repetition is
complete; ratios are computed within it, and only then the median over repetitions is taken.
"""

from __future__ import annotations

import gc
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter, perf_counter_ns
from typing import Any

import numpy as np

from ca_ros.arrays import Array

TURN = 250
"""Calls at a stretch."""


@dataclass(frozen=True, eq=False)
class Track:
    """A contender and the wrenches that it allocates.

    Attributes
    ----------
    call : callable
        From a wrench (m,) to an answer; this is what is timed.
    wrenches : (W, m) array
        [N, N m]; as many for all contenders of a measurement.
    thrusts : callable
        From an answer to thrusts (n,), or None if there are none; this is not timed.
    """

    call: Callable[[Array], Any]
    wrenches: Array
    thrusts: Callable[[Any], Any]


@dataclass(eq=False)
class Times:
    """Times of one contender, an entry for each repetition; NaN if it took no part in it.

    Attributes
    ----------
    means : list of float
        Time of all calls over their number [s].
    p99s : list of float
        99th percentile of the times of the calls, taken one by one [s].
    """

    means: list[float] = field(default_factory=list)
    p99s: list[float] = field(default_factory=list)


def measure(
    tracks: Mapping[str, Track],
    repetitions: int,
    least: int,
    budget: float,
    seed: int,
    check: Callable[[str, list[Any]], None],
    progress: Callable[[], Any] = lambda: None,
) -> dict[str, Times]:
    """Time contenders against each other.

    Parameters
    ----------
    tracks : mapping of str to Track
    repetitions : int
    least : int
        A contender too slow for all repetitions takes part in at least so many.
    budget : float
        Time that a contender may take in all [s].
    seed : int
        Of the order.
    check : callable
        Takes name and answers, thrusts (n,) or None for each wrench, of every repetition.
    progress : callable
        Called after each repetition.
    """
    rows = {name: list(track.wrenches) for name, track in tracks.items()}
    chance, times = random.Random(seed), {name: Times() for name in tracks}
    with without_garbage_collection():
        counts = {}
        for name, track in tracks.items():
            # Not measured: what only the first calls do, such as to learn, is not timed.
            first, answers = _one_by_one(track, rows[name])
            check(name, answers)
            wanted = 1e9 * budget / (2.0 * float(np.median(first)) * len(first))
            counts[name] = int(min(max(wanted, least), repetitions))
        for repetition in range(repetitions):
            part = [name for name in tracks if _takes_part(repetition, counts[name], repetitions)]
            spent: dict[str, int] = dict.fromkeys(part, 0)
            single: dict[str, list[int]] = {name: [] for name in part}
            given: dict[str, list[Any]] = {name: [] for name in part}
            for name, before, turn in _turns(part, rows, chance):
                spent[name] += _together(tracks[name].call, before, turn)
            for name, before, turn in _turns(part, rows, chance):
                tracks[name].call(before)
                one_by_one, answers = _one_by_one(tracks[name], turn)
                single[name] += one_by_one
                given[name] += answers
            for name, own in times.items():
                there = name in spent
                own.means.append(spent[name] / 1e9 / len(rows[name]) if there else np.nan)
                own.p99s.append(float(np.percentile(single[name], 99)) / 1e9 if there else np.nan)
            for name in part:
                check(name, given[name])
            progress()
    return times


def _takes_part(repetition: int, count: int, repetitions: int) -> bool:
    """Tell whether this is one of `count` repetitions, evenly spread from the first on."""
    return repetition * count // repetitions != (repetition - 1) * count // repetitions


def _turns(
    names: Sequence[str], rows: Mapping[str, list[Array]], chance: random.Random
) -> Iterator[tuple[str, Array, list[Array]]]:
    """Yield name, the wrench before and the wrenches of each turn."""
    size = len(rows[names[0]]) if names else 0
    for start in range(0, size, TURN):
        for name in chance.sample(names, len(names)):
            yield name, rows[name][start - 1], rows[name][start : start + TURN]


def _together(call: Callable[[Array], Any], before: Array, rows: list[Array]) -> int:
    """Return how long the calls of a turn take [ns]."""
    # The first call finds the caches full of what others have left there.
    call(before)
    start = perf_counter_ns()
    for u in rows:
        call(u)
    return perf_counter_ns() - start


def _one_by_one(track: Track, rows: list[Array]) -> tuple[list[int], list[Any]]:
    """Return how long each call takes [ns], and the thrusts."""
    call, times, answers = track.call, [], []
    for u in rows:
        start = perf_counter_ns()
        answer = call(u)
        times.append(perf_counter_ns() - start)
        answers.append(_copy(track.thrusts(answer)))
    return times, answers


def _copy(thrusts: Any) -> Any:
    """Return thrusts that do not change when the solver goes on."""
    return None if thrusts is None else np.array(thrusts, dtype=float)


def rounds(
    jobs: Mapping[str, Callable[[], Any]],
    repetitions: int,
    seed: int,
    progress: Callable[[], Any] = lambda: None,
) -> dict[str, list[float]]:
    """Return how long each job takes in each repetition [s]; their order is shuffled in each."""
    chance = random.Random(seed)
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repetitions):
        for name in chance.sample(list(jobs), len(jobs)):
            with without_garbage_collection():
                start = perf_counter()
                jobs[name]()
                times[name].append(perf_counter() - start)
        progress()
    return times


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Collect garbage now, and not while something is timed."""
    gc.collect()
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def ratios(values: Sequence[float], others: Sequence[float]) -> list[float]:
    """Return the ratios of the repetitions in which both took part."""
    found = np.asarray(values) / np.asarray(others)
    return [float(ratio) for ratio in found[np.isfinite(found)]]


def spread(values: Sequence[float]) -> dict[str, float]:
    """Return the median and the ends of the middle half of values that are not NaN."""
    known = np.asarray(values)[np.isfinite(values)]
    low, median, high = (float(x) for x in np.percentile(known, (25, 50, 75)))
    return {'median': median, 'low': low, 'high': high}
