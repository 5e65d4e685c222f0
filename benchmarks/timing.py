"""Times of calls, interleaved, so that background load affects all contenders equally.

Contenders take turns: each allocates up to `TURN` wrenches, then the next one does, in an order
that is shuffled for each turn.  A repetition is complete when all have allocated all wrenches.
Ratios are computed within a repetition, and their median over the repetitions is taken.
"""

import gc
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from time import perf_counter, perf_counter_ns
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.answers import AnswerError, Answers, faults
from benchmarks.in_c import Compiled
from benchmarks.peers import Call
from benchmarks.sizes import Sizes
from ca_ros.arrays import Array

TURN = 250  # calls in a turn
WARM = 25  # calls before them, not timed: the caches hold the data of other contenders

PERCENTILES = {'p50': 50.0, 'p99': 99.0, 'p999': 99.9, 'worst': 100.0}
"""Percentiles over the wrenches, by column: of each, the median time over the repetitions."""


class Key(NamedTuple):
    """What a row of measurements is about; its fields are columns."""

    part: str
    wrenches: str
    contender: str
    rotors: int


Jobs = dict[Key, tuple[Callable[[], Any], float]]  # a job, and the number of units in it


def measure(
    calls: Mapping[Key, Call], checks: Mapping[Key, Answers], sizes: Sizes, seed: int
) -> pd.DataFrame:
    """Time contenders against each other, in an order that the seed determines.

    The checks have the wrenches of the calls, as many for all.

    Returns one row per contender and repetition in which it took part: the fields of `Key`,
    ``repetition`` (-1 for the first pass, which is not timed), ``time`` (the mean of a call) and
    the `PERCENTILES` of all repetitions [s], and the errors of the answers from `Answers.worst`.
    """
    wrenches = {key: list(checks[key].demands) for key in calls}
    count = len(next(iter(wrenches.values())))
    chance, rows, shares = random.Random(seed), [], {}
    singles: dict[Key, list[Array]] = {key: [] for key in calls}

    def add(key: Key, repetition: int, time: float, answers: Sequence[Any]) -> None:
        try:
            worst = checks[key].worst(answers)
        except AnswerError as error:
            raise AnswerError(f'{key.contender}: {error}') from None
        rows.append({**key._asdict(), 'repetition': repetition, 'time': time, **worst})

    def in_turns(keys: Sequence[Key], work: Callable[[Call, list[Array]], Any]) -> Any:
        done: dict[Key, list[Any]] = {key: [] for key in keys}
        for start in range(0, count, TURN):
            for key in chance.sample(keys, len(keys)):
                for before in range(start - WARM, start):
                    calls[key](wrenches[key][before % count])
                done[key].append(work(calls[key], wrenches[key][start : start + TURN]))
        return done

    with without_garbage_collection():
        for key, call in calls.items():
            # The first calls fill caches and are not timed.
            first, answers = _one_by_one(call, wrenches[key])
            add(key, -1, np.nan, answers)
            wanted = 1e9 * sizes.budget / (2.0 * float(np.median(first)) * count)
            shares[key] = int(min(max(wanted, sizes.least), sizes.repetitions))
        for i in tqdm(range(sizes.repetitions), next(iter(calls)).part, disable=None):
            part = [key for key in calls if takes_part(i, shares[key], sizes.repetitions)]
            spent, singly = in_turns(part, _together), in_turns(part, _one_by_one)
            for key in part:
                single, given = zip(*singly[key], strict=True)
                time = sum(spent[key]) / 1e9 / count
                singles[key].append(np.concatenate(single))
                add(key, i, time, list(chain(*given)))
    # What the machine interrupts in one repetition decides no percentile.
    slow = [np.percentile(np.median(own, axis=0), list(PERCENTILES.values()))
            for own in singles.values()]
    index = pd.MultiIndex.from_tuples(singles, names=Key._fields)
    percentiles = pd.DataFrame(np.array(slow) / 1e9, index, list(PERCENTILES))
    return pd.DataFrame(rows).join(percentiles, on=list(Key._fields))


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


def rounds(jobs: Jobs, repetitions: int, seed: int) -> pd.DataFrame:
    """Time jobs in a shuffled order.

    Returns one row per job and repetition: the fields of `Key`, ``repetition``, and the ``time``
    of a unit [s].
    """
    chance = random.Random(seed)
    times: dict[Key, list[float]] = {key: [] for key in jobs}
    for _ in tqdm(range(repetitions), next(iter(jobs)).part, disable=None):
        for key in chance.sample(list(jobs), len(jobs)):
            job, units = jobs[key]
            with without_garbage_collection():
                start = perf_counter()
                job()
                times[key].append((perf_counter() - start) / units)
    return pd.DataFrame(
        {**key._asdict(), 'repetition': i, 'time': time} for key, own in times.items()
        for i, time in enumerate(own)
    )


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Collect garbage now, and not while something is timed."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def summarize(rows: pd.DataFrame, baseline: str) -> pd.DataFrame:
    """Return the metrics of rows, one row per `Key`, which is the index.

    The columns are the median over repetitions and the ends of the interquartile range of the time
    (``time``, ``time_low``, ``time_high``) and of the time in units of the baseline's (``ratio``
    and so on), the `PERCENTILES`, the largest errors, and ``faults``.
    """
    groups = ['part', 'wrenches', 'rotors', 'repetition']
    unit = rows[rows['contender'] == baseline].set_index(groups)['time'].rename('unit')
    rows = rows.join(unit, on=groups)
    rows['ratio'] = rows['time'] / rows['unit']
    own = rows.groupby(list(Key._fields), sort=False)
    columns = {
        f'{name}{end}': own[name].quantile(share) for name in ('time', 'ratio')
        for end, share in (('_low', 0.25), ('', 0.5), ('_high', 0.75))
    }
    columns |= {name: own[name].median() for name in PERCENTILES}
    errors = ('error', 'violation', 'norm_excess', 'failures')
    found = pd.DataFrame(columns | {name: own[name].max() for name in errors})
    return found.assign(faults=[faults(worst) for worst in found.to_dict('records')])


def ratio(rows: pd.DataFrame, one: Key, other: Key, column: str = 'time') -> float | None:
    """Return the median ratio of times within a repetition; None if one was not measured."""
    times = rows.pivot_table(column, 'repetition', list(Key._fields))
    if one not in times or other not in times:
        return None
    return float((times[one] / times[other]).median())
