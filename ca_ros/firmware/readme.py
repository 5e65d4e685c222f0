"""The fields of the README of an exported vehicle."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.firmware import golden
from ca_ros.firmware.firmware import LIMIT, Firmware
from ca_ros.firmware.footprint import Footprint
from ca_ros.problem.controllability import unit

SAMPLE = 3333  # number of wrenches of each kind and fault for which steps are counted

FORWARD_RIGHT_DOWN = {
    'force_x': 'F_x', 'force_y': '-F_y', 'thrust': '-F_z', 'roll': 'M_x', 'pitch': '-M_y',
    'yaw': '-M_z',
}
"""The components of a wrench in terms of those in the frame of autopilots."""

UNATTAINABLE = {
    'prioritize': 'is served in the order of priorities: {order} (`CA_PRIORITIZED`, with\n'
    '`allocation.exact.thrust_deviation: {deviation}`)',
    'scale': 'is scaled towards hover until it is attainable (`CA_SCALED`)',
    'reject': 'is rejected: all rotors get the speed nearest to zero (`CA_REJECTED`)',
}
"""What becomes of an unattainable wrench, by policy."""

HOW_TO_MEASURE = """\
Flash, RAM and stack were not measured: {why}.
`make size` prints them: flash is text + data, RAM is data + bss, and the stack is at most the sum
of the frames along the deepest chain of calls."""


def facts(firmware: Firmware, footprint: Footprint | str, folder: Path) -> dict[str, str]:
    """Return the fields of the README's template.

    `footprint`: or the reason why it was not measured.  `folder`: where the kernel's files are.
    """
    problem = firmware.problem
    sample = golden.effort(firmware, SAMPLE, seed=1)
    few = golden.effort(firmware, golden.SIZE, seed=0)
    return words(firmware) | {
        'absurd': f'{LIMIT[firmware.precision]:g}',
        'wrench_table': '\n'.join(
            f'| {k} | {axis} [{unit(axis)}] | {FORWARD_RIGHT_DOWN[axis]} |'
            for k, axis in enumerate(problem.axes)
        ),
        'footprint': measured(footprint),
        'loop_bounds': loop_bounds(folder),
        'golden_steps': str(few[0]),
        'golden_pivots': str(few[1]),
        'sample_size': f'{3 * SAMPLE * len(firmware.faults):,}'.replace(',', ' '),
        'sample_steps': str(sample[0]),
        'sample_pivots': str(sample[1]),
    }


def words(firmware: Firmware) -> dict[str, str]:
    """Return the fields that all vehicles have."""
    problem, suffix = firmware.problem, 'f' * firmware.single
    return {
        'axes_listed': ', '.join(problem.axes),
        'hover': ', '.join(f'{float(f"{number:.6g}")}{suffix}' for number in problem.reference),
        'unattainable': unattainable(firmware.settings.exact, problem.axes),
        'fault_table': '\n'.join(
            f'| {i} | `{fault.constant}` | {", ".join(fault.problem.axes)} | {fault.report} |'
            for i, fault in enumerate(firmware.faults)
        ),
        'precision_name': firmware.precision,
    }


def unattainable(settings: ExactSettings, axes: Sequence[str]) -> str:
    """Return how a wrench that is not attainable is served."""
    order = '; '.join(' and '.join(group) for group in settings.groups(axes))
    return UNATTAINABLE[settings.policy].format(order=order, deviation=settings.thrust_deviation)


def measured(footprint: Footprint | str) -> str:
    """Return a table of flash, RAM and stack, or how to measure them."""
    if isinstance(footprint, str):
        return HOW_TO_MEASURE.format(why=footprint)
    return (
        f'| flash | RAM | stack, at most |\n|---|---|---|\n'
        f'| {footprint.flash} bytes | {footprint.ram} bytes | {footprint.stack} bytes |\n\n'
        f'This is with {footprint.compiler}, -O3,\nfor a {footprint.core}. '
        '`make size` repeats the measurement.'
    )


def loop_bounds(folder: Path) -> str:
    """Return a table of the constants that bound the iterations of the kernel."""
    rows = []
    for file in ('least_norm.c', 'priorities.c'):
        text = (folder / file).read_text(encoding='utf-8')
        for comment, block in re.findall(r'/\* ([^/]*?) \*/\n((?:#define .*\n)+)', text):
            words = ' '.join(word for word in comment.split() if word != '*')
            for constant, value in re.findall(r'^#define ([A-Z_]+) (\d+)$', block, re.MULTILINE):
                rows.append(f'| `{constant}` | {value} | {words} ({file}) |')
    return '\n'.join(rows)
