"""Times of calls, interleaved, so that background load affects all contenders equally.

Contenders take turns: each allocates up to `TURN` wrenches at a stretch, then the next one, in an
order that is shuffled for each turn.  When all have been through all wrenches, a repetition is
complete; ratios are computed within it, and only then the median over repetitions is taken.
"""

from __future__ import annotations

import gc
import random
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter, perf_counter_ns
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.judge import AnswerError, Judge

TURN = 250
"""Calls at a stretch."""


@dataclass(frozen=True, eq=False)
class Track:
    """A contender and the wrenches that it allocates.

    Attributes
    ----------
    call : callable
        From a wrench (m,) to an answer; this is what is timed.
    thrusts : callable
        From an answer to thrusts (n,), or None if there are none; this is not timed.
    judge : Judge
        Has the wrenches, as many for all contenders of a measurement.
    """

    call: Callable[[Array], Any]
    thrusts: Callable[[Any], Any]
    judge: Judge


def measure(
    tracks: Mapping[tuple[str, int], Track],
    plan: Plan,
    seed: int,
    what: str = 'calls',
) -> pd.DataFrame:
    """Time contenders against each other.

    Parameters
    ----------
    tracks : mapping of (str, int) to Track
    plan : Plan
    seed : int
        Of the order.
    what : str
        Shown beside the progress.

    Returns
    -------
    DataFrame
        A row a contender and repetition in which it took part: ``contender``, ``rotors``,
        ``repetition`` (-1: before the measurement, not timed), ``mean`` and ``p99`` of the time of
        a call [s], and what `Judge.worst` says of the answers.
    """
    rows = {key: list(track.judge.demands) for key, track in tracks.items()}
    chance, found = random.Random(seed), []

    def note(
        key: tuple[str, int], repetition: int, mean: float, p99: float, answers: list[Any]
    ) -> None:
        try:
            worst = tracks[key].judge.worst(answers)
        except AnswerError as error:
            raise AnswerError(f'{key[0]}: {error}') from None
        labels: dict[str, Any] = {'contender': key[0], 'rotors': key[1]}
        found.append({**labels, 'repetition': repetition, 'mean': mean, 'p99': p99, **worst})

    with without_garbage_collection():
        counts = {}
        for key, track in tracks.items():
            # Not timed: the first calls fill caches.
            first, answers = _one_by_one(track, rows[key])
            note(key, -1, np.nan, np.nan, answers)
            wanted = 1e9 * plan.budget / (2.0 * float(np.median(first)) * len(first))
            counts[key] = int(min(max(wanted, plan.least), plan.repetitions))
        for repetition in _progress(plan.repetitions, what):
            part = [key for key in tracks if takes_part(repetition, counts[key], plan.repetitions)]
            spent: dict[tuple[str, int], int] = dict.fromkeys(part, 0)
            single: dict[tuple[str, int], list[int]] = {key: [] for key in part}
            given: dict[tuple[str, int], list[Any]] = {key: [] for key in part}
            for key, before, turn in _turns(part, rows, chance):
                spent[key] += _together(tracks[key].call, before, turn)
            for key, before, turn in _turns(part, rows, chance):
                tracks[key].call(before)
                one_by_one, answers = _one_by_one(tracks[key], turn)
                single[key] += one_by_one
                given[key] += answers
            for key in part:
                mean = spent[key] / 1e9 / len(rows[key])
                p99 = float(np.percentile(single[key], 99)) / 1e9
                note(key, repetition, mean, p99, given[key])
    return pd.DataFrame(found)


def takes_part(repetition: int, count: int, repetitions: int) -> bool:
    """Tell whether this is one of `count` repetitions, evenly spread from the first on."""
    return repetition * count // repetitions != (repetition - 1) * count // repetitions


def _turns(
    keys: Sequence[tuple[str, int]],
    rows: Mapping[tuple[str, int], list[Array]],
    chance: random.Random,
) -> Iterator[tuple[tuple[str, int], Array, list[Array]]]:
    """Yield contender, the wrench before and the wrenches of each turn."""
    size = len(rows[keys[0]]) if keys else 0
    for start in range(0, size, TURN):
        for key in chance.sample(keys, len(keys)):
            yield key, rows[key][start - 1], rows[key][start : start + TURN]


def _together(call: Callable[[Array], Any], before: Array, rows: list[Array]) -> int:
    """Return how long the calls of a turn take [ns]."""
    # The first call finds the caches full of the data of other contenders.
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
        thrusts = track.thrusts(answer)
        # A copy: the solver may reuse its memory.
        answers.append(None if thrusts is None else np.array(thrusts, dtype=float))
    return times, answers


def rounds(
    jobs: Mapping[str, Callable[[], Any]],
    repetitions: int,
    seed: int,
    what: str,
) -> pd.DataFrame:
    """Return the time of each job [s], a column a job, a row a repetition, shuffled in each."""
    chance, times = random.Random(seed), pd.DataFrame(columns=list(jobs), dtype=float)
    for repetition in _progress(repetitions, what):
        for name in chance.sample(list(jobs), len(jobs)):
            with without_garbage_collection():
                start = perf_counter()
                jobs[name]()
                times.loc[repetition, name] = perf_counter() - start
    return times


def _progress(repetitions: int, what: str) -> Iterable[int]:
    """Count repetitions; show their progress on a terminal."""
    return tqdm(range(repetitions), desc=what, disable=not sys.stderr.isatty())


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


def spread(values: Any) -> dict[str, float]:
    """Return the median and the ends of the middle half of values that are not NaN."""
    low, median, high = np.nanpercentile(values, (25, 50, 75)).tolist()
    return {'median': median, 'low': low, 'high': high}
