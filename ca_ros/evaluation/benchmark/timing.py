"""Times of calls, interleaved, so that background load affects all contenders equally.

Contenders take turns: each allocates up to `TURN` wrenches, then the next one does, in an order
that is shuffled for each turn.  A repetition is complete when all have allocated all wrenches.
Ratios are computed within a repetition, and their median over the repetitions is taken.
"""

from __future__ import annotations

import gc
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from time import perf_counter, perf_counter_ns
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.c_contenders import Compiled
from ca_ros.evaluation.benchmark.peers import Call
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.judge import AnswerError, Judge

TURN = 250
"""Calls in a turn."""

PERCENTILES = {'p50': 50.0, 'p99': 99.0, 'p999': 99.9, 'worst': 100.0}
"""Percentiles of the times of single calls, by column."""


class Key(NamedTuple):
    """What a row of measurements is about; its fields are columns."""

    part: str
    load: str
    contender: str
    rotors: int


def measure(
    calls: Mapping[Key, Call], judges: Mapping[Key, Judge], plan: Plan, seed: int
) -> pd.DataFrame:
    """Time contenders against each other, in an order that the seed determines.

    The judges have the wrenches of the calls, as many for all.

    Returns one row per contender and repetition in which it took part: the fields of `Key`,
    ``repetition`` (-1 for the first pass, which is not timed), ``time`` (the mean of a call) and
    the `PERCENTILES` of single calls [s], and the errors of the answers from `Judge.worst`.
    """
    wrenches = {key: list(judges[key].demands) for key in calls}
    size = len(next(iter(wrenches.values())))
    chance, rows, counts = random.Random(seed), [], {}

    def note(key: Key, repetition: int, time: float, single: Any, answers: Iterable[Any]) -> None:
        try:
            worst = judges[key].worst(list(answers))
        except AnswerError as error:
            raise AnswerError(f'{key.contender}: {error}') from None
        values = np.percentile(single, list(PERCENTILES.values())) / 1e9
        measured = {'time': time, **dict(zip(PERCENTILES, values, strict=True))}
        rows.append({**key._asdict(), 'repetition': repetition, **measured, **worst})

    def in_turns(keys: Sequence[Key], work: Callable[[Call, list[Array]], Any]) -> Any:
        done: dict[Key, list[Any]] = {key: [] for key in keys}
        for start in range(0, size, TURN):
            for key in chance.sample(keys, len(keys)):
                # The caches hold the data of other contenders: one call before, not timed.
                calls[key](wrenches[key][start - 1])
                done[key].append(work(calls[key], wrenches[key][start : start + TURN]))
        return done

    with without_garbage_collection():
        for key, call in calls.items():
            # The first calls fill caches and are not timed.
            first, answers = _one_by_one(call, wrenches[key])
            note(key, -1, np.nan, np.nan, answers)
            wanted = 1e9 * plan.budget / (2.0 * float(np.median(first)) * size)
            counts[key] = int(min(max(wanted, plan.least), plan.repetitions))
        for repetition in _progress(plan.repetitions, calls):
            part = [key for key in calls if takes_part(repetition, counts[key], plan.repetitions)]
            spent, singly = in_turns(part, _together), in_turns(part, _one_by_one)
            for key in part:
                single, given = zip(*singly[key], strict=True)
                time = sum(spent[key]) / 1e9 / size
                note(key, repetition, time, np.concatenate(single), chain(*given))
    return pd.DataFrame(rows)


def takes_part(repetition: int, count: int, repetitions: int) -> bool:
    """Return whether this is one of `count` repetitions, evenly spread from the first on."""
    return repetition * count // repetitions != (repetition - 1) * count // repetitions


def _together(call: Call, wrenches: list[Array]) -> int:
    """Return the time of the calls of a turn [ns]."""
    if isinstance(call, Compiled):
        return call.together(wrenches)
    start = perf_counter_ns()
    for u in wrenches:
        call(u)
    return perf_counter_ns() - start


def _one_by_one(call: Call, wrenches: list[Array]) -> tuple[list[int], list[Any]]:
    """Return the time of each call [ns], and the thrusts."""
    if isinstance(call, Compiled):
        return call.one_by_one(wrenches)
    times, answers = [], []
    for u in wrenches:
        start = perf_counter_ns()
        answer = call(u)
        times.append(perf_counter_ns() - start)
        thrusts = getattr(answer, 'thrusts', answer)
        # A copy: the solver may reuse its memory.
        answers.append(None if thrusts is None else np.array(thrusts, dtype=float))
    return times, answers


def rounds(
    jobs: Mapping[Key, tuple[Callable[[], Any], float]], repetitions: int, seed: int
) -> pd.DataFrame:
    """Time jobs, each with the number of units in it, in a shuffled order.

    Returns one row per job and repetition: the fields of `Key`, ``repetition``, and the ``time``
    of a unit [s].
    """
    chance = random.Random(seed)
    times: dict[Key, list[float]] = {key: [] for key in jobs}
    for _ in _progress(repetitions, jobs):
        for key in chance.sample(list(jobs), len(jobs)):
            job, units = jobs[key]
            with without_garbage_collection():
                start = perf_counter()
                job()
                times[key].append((perf_counter() - start) / units)
    return pd.DataFrame(
        {**key._asdict(), 'repetition': i, 'time': time}
        for key, own in times.items()
        for i, time in enumerate(own)
    )


def _progress(repetitions: int, keys: Iterable[Key]) -> Iterable[int]:
    """Count repetitions; show their progress on a terminal."""
    return tqdm(range(repetitions), desc=next(iter(keys)).part, disable=None)


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Collect garbage now, and not while something is timed."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
