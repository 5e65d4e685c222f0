"""The file static.csv: one row a sample and method, written in pieces."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from itertools import chain, repeat
from typing import TextIO

from ca_ros.allocation import Status
from ca_ros.evaluation.evaluation import Evaluation

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
