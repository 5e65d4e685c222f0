"""The tables of the dynamic study, in Markdown: the flights, and the paper's observations."""

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


def table(found: Mapping[str, Any]) -> str:
    """Return the flights of a study, as in dynamic.json, as a Markdown table."""
    rows, lost = [], found['lost_axes']
    for name, own in found['methods'].items():
        error = own['steady_state_error']
        settled = [time for axis, time in own['settling_time'].items() if axis not in lost]
        beyond = [share for axis, share in own['overshoot'].items() if axis not in lost]
        rows.append(
            (
                f'`{name}`',
                ', '.join(f'{1e3 * error[axis]:.2f}' for axis in 'xyz'),
                'given up' if 'yaw' in lost else f'{degrees(error["yaw"]):.4f}',
                ', '.join('never' if time is None else f'{time:.2f}' for time in settled),
                ', '.join(f'{100.0 * share:.1f}' for share in beyond),
                f'{own["effort"]:.1f}',
                f'{100.0 * own["time_at_bound"]:.1f}',
                f'{own["worst_force_residual"]:.1e}, {own["worst_torque_residual"]:.1e}',
                f'{degrees(own["greatest_tilt"]):.1f}',
            )
        )
    return markdown_table(TITLES, rows)


def observation_lines(found: Mapping[str, Any]) -> list[str]:
    """Return what was observed; for the paper's vehicle, a verdict on each of its sentences."""
    verdicts = found['observations']
    return [
        f'- {"Holds" if verdicts[what] else "Does not hold"}: {what} ({numbers})'
        if what in verdicts
        else f'- {what}: {numbers}'
        for what, numbers in found['numbers'].items()
    ]


def document(found: Mapping[str, Any]) -> str:
    """Return dynamic.md for a study as in dynamic.json."""
    parts = [
        '# Dynamic study',
        f'`{found["vehicle"]}` flies from rest at the origin to (1, 1, 1) m and a heading of '
        f'45°, {found["duration"]:g} s, {found["flown"]}; the controller is the same for all '
        'methods.',
    ]
    if found['failures']:
        lost = ', '.join(found['lost_axes']) or 'none'
        parts.append(
            f'Rotor failures: `{" ".join(found["failures"])}`. Lost axes at the end: {lost}.'
        )
    parts += [
        table(found),
        'Steady state is the last second; settled is within 2 % of the step; effort is the '
        'integral of |f|²; time at a bound is the share of the time of all rotors, to within '
        '0.1 % of their range; a residual is what the controller asked for minus what the rotors '
        'gave.',
    ]
    observed = '\n'.join(observation_lines(found))
    if found['observations']:
        parts += [
            "## The paper's observations",
            observed,
            f'A height error counts as nonzero from {1e3 * HEIGHT_ERROR:g} mm on. What the paper '
            'leaves open, and what was tried: docs/reproduction.md.',
        ]
    elif observed:
        parts += ['## In steady state', observed]
    return '\n\n'.join(parts) + '\n'
