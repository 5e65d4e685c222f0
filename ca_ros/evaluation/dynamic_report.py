"""The file dynamic.md: the flights in a table, and the paper's observations."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import Any

from ca_ros.evaluation.observations import HEIGHT_ERROR
from ca_ros.evaluation.tables import table as markdown_table

TITLES = (
    'method',
    'steady-state error x, y, z [mm]',
    'heading [°]',
    'settling time x, y, z, heading [s]',
    'overshoot x, y, z, heading [%]',
    'effort [N² s]',
    'time at a bound [%]',
    'worst residual [N], [N m]',
    'greatest tilt [°]',
)


def table(figures: Mapping[str, Any]) -> str:
    """Return the flights of a study, as in dynamic.json, as a Markdown table."""
    rows, lost = [], figures['lost_axes']

    def kept(values: Mapping[str, Any]) -> list[Any]:
        return [value for axis, value in values.items() if axis not in lost]

    for name, found in figures['methods'].items():
        error = found['steady_state_error']
        rows.append(
            (
                f'`{name}`',
                ', '.join(f'{1e3 * error[axis]:.2f}' for axis in 'xyz'),
                'given up' if 'yaw' in lost else f'{degrees(error["yaw"]):.4f}',
                ', '.join(
                    'never' if time is None else f'{time:.2f}'
                    for time in kept(found['settling_time'])
                ),
                ', '.join(f'{100.0 * share:.1f}' for share in kept(found['overshoot'])),
                f'{found["effort"]:.1f}',
                f'{100.0 * found["time_at_bound"]:.1f}',
                f'{found["worst_force_residual"]:.1e}, {found["worst_torque_residual"]:.1e}',
                f'{degrees(found["greatest_tilt"]):.1f}',
            )
        )
    return markdown_table(TITLES, rows)


def observation_lines(figures: Mapping[str, Any]) -> list[str]:
    """Return what was observed; for the paper's vehicle, a verdict on each of its sentences."""
    verdicts = figures['observations']
    return [
        f'- {"Holds" if verdicts[what] else "Does not hold"}: {what} ({numbers})'
        if what in verdicts
        else f'- {what}: {numbers}'
        for what, numbers in figures['numbers'].items()
    ]


def report(figures: Mapping[str, Any]) -> str:
    """Return dynamic.md for a study as in dynamic.json."""
    parts = [
        '# Dynamic study',
        f'`{figures["vehicle"]}` flies from rest at the origin to (1, 1, 1) m and a heading of '
        f'45°, {figures["duration"]:g} s, {figures["flown"]}; the controller is the same for all '
        'methods.',
        *_failures(figures),
        table(figures),
        'Steady state is the last second; settled is within 2 % of the step; effort is the '
        'integral of |f|²; time at a bound is the share of the time of all rotors, to within '
        '0.1 % of their range; a residual is what the controller asked for minus what the rotors '
        'gave.',
    ]
    if figures['observations']:
        parts += [
            "## The paper's observations",
            '\n'.join(observation_lines(figures)),
            f'A height error counts as nonzero from {1e3 * HEIGHT_ERROR:g} mm on. What the paper '
            'leaves open, and what was tried: docs/reproduction.md.',
        ]
    elif figures['numbers']:
        parts += ['## In steady state', '\n'.join(observation_lines(figures))]
    return '\n\n'.join(parts) + '\n'


def _failures(figures: Mapping[str, Any]) -> list[str]:
    """Return what fails in flight, in a sentence, if anything does."""
    if not figures['failures']:
        return []
    lost = ', '.join(figures['lost_axes']) or 'none'
    return [f'Rotor failures: `{" ".join(figures["failures"])}`. Lost axes at the end: {lost}.']
