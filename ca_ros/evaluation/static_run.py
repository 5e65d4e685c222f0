"""A static study under way: sampled, allocated, written and summed up piece by piece."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation import static_csv
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.evaluation import Evaluation, evaluate, join
from ca_ros.evaluation.record import machine, versions
from ca_ros.evaluation.sampling import samples
from ca_ros.evaluation.static_figures import draw
from ca_ros.evaluation.static_report import report
from ca_ros.evaluation.summary import Summary
from ca_ros.problem.admissible_set import AdmissibleSet

SINGLE_MAX = 10_000
"""Up to so many samples each call is timed; of more, each batch."""

CHUNK, BATCH = 100, 10_000
"""Samples that are allocated and written at a time, one by one or in a batch."""

KEPT = 10_000
"""Samples, the first ones, that are kept for figures: memory does not grow with their number."""


@dataclass(eq=False)
class Study:
    """A static study under way.

    Attributes
    ----------
    case : Case
    allocators : mapping of str to Allocator
    total, seed : int
        Number of samples, and what they are drawn from.
    sampling : str
        A name in `SAMPLINGS`.
    done : int
        Number of samples that are written.
    summaries : dict of str to Summary
    kept : dict of str to list of Evaluation
        The first samples.
    """

    case: Case
    allocators: Mapping[str, Allocator]
    total: int
    seed: int
    sampling: str
    done: int = 0
    summaries: dict[str, Summary] = field(default_factory=dict)
    kept: dict[str, list[Evaluation]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.admissible = AdmissibleSet(self.case.vehicle)
        self.summaries = {name: Summary() for name in self.allocators}
        self.kept = {name: [] for name in self.allocators}

    @property
    def batch(self) -> bool:
        """Whether wrenches are allocated in batches."""
        return self.total > SINGLE_MAX

    def settings(self) -> dict[str, Any]:
        """Return all that the samples and the answers depend on."""
        return {
            'seed': self.seed,
            'sampling': self.sampling,
            'timing': f'batches of {BATCH}' if self.batch else 'single calls',
            'vehicle': self.case.name,
            'changes': self.case.changes,
            'parameters': self.case.parameters,
        }

    def figures(self) -> dict[str, Any]:
        """Return what static.json holds."""
        return {
            'samples': self.done,
            'requested': self.total,
            **self.settings(),
            'methods': {name: summary.figures() for name, summary in self.summaries.items()},
            'versions': versions(),
            'machine': machine(),
        }

    def add(self, evaluations: Mapping[str, Evaluation]) -> None:
        """Take in samples that are written."""
        for name, evaluation in evaluations.items():
            self.summaries[name].add(evaluation)
            if self.done < KEPT:
                self.kept[name].append(evaluation)
        self.done += len(next(iter(evaluations.values())).demands)

    def run(self, out: Path, stop: Sequence[int]) -> None:
        """Allocate and write all samples, or as many as are done when `stop` is not empty."""
        problem = self.admissible.problem
        size = BATCH if self.batch else CHUNK
        with (
            (out / 'static.csv').open('w', encoding='utf-8') as file,
            tqdm(total=self.total, unit=' samples', disable=not sys.stderr.isatty()) as bar,
        ):
            file.write(','.join(static_csv.header(problem.axes, len(problem.lower))) + '\n')
            if not self.batch:
                # What only the first call of a method does is not part of its time.
                for allocator in self.allocators.values():
                    allocator.allocate(self._samples(0, 1)[0])
            while self.done < self.total and not stop:
                first, end = self.done, min(self.done + size, self.total)
                demands = self._samples(first, end)
                evaluations = {
                    name: evaluate(name, allocator, problem, demands, self.batch)
                    for name, allocator in self.allocators.items()
                }
                static_csv.write(file, first, evaluations)
                self.add(evaluations)
                bar.update(end - first)

    def _samples(self, start: int, end: int) -> Array:
        return samples(self.admissible, self.sampling, self.seed, start, end)

    def write(self, out: Path, formats: Sequence[str] = ('png',)) -> list[Path]:
        """Write summary, table and figures of what is done; return their files."""
        figures = self.figures()
        (out / 'static.json').write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
        (out / 'static.md').write_text(report(figures), encoding='utf-8')
        kept = {name: join(parts) for name, parts in self.kept.items()}
        times = {name: summary.times for name, summary in self.summaries.items()}
        drawn = draw(out, self.admissible, self.allocators, kept, times, self.batch, formats)
        return [out / 'static.csv', out / 'static.json', out / 'static.md', *drawn]
