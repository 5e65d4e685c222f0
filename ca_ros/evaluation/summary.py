"""Running figures of a method: what a static study keeps of samples that it does not keep."""

from __future__ import annotations

from collections import Counter
from math import isfinite, sqrt
from typing import Any

import numpy as np

from ca_ros.allocation import Status
from ca_ros.arrays import Array
from ca_ros.evaluation.evaluation import Evaluation


class Mean:
    """Mean and greatest of numbers that come in pieces."""

    def __init__(self) -> None:
        self._sum, self._count, self._max = 0.0, 0, 0.0

    def add(self, values: Array) -> None:
        """Take in (N,) numbers that are not negative."""
        self._sum += float(values.sum())
        self._count += len(values)
        self._max = max(self._max, float(values.max()))

    def figures(self) -> dict[str, float]:
        """Return them by name."""
        return {'mean': self._sum / self._count, 'max': self._max}


class Times:
    """The distribution of the times of calls; the share of a batch's time is one number."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._counts: list[int] = []

    def add(self, times: Array) -> None:
        """Take in (N,) times [s]."""
        single = len(times) > 1 and bool((times == times[0]).all())
        self._times += [float(times[0])] if single else times.tolist()
        self._counts += [len(times)] if single else [1] * len(times)

    def distribution(self) -> tuple[Array, Array]:
        """Return times in ascending order [s], and the share of samples that took no longer."""
        order = np.argsort(self._times)
        shares = np.cumsum(np.array(self._counts)[order])
        return np.array(self._times)[order], shares / shares[-1]

    def figures(self) -> dict[str, float]:
        """Return mean, maximum, median and 99th percentile [s]."""
        times, counts = np.array(self._times), np.array(self._counts)
        return {
            'mean': float(times @ counts / counts.sum()),
            'max': float(times.max()),
            'median': self._percentile(50),
            'p99': self._percentile(99),
        }

    def _percentile(self, percent: int) -> float:
        """Return what `np.percentile` would, had each time been noted as often as it counts."""
        order = np.argsort(self._times)
        times, ends = np.array(self._times)[order], np.cumsum(np.array(self._counts)[order])
        place = percent / 100.0 * (ends[-1] - 1)
        low, high = (times[np.searchsorted(ends, r(place), 'right')] for r in (np.floor, np.ceil))
        return float(low + (place - np.floor(place)) * (high - low))


class Summary:
    """What is known of one method so far.

    Attributes
    ----------
    force_error, torque_error : Mean
        [N], [N m]
    times : Times
    violation_max : float
        The greatest violation of the bounds before saturation [N].
    """

    def __init__(self) -> None:
        self._statuses: Counter[str] = Counter()
        self._violations = 0
        self.force_error, self.torque_error, self.times = Mean(), Mean(), Times()
        self.violation_max = 0.0

    def add(self, evaluation: Evaluation) -> None:
        """Take in N more samples."""
        self._violations += int(evaluation.violated.sum())
        self.violation_max = max(self.violation_max, float(evaluation.violation.max()))
        self.force_error.add(evaluation.force_error)
        self.torque_error.add(evaluation.torque_error)
        self.times.add(evaluation.time)
        values, counts = np.unique(evaluation.status, return_counts=True)
        for value, count in zip(values.tolist(), counts.tolist(), strict=True):
            self._statuses[Status(value).name] += count

    def figures(self) -> dict[str, Any]:
        """Return them by name, as in static.json."""
        count = sum(self._statuses.values())
        return {
            'violations': self._violations,
            'violations_standard_error': standard_error(self._violations, count),
            # None for a method that had no thrusts at all to saturate.
            'violation_max': self.violation_max if isfinite(self.violation_max) else None,
            'force_error': self.force_error.figures(),
            'torque_error': self.torque_error.figures(),
            'time': self.times.figures(),
            'status': dict(sorted(self._statuses.items())),
        }


def standard_error(hits: int, samples: int) -> float:
    """Return the standard error of a count among independent samples."""
    return sqrt(hits * (1.0 - hits / samples))
