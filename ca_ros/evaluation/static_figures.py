"""Figures of the static study: how large the errors are, and how long the calls take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.evaluation import Evaluation
from ca_ros.evaluation.figure_style import legend, sheet, styles, title
from ca_ros.evaluation.section_figures import draw_slices, draw_violations
from ca_ros.evaluation.summary import Times
from ca_ros.flight.plots import STYLE, save
from ca_ros.problem.admissible_set import AdmissibleSet

ERROR_MIN = 1e-18
"""Smaller errors, zero among them, are drawn here [N, N m]."""


def draw(
    out: Path,
    admissible: AdmissibleSet,
    allocators: Mapping[str, Allocator],
    kept: Mapping[str, Evaluation],
    times: Mapping[str, Times],
    batch: bool,
    formats: Sequence[str],
) -> list[Path]:
    """Draw all figures of a static study into a folder; return their files."""
    with matplotlib.rc_context(STYLE):
        figures = {
            'errors': draw_errors(kept),
            'latency': draw_latency(times, batch),
            'slices': draw_slices(admissible, allocators),
        }
        if 'pseudo_inverse' in allocators:
            figures['violations'] = draw_violations(admissible, kept['pseudo_inverse'])
    return [
        file
        for name, drawn in figures.items()
        if drawn is not None
        for file in save(drawn, out / name, formats)
    ]


def draw_errors(kept: Mapping[str, Evaluation]) -> Figure:
    """Draw the cumulative distributions of the force and torque errors of each method."""
    figure, head, body = sheet(7.0, 3.2, len(kept))
    force, torque = body.subplots(1, 2, sharey=True)
    for axes, part, unit in ((force, 'force_error', 'N'), (torque, 'torque_error', 'N m')):
        curves = {}
        for name, evaluation in kept.items():
            errors = np.sort(np.maximum(getattr(evaluation, part), ERROR_MIN))
            curves[name] = (errors, np.arange(1, len(errors) + 1) / len(errors))
        _steps(axes, curves)
        axes.set_xlim(left=ERROR_MIN)
        axes.set_xticks(
            [ERROR_MIN, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0],
            ['0', *(f'$10^{{{exponent}}}$' for exponent in (-15, -12, -9, -6, -3, 0))],
        )
        axes.set_xlabel(f'{part.replace("_", " ")} [{unit}]')
    count = len(next(iter(kept.values())).demands)
    force.set_ylabel(f'share of {count} samples [%]')
    legend(head, force.get_lines())
    return figure


def draw_latency(times: Mapping[str, Times], batch: bool) -> Figure:
    """Draw the cumulative distribution of the time of a call of each method."""
    figure, head, body = sheet(5.0, 3.2, len(times))
    axes = body.subplots()
    _steps(axes, {name: own.distribution() for name, own in times.items()})
    axes.set_xlabel(f'time of a {"wrench in a batch" if batch else "call"} [s]')
    axes.set_ylabel('share of samples [%]')
    legend(head, axes.get_lines())
    return figure


def _steps(axes: Axes, curves: Mapping[str, tuple[Array, Array]]) -> None:
    """Draw distribution functions, which begin at zero, over a logarithmic axis."""
    looks = styles(list(curves))
    for name, (values, shares) in curves.items():
        axes.step(
            np.concatenate([values[:1], values]),
            100.0 * np.concatenate([[0.0], shares]),
            where='post',
            label=title(name),
            **looks[name],
        )
    axes.set_xscale('log')
