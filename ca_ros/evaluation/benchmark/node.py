"""The allocator node beside an echo node, measured by a process that knows ROS."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ca_ros.bringup.processes import start

COMMAND = (sys.executable, '-m', 'ca_ros.evaluation.latency')


def time_node(vehicle: str, quick: bool, command: Sequence[str] = COMMAND) -> dict[str, Any]:
    """Return what the measuring process finds.

    Parameters
    ----------
    vehicle : str
        A shipped vehicle or a parameter file.
    quick : bool
    command : sequence of str
        How to start that process; ``--out``, ``--vehicle`` and ``--quick`` are added.

    Returns
    -------
    dict
        With 'absent' and the reason where there is no ROS; with 'error' if it failed.
    """
    if find_spec('rclpy') is None:
        return {'absent': 'rclpy is not installed'}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'latency.json'
        words = [*command, '--out', str(file), '--vehicle', vehicle, *['--quick'] * quick]
        pipes = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.PIPE, 'text': True}
        with start(words, **pipes) as process:
            try:
                _, said = process.communicate()
            except BaseException:
                # The process has to end its nodes: it is asked to end, and waited for.
                process.terminate()
                process.communicate()
                raise
        if process.returncode:
            last = (said.strip().splitlines() or ['without a word'])[-1]
            return {'error': f'exit code {process.returncode} of {command[-1]}: {last}'}
        try:
            found = json.loads(file.read_text(encoding='utf-8'))
        except (OSError, ValueError) as error:
            return {'error': f'{command[-1]} has left no result: {error}'}
    if not isinstance(found, dict) or not {'rates', 'sustained'} <= set(found):
        return {'error': f'{command[-1]} has left a result without rates and sustained'}
    return found
