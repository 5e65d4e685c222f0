"""PX4's simulator SIH, and other processes, in a folder of their own."""

import argparse
import os
import shutil
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from ca_ros.process.processes import FAST_DDS, Processes
from ca_ros.testing import executable

MARK = 31_010  # MAV_CMD_USER_1: PX4 logs it, and does nothing else with it

PORT = 8888  # of the agent, for the first PX4

PARAMETERS = {
    'COM_RC_IN_MODE': 4,  # no remote control
    'NAV_DLL_ACT': 0,  # no ground station
    'SDLOG_PROFILE': 1 | 1 << 4,  # default and high rate
}
"""What a flight without a pilot's devices needs of PX4."""


def parsed(parser: argparse.ArgumentParser, speed: float) -> argparse.Namespace:
    """Return the command line, with the options of all flights; make the folder of the logs.

    `speed`: default of ``--speed``
    """
    parser.add_argument('--px4', type=Path, required=True, help="PX4's build folder")
    parser.add_argument(
        '--speed', type=float, default=speed, help='simulated seconds a second')
    parser.add_argument('--nice', type=int, default=0, help='niceness of the processes')
    parser.add_argument('--instance', type=int, default=0, help='number of this PX4')
    parser.add_argument('--out', type=Path, default=Path('flights'), help='folder of the logs')
    options = parser.parse_args()
    options.px4, options.out = options.px4.resolve(), options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    return options


class Sitl:
    """PX4 with SIH in a folder of its own.

    - `build`: PX4's build folder, which has ``bin/px4`` and ``etc``
    - `model`: ``quadx`` or ``hex``
    - `folder`: for PX4's files; it must not exist
    - `speed`: simulated seconds a second
    - `nice`: niceness of all processes
    - `parameters`: of PX4, beside `PARAMETERS`
    - `topics`: what PX4 logs, each as often as it comes; by default as SDLOG_PROFILE says
    - `instance`: number of this PX4; each needs another one
    """

    def __init__(
        self, build: Path, model: str, folder: Path, speed: float = 1.0, nice: int = 0,
        parameters: Mapping[str, object] | None = None, instance: int = 0,
        topics: Sequence[str] = (),
    ) -> None:
        self.build, self.folder, self.instance = build, folder, str(instance)
        self.topics = topics
        self.speed, self.nice, self.port = speed, nice, PORT + instance
        given = {**PARAMETERS, **(parameters or {})}
        self.environment = {
            **os.environ, **FAST_DDS, 'PX4_SIM_MODEL': f'sihsim_{model}',
            'PX4_UXRCE_DDS_PORT': str(self.port), 'PX4_UXRCE_DDS_NS': '',
            **{f'PX4_PARAM_{name}': str(value) for name, value in given.items()},
        }
        if speed != 1.0:
            self.environment['PX4_SIM_SPEED_FACTOR'] = str(speed)
        self.processes = Processes()

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True)
        if self.topics:
            # PX4 uses this copy, since it is there already.
            shutil.copytree(self.build / 'etc', self.folder / 'etc')
            listed = self.folder / 'etc/logging/logger_topics.txt'
            listed.parent.mkdir(exist_ok=True)
            listed.write_text('\n'.join(self.topics) + '\n')
        self.start('px4', [self.build / 'bin/px4', '-i', self.instance, '-d', self.build / 'etc'])
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.shell('logger', 'off')
        self.shell('shutdown')
        self.processes.stop()

    def start(self, name: str, command: Sequence[str | Path]) -> None:
        """Start a process; its output goes to NAME.log."""
        words = [str(word) for word in command]
        if self.nice:
            words = ['nice', '-n', str(self.nice), *words]
        with open(self.folder / f'{name}.log', 'a') as log:
            process = self.processes.start(
                name, words, cwd=self.folder, env=self.environment, stdout=log, stderr=log
            )
        group = Path(f'/proc/{process.pid}/autogroup')
        if self.nice and group.exists():
            # Each session is scheduled as one; niceness counts only within it.
            group.write_text(str(self.nice))

    def node(self, name: str, *arguments: str) -> None:
        """Start a node of ca_ros."""
        self.start(name, [*executable(name), *arguments])

    def kill(self, name: str) -> None:
        """End a process at once, as a crash would."""
        os.killpg(self.processes.running[name].pid, signal.SIGKILL)

    def shell(self, command: str, *arguments: str) -> str:
        """Give a command to PX4's shell, and return what it says."""
        client = self.build / f'bin/px4-{command}'
        words = [str(client), '--instance', self.instance, *arguments]
        answer = subprocess.run(
            words, cwd=self.folder, capture_output=True, text=True, timeout=30, check=False
        )
        return answer.stdout

    def log(self, to: Path) -> Path:
        """Copy PX4's log of the flight to a file."""
        self.shell('logger', 'off')
        logs = sorted(self.folder.glob('log/*/*.ulg'))
        if not logs:
            raise FileNotFoundError(f'no log of PX4 in {self.folder}')
        return Path(shutil.copy(logs[-1], to))
