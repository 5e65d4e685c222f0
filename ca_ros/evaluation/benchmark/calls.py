"""Times per call of all contenders, on each load."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.accuracy import Accuracy, Judge
from ca_ros.evaluation.benchmark.contenders import BASELINE, Contender
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import Times, measure, ratios, spread
from ca_ros.evaluation.evaluation import AnswerError
from ca_ros.problem.problem import AllocationProblem


def time_calls(
    problem: AllocationProblem,
    contenders: Mapping[str, Contender],
    wrenches: Array,
    plan: Plan,
    seed: int,
    progress: Callable[[], Any],
) -> dict[str, Any]:
    """Return figures by contender for one load, wrenches (W, m)."""
    judge, worst = Judge(problem, wrenches), {name: Accuracy() for name in contenders}

    def check(name: str, answers: list[Any]) -> None:
        try:
            judge.judge(worst[name], answers)
        except AnswerError as error:
            raise AnswerError(f'{name}: {error}') from None

    times = measure(
        {name: contender.track(wrenches) for name, contender in contenders.items()},
        plan.repetitions,
        plan.least,
        plan.budget,
        seed,
        check,
        progress,
    )
    return {
        name: {**figures(times[name], times[BASELINE]), **worst[name].figures()}
        for name in contenders
    }


def figures(own: Times, base: Times) -> dict[str, Any]:
    """Return what benchmark.json holds of the times of a contender beside the baseline's."""
    return {
        'mean': spread(own.means),
        'p99': spread(own.p99s),
        'ratio': spread(ratios(own.means, base.means)),
        'repetitions': [None if mean != mean else mean for mean in own.means],
    }


def fastest_correct_peer(
    contenders: Mapping[str, Contender], calls: Mapping[str, Mapping[str, Any]]
) -> str | None:
    """Return which solver of others is right on uniform wrenches, and fastest; None if none is."""
    found = {
        name: calls['uniform'][name]['mean']['median']
        for name, contender in contenders.items()
        if contender.kind == 'peer' and calls['uniform'][name]['correct']
    }
    return min(found, key=found.__getitem__) if found else None


def compare(calls: Mapping[str, Any], one: str, other: str) -> float | None:
    """Return the median ratio of the times of two contenders on a load; None if one is absent."""
    if one not in calls or other not in calls:
        return None
    pairs = zip(calls[one]['repetitions'], calls[other]['repetitions'], strict=True)
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    if not both:
        return None
    return spread(ratios([a for a, _ in both], [b for _, b in both]))['median']
