"""The processes of a graph: start, end, exit codes and output."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import uuid
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from ca_ros.bringup import processes
from ca_ros.bringup.deadline import Deadline
from ca_ros.testing.domain import claim
from ca_ros.testing.environment import SETTINGS, applied

DEADLINE = float(os.environ.get('CA_ROS_TEST_DEADLINE', '60'))
"""Time limit of a wait [s]."""

MARK = 'CA_ROS_TEST_GRAPH'
"""A variable that marks the processes of a graph, and the processes that they start."""

LINES = 50
"""Number of lines of the output of a process that a report shows."""

BLOCKED = re.compile(
    r'Timeout \(.*\)!\nThread \S+ \(most recent call first\):\n'
    r'  File ".*/rclpy/node\.py", line \d+ in destroy_node\n'
)
"""What our nodes print if Fast DDS blocks while they are destroyed (docs/reliability.md)."""

EXCUSE = 'Fast DDS blocked at the end of a node, after its last command: Fast DDS issue 6513'

Process = subprocess.Popen[Any]


def executable(name: str) -> Path:
    """Return the path of an executable.

    Parameters
    ----------
    name : str
        A path, an executable of this package, of another ROS package, or on the PATH.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    if os.sep in name:
        return Path(name)
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    libraries = [Path(prefix, 'lib') for prefix in prefixes]
    found = [
        *(library / 'ca_ros' / name for library in libraries),
        Path(sysconfig.get_path('scripts'), name),
        *(path for library in libraries for path in sorted(library.glob(f'*/{name}'))),
        Path(shutil.which(name) or ''),
    ]
    for path in found:
        if path.is_file():
            return path
    raise FileNotFoundError(f"no executable '{name}': is its package installed, or sourced?")


class Processes:
    """Processes in a ROS domain of their own; a context manager that checks how they end.

    Parameters
    ----------
    **environment : str
        Environment variables of the processes, in addition to `SETTINGS` or instead of them.

    Attributes
    ----------
    domain : int
        The ROS domain.
    """

    opened: list[Processes] = []  # noqa: RUF012 - shared on purpose
    """Those that are open now, for the report of a failed test."""

    def __init__(self, **environment: str) -> None:
        self._settings = SETTINGS | environment

    def __enter__(self) -> Any:
        self._ending = ExitStack()
        self.domain, self._lock = claim()
        self._ending.callback(self._lock.close)
        self._folder = Path(self._ending.enter_context(tempfile.TemporaryDirectory()))
        self._settings |= {'ROS_DOMAIN_ID': str(self.domain), 'ROS_LOG_DIR': str(self._folder)}
        self._ending.enter_context(applied(self._settings))
        self._mark = uuid.uuid4().hex
        self._names: dict[Process, str] = {}
        self._exit_codes: dict[Process, Sequence[int]] = {}
        self._waited: set[Process] = set()
        self.opened.append(self)
        self._ending.callback(self.opened.remove, self)
        return self

    def __exit__(self, fault: type[BaseException] | None, *_: object) -> None:
        running = [process for process in self._names if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            with suppress(subprocess.TimeoutExpired):
                process.wait(DEADLINE)
        left = self.alive()
        faults = [f'not ended by SIGINT: {" ".join(process.cmdline())}' for process in left]
        for process in left:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(left, DEADLINE)
        for process in self._names:
            process.wait()
        faults += [
            f'{self._names[process]}: exit code {process.returncode} after SIGINT, expected '
            f'{" or ".join(map(str, self._exit_codes[process]))}'
            for process in running
            if process.returncode not in self._exit_codes[process]
        ]
        blocked = any(map(self._blocked, running))
        report = '\n'.join(f'--- {title}\n{text}' for title, text in self.report())
        self._ending.close()
        if fault is not None:
            print(report, file=sys.stderr)
        elif blocked:
            pytest.xfail(EXCUSE)
        elif faults:
            raise AssertionError('\n'.join([*faults, report]))

    def start(
        self, name: str, *arguments: str, exit_codes: Sequence[int] = (0,), **options: Any
    ) -> Process:
        """Start a process in a process group of its own.

        Parameters
        ----------
        name : str
            See `executable`.
        *arguments : str
        exit_codes : sequence of int
            The exit codes that are right if the process still runs at the end of the test, where
            it gets SIGINT.
        **options
            As for `subprocess.Popen`.
        """
        number = len(self._names)
        with ExitStack() as files:
            streams = {
                stream: files.enter_context((self._folder / f'{number}.{stream}').open('wb'))
                for stream in ('stdout', 'stderr')
                if stream not in options
            }
            process = processes.start(
                [str(executable(name)), *arguments],
                env=os.environ | self._settings | {MARK: self._mark},
                # The domain stays claimed while the process lives, even if the test is killed.
                pass_fds=[self._lock.fileno()],
                **streams,
                **options,
            )
        self._names[process] = f'{Path(name).name} {process.pid}'
        self._exit_codes[process] = exit_codes
        return process

    start_silent = start

    def output(self, process: Process) -> tuple[str, str]:
        """Return what a process has written so far to standard output and to standard error."""
        number = [*self._names].index(process)
        out, err = (
            file.read_text(encoding='utf-8', errors='replace') if file.exists() else ''
            for file in (self._folder / f'{number}.{stream}' for stream in ('stdout', 'stderr'))
        )
        return out, err

    def end(self, process: Process, number: int) -> tuple[str, str]:
        """Send a signal to a process and wait until it ends; return its output."""
        process.send_signal(number)
        return self.outlive(process)

    def outlive(self, process: Process, deadline: float = DEADLINE) -> tuple[str, str]:
        """Wait until a process ends by itself; return its output.

        Raises
        ------
        AssertionError
            If that does not happen within `deadline` seconds.
        pytest.xfail.Exception
            If Fast DDS blocks at the end of one of our nodes; the test then counts as an expected
            failure.
        """
        limit = Deadline(deadline)
        while process.poll() is None and not limit.passed():
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.1)
        if process.poll() is None:
            # Our executables print their tracebacks.
            process.send_signal(signal.SIGUSR1)
            with suppress(subprocess.TimeoutExpired):
                process.wait(2.0)
            process.kill()
            process.wait()
            self._waited.add(process)
            _, err = self.output(process)
            raise AssertionError(f'{self._names[process]}: not ended in {deadline:g} s: {err}')
        self._waited.add(process)
        if self._blocked(process):
            pytest.xfail(EXCUSE)
        return self.output(process)

    def _blocked(self, process: Process) -> bool:
        """Return whether Fast DDS blocked at the end of a node, after its last command."""
        return process.returncode == 1 and bool(BLOCKED.search(self.output(process)[1]))

    def alive(self) -> list[psutil.Process]:
        """Return the processes that run, and those that they have started."""
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.environ().get(MARK) == self._mark:
                    found.append(process)
        return found

    def ended(self) -> list[str]:
        """Return the processes that have ended while the test did not wait for their end."""
        return [
            f'{name}: exit code {process.returncode}: {_tail("".join(self.output(process)), 5)}'
            for process, name in self._names.items()
            if process.poll() is not None and process not in self._waited
        ]

    def report(self) -> list[tuple[str, str]]:
        """Return what explains a failure, as pairs of a title and a text."""
        return [
            (
                f'{name}, running' if code is None else f'{name}, exit code {code}',
                _tail(''.join(self.output(process)), LINES) or 'no output',
            )
            for process, name in self._names.items()
            for code in [process.poll()]
        ]


def _tail(text: str, lines: int) -> str:
    """Return the last lines of a text."""
    return '\n'.join(text.splitlines()[-lines:])
