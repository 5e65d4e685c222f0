"""The result files of the studies, and what they say about how they were made."""

import argparse
import json
import os
import platform
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from pathlib import Path
from typing import Any

import pandas as pd

from ca_ros.studies.cases import Case

CPUS = Path('/proc/cpuinfo')

PACKAGES = ('ca_ros', 'numpy', 'scipy', 'osqp', 'pandas', 'matplotlib')

NOT_REPEATED = (
    'out', 'figures', 'figure_width', 'fail', 'announce', 'ros_arguments', 'goals', 'waypoint',
    'heading', 'trajectory', 'workers', 'scheduler', 'plot_rows',
)  # fmt: skip
"""Options that the command leaves out: places of files and of computation, and what the dynamic
study adds itself."""


def write(stem: Path, rows: pd.DataFrame, found: Mapping[str, Any], document: str) -> None:
    """Write the rows as CSV, the metrics as JSON (null if not finite), a document as Markdown."""
    rows.to_csv(stem.with_suffix('.csv'), index=False, lineterminator='\n')
    text = json.dumps(_plain(found), indent=2, allow_nan=False) + '\n'
    stem.with_suffix('.json').write_text(text, encoding='utf-8')
    stem.with_suffix('.md').write_text(document, encoding='utf-8')


def _plain(found: Any) -> Any:
    """Return content for JSON, which has no infinity: None in place of what is not finite."""
    if isinstance(found, Mapping):
        return {name: _plain(value) for name, value in found.items()}
    if isinstance(found, (list, tuple)):
        return [_plain(value) for value in found]
    return None if isinstance(found, float) and not isfinite(found) else found


def facts(
    case: Case, prog: str, options: argparse.Namespace, more: Sequence[str] = ()
) -> dict[str, Any]:
    """Return what a study says about how its results were made.

    The command, with more words at its end, gives the same results; defaults are spelled out.
    """
    words = [prog]
    for name, given in vars(options).items():
        value = ','.join(given) if isinstance(given, tuple) else given
        if name not in NOT_REPEATED and value is not None and value is not False:
            for each in value if isinstance(value, list) else [value]:
                words += [f'--{name.replace("_", "-")}', *([] if value is True else [str(each)])]
    return {
        'command': [*words, *more], 'vehicle': case.name, 'changes': case.changes,
        'parameters': case.parameters, 'versions': versions(), 'machine': machine(),
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that are installed."""
    found = {'python': platform.python_version(), **dict.fromkeys(PACKAGES, 'not installed')}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def machine() -> dict[str, str | int]:
    """Return processor, number of cores and system."""
    # Only Linux has this file.
    info = CPUS.read_text() if CPUS.is_file() else ''
    names = re.findall('^model name.*?: (.*)', info, re.MULTILINE)
    processor = names[0].strip() if names else platform.processor() or platform.machine()
    system = platform.platform(terse=True)
    return {'processor': processor, 'cores': os.cpu_count() or 1, 'system': system}
