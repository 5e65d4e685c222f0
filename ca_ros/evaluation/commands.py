"""The commands of the studies, which name the extra that is missing in one line."""

from __future__ import annotations

import sys
from functools import partial
from importlib import import_module

COMMANDS = {
    'benchmark': 'ca_ros.evaluation.benchmark.benchmark',
    'dynamic_study': 'ca_ros.evaluation.dynamic_study',
    'report': 'ca_ros.evaluation.report.report',
    'static_study': 'ca_ros.evaluation.static_study',
}
"""The module of each command, which has the function main."""

STUDIES = ('jinja2', 'matplotlib', 'mistune', 'pandas', 'tqdm')
"""The modules that the extra `studies` installs."""


def run(command: str) -> int:
    """Run a command; return its exit code."""
    try:
        code: int = import_module(COMMANDS[command]).main()
    except ModuleNotFoundError as missing:
        package = (missing.name or '').partition('.')[0]
        if package not in STUDIES:
            raise
        print(f"{command}: needs {package}: pip install 'ca_ros[studies]'", file=sys.stderr)
        return 1
    return code


benchmark, dynamic_study, report, static_study = (partial(run, command) for command in COMMANDS)
