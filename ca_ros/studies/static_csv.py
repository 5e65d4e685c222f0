"""The file static.csv: one row a sample and method, written and read in pieces."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice, repeat
from pathlib import Path
from typing import TextIO

import numpy as np

from ca_ros.allocation import Status
from ca_ros.studies.evaluation import Evaluation

NAMES = {'roll': 'tau_x', 'pitch': 'tau_y', 'yaw': 'tau_z'}
"""Columns of the axes that go by another name."""


def header(axes: Sequence[str], n: int) -> list[str]:
    """Return the names of the columns for commanded axes and n rotors."""
    wrench = [NAMES.get(axis, axis) for axis in axes]
    thrusts = [f'f_{i + 1}' for i in range(n)]
    judged = ['violated', 'force_error', 'torque_error', 'time', 'status']
    return ['sample', 'method', *wrench, *thrusts, *judged]


def write(file: TextIO, first: int, evaluations: Mapping[str, Evaluation]) -> None:
    """Write samples from number `first` on: all methods of one, then of the next."""
    rows = [
        zip(
            range(first, first + len(e.demands)),
            repeat(method),
            *e.demands.T.tolist(),
            *e.thrusts.T.tolist(),
            e.violated.astype(int).tolist(),
            e.force_error.tolist(),
            e.torque_error.tolist(),
            e.time.tolist(),
            [Status(value).name for value in e.status.tolist()],
            strict=False,
        )
        for method, e in evaluations.items()
    ]
    csv.writer(file, lineterminator='\n').writerows(chain.from_iterable(zip(*rows, strict=True)))


def read(
    path: Path, methods: Sequence[str], axes: Sequence[str], n: int, size: int
) -> Iterator[tuple[dict[str, Evaluation], int]]:
    """Read a file back, up to `size` samples at a time, as far as samples are complete.

    Violations come back as infinite or zero: the file has no more of them.

    Yields
    ------
    evaluations : dict of str to Evaluation
    end : int
        Where in the file they end [bytes].

    Raises
    ------
    ValueError
        If the file has other columns or methods.
    """
    m = len(axes)
    with path.open('rb') as file:
        line = file.readline()
        if line.decode().rstrip('\n').split(',') != header(axes, n):
            raise ValueError(f'{path}: its columns are those of another study')
        end = len(line)
        while lines := list(islice(file, size * len(methods))):
            whole = [line for line in lines if line.endswith(b'\n')]
            whole = whole[: len(whole) // len(methods) * len(methods)]
            if not whole:
                return
            end += sum(map(len, whole))
            rows = [line.decode().rstrip('\n').split(',') for line in whole]
            evaluations = {}
            for k, method in enumerate(methods):
                own = rows[k :: len(methods)]
                if any(row[1] != method for row in own):
                    raise ValueError(f'{path}: its rows are those of another study')
                values = np.array([row[2:-1] for row in own], dtype=float)
                violated, force_error, torque_error, time = values[:, m + n :].T
                evaluations[method] = Evaluation(
                    values[:, :m],
                    values[:, m : m + n],
                    np.where(violated > 0.0, np.inf, 0.0),
                    force_error,
                    torque_error,
                    time,
                    np.array([Status[row[-1]] for row in own], dtype=np.int8),
                )
            yield evaluations, end
