"""The tables of the dynamic study in Markdown: the flights, and the paper's observations."""

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
    """Return the paper's observations, and whether they hold."""
    return [
        f'- {"Holds" if holds else "Does not hold"}: {what} ({found["numbers"][what]})'
        for what, holds in found['observations'].items()
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
        words = ' '.join(found['failures'])
        parts.append(f'Rotor failures: `{words}`. Lost axes at the end: {lost}.')
    parts += [
        table(found),
        'The steady state is the last second; settled means within 2 % of the step; effort is the '
        'integral of |f|²; time at a bound is the share of the time of all rotors, to within '
        '0.1 % of their range; a residual is the commanded wrench minus the delivered one.',
    ]
    if found['observations']:
        parts += [
            "## The paper's observations",
            '\n'.join(observation_lines(found)),
            f'Height errors below {1e3 * HEIGHT_ERROR:g} mm count as zero. What the paper '
            'leaves open, and what was tried: docs/reproduction.md.',
        ]
    return '\n\n'.join(parts) + '\n'
