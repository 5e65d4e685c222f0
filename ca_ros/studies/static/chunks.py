"""The chunks of a static study: each allocates its own samples, and keeps sums and a few rows."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from ca_ros.allocation import Allocator
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.studies.cases import Case
from ca_ros.studies.errors import ERRORS, evaluate
from ca_ros.studies.wrench_sets import samples

Summary = dict[str, Any]


@dataclass(frozen=True, eq=False)
class StaticChunks:
    """The chunks of a static study, of `size` samples each; the call computes one.

    The methods take turns, each with `step` samples: in one call if `batch`, otherwise in calls
    that are timed.  The rows of the first `rows` samples are kept.  See also `samples`.
    """

    case: Case
    methods: Sequence[str]
    sampling: str
    seed: int
    samples: int
    size: int
    step: int
    batch: bool
    rows: int

    @cached_property
    def _set(self) -> AdmissibleSet:
        return AdmissibleSet(self.case.problem)

    @cached_property
    def _allocators(self) -> dict[str, Allocator]:
        made = {name: self.case.allocator(name) for name in self.methods}
        # The first call of a method fills its caches and is not timed.
        for allocator in () if self.batch else made.values():
            allocator.allocate(samples(self._set, self.sampling, self.seed, 0, 1)[0])
        return made

    def __call__(self, number: int) -> tuple[list[pd.DataFrame], dict[str, Summary]]:
        """Return rows, and summaries by method, of a chunk."""
        first = number * self.size
        end = min(first + self.size, self.samples)
        kept: list[pd.DataFrame] = []
        summaries: dict[str, list[Summary]] = {name: [] for name in self.methods}
        for start in range(first, end, self.step):
            stop = min(start + self.step, end)
            demands = samples(self._set, self.sampling, self.seed, start, stop)
            parts = []
            for name, allocator in self._allocators.items():
                own = evaluate(name, allocator, self._set.problem, demands, self.batch)
                summaries[name].append(self._summary(own))
                parts.append(own[: max(0, self.rows - start)])
            if start < self.rows:
                rows = pd.concat(parts)
                rows.insert(0, 'sample', rows.index + start)
                kept.append(rows.sort_values('sample', kind='stable'))
        return kept, {name: merged(own) for name, own in summaries.items()}

    def _summary(self, own: pd.DataFrame) -> Summary:
        time, status = own['time'].tolist(), own['status'].value_counts()
        found: Summary = {
            'violations': int(own['violated'].sum()),
            'violation_max': float(own['violation'].max()),
            'status': {name: int(count) for name, count in status.items() if count},
            'time': time[:1] if self.batch else time,
        }
        errors = own[[name for name in ERRORS if name in own]]
        return found | errors.agg(['sum', 'max']).to_dict()


def merged(parts: Sequence[Summary]) -> Summary:
    """Return the summary of successive parts; their order decides the last digits of the sums."""
    counts = sum((Counter(part['status']) for part in parts), Counter[str]())
    found: Summary = {
        'violations': sum(part['violations'] for part in parts),
        'violation_max': max(part['violation_max'] for part in parts),
        'status': dict(sorted(counts.items())),
        'time': [time for part in parts for time in part['time']],
    }
    for name in ERRORS:
        if own := [part[name] for part in parts if name in part]:
            total, worst = sum(each['sum'] for each in own), max(each['max'] for each in own)
            found[name] = {'sum': total, 'max': worst}
    return found
