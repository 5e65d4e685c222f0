"""The package's commands and the nodes of the loop: setup.py and `bringup` read them here.

A command reports a missing package in one line.  This module imports nothing but the standard
library, because setup.py runs it.
"""

from __future__ import annotations  # setup.py reads this module in any Python that pip runs

import sys
import warnings
from importlib import import_module

NODES = ('controller', 'allocator', 'simulator')
"""The nodes of the loop, in the order in which `bringup` ends them: the source of commands first.

The module of a node is ``ca_ros.nodes.NAME``, and `ca_ros.nodes.settings.DECLARED` has its
parameters.
"""

COMMANDS = {
    **{node: f'ca_ros.nodes.{node}' for node in NODES},
    'attainable': 'ca_ros.studies.sets.attainable',
    'bringup': 'ca_ros.bringup.bringup',
    'dynamic_study': 'ca_ros.studies.dynamic.study',
    'fault_proxy': 'ca_ros.nodes.fault_proxy',
    'firmware': 'ca_ros.firmware.command',
    'monitor': 'ca_ros.nodes.monitor',
    'px4_bridge': 'ca_ros.px4.bridge',
    'static_study': 'ca_ros.studies.static.study',
    'viewer': 'ca_ros.nodes.viewer',
}
"""The module of each command, which has the function main."""

STUDIES = ('matplotlib', 'pandas', 'tqdm')  # the modules of the extra `studies`

ROS = (
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces',
    'rclpy', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'visualization_msgs',
)  # fmt: skip
"""The modules that ROS 2 or the extra `ros` installs."""

HINTS = {
    **dict.fromkeys(STUDIES, "pip install 'ca_ros[studies]'"),
    'distributed': "pip install 'ca_ros[cluster]'",
    'px4_msgs': 'build and source github.com/PX4/px4_msgs of the branch of your PX4 (docs/px4.md)',
    **dict.fromkeys(ROS, "source ROS 2 Jazzy, or pip install 'ca_ros[ros]' (x86-64 Linux)"),
}


def warn_in_one_line(command: str) -> None:
    """Show warnings without their place in the code."""
    warnings.formatwarning = lambda message, *_: f'{command}: {message}\n'  # type: ignore


def run(command: str) -> int | None:
    """Run a command; return its exit code."""
    warn_in_one_line(command)
    try:
        code: int | None = import_module(COMMANDS[command]).main()
    except ModuleNotFoundError as missing:
        package = (missing.name or '').partition('.')[0]
        if package not in HINTS:
            raise
        print(f'{command}: needs {package}: {HINTS[package]}', file=sys.stderr)
        return 1
    return code
