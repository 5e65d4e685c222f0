"""The processes of a graph: executables, start, end, exit codes and output."""

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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar, cast

import psutil

from ca_ros.process.processes import FAST_DDS, Deadline, Process, Processes
from ca_ros.testing.domain import claim
from ca_ros_cli import COMMANDS

DEADLINE = float(os.environ.get('CA_ROS_TEST_DEADLINE', '60'))  # time limit of a wait [s]

MARK = 'CA_ROS_TEST_GRAPH'  # a variable of all processes of a graph, and of their children
LINES = 50  # number of lines of the output of a process that a report shows

STREAMS = 'stdout', 'stderr'

CHECK = 'ROS_PYTHON_CHECK_FIELDS'

SETTINGS = {
    **FAST_DDS,
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    # Without this check an int in a field of type double is sent as a wrong number.
    CHECK: '1',
    'PYTHONUNBUFFERED': '1',
}

BLOCKED = re.compile(
    r'Timeout \(.*\)!\nThread \S+ \(most recent call first\):\n'
    r'  File ".*/rclpy/node\.py", line \d+ in destroy_node\n'
)
"""What a node of this package prints if Fast DDS blocks while it ends."""


class GraphProcesses:
    """Processes in a ROS domain of their own; a context manager that checks how they end.

    The environment variables are in addition to `SETTINGS` or instead of them.  With ROS_DOMAIN_ID
    the graph joins that domain and claims none.  `failed` says whether the test has failed; then
    the exit codes do not matter.
    """

    opened: ClassVar[list[GraphProcesses]] = []
    """All that are open, for the report of a failed test."""

    def __init__(self, **environment: str) -> None:
        self._settings = SETTINGS | environment

    def __enter__(self) -> Any:
        self._ending = ExitStack()
        if 'ROS_DOMAIN_ID' not in self._settings:
            self._settings['ROS_DOMAIN_ID'] = str(self._ending.enter_context(claim()))
        self.failed = False
        self.domain = int(self._settings['ROS_DOMAIN_ID'])
        self._folder = Path(self._ending.enter_context(tempfile.TemporaryDirectory()))
        self._settings['ROS_LOG_DIR'] = str(self._folder)
        self._ending.enter_context(applied(self._settings))
        self._mark = uuid.uuid4().hex
        self._children = Processes()
        self._exit_codes: dict[Process, Sequence[int]] = {}
        self._awaited: set[Process] = set()
        # Processes whose end has failed a wait already.
        self._reported: set[Process] = set()
        self.opened.append(self)
        self._ending.callback(self.opened.remove, self)
        return self

    def __exit__(self, fault: type[BaseException] | None, *_: object) -> None:
        __tracebackhide__ = True
        running = [process for process in self._started if process.poll() is None]
        killed = self._children.stop(signal.SIGINT, DEADLINE)
        left = self.alive()
        survivors = [process.pid for process in (*killed, *left)]
        faults = [f'process {pid} survived its end by SIGINT' for pid in survivors]
        for process in left:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        wrong = [p for p in running if p.returncode not in self._exit_codes[p]]
        psutil.wait_procs(left, DEADLINE)
        excused = [p for p in wrong if blocked(p.returncode, self.output(p)[1])]
        faults += [
            f'{self._name(process)}, exit code {process.returncode} after SIGINT: expected '
            f'{" or ".join(map(str, self._exit_codes[process]))}' for process in wrong
            if process not in excused
        ]
        faults += [
            f'{self._name(process)} ended by itself, exit code {process.returncode}'
            for process in self._started
            if process not in self._awaited.union(self._reported, running)
            and process.returncode not in self._exit_codes[process]
        ]
        report = '\n'.join(f'--- {title}\n{text}' for title, text in self.report())
        self._ending.close()
        if fault is not None:
            print(report, file=sys.stderr)
        elif faults and not self.failed:
            raise AssertionError('\n'.join([*faults, report]))
        elif excused:
            _excuse()

    @property
    def _started(self) -> list[Process]:
        return [*self._children.running.values()]

    def start(
        self, name: str, *arguments: str, exit_codes: Sequence[int] = (0,), **options: Any
    ) -> Process:
        """Start a process, see `executable`, in a process group of its own.

        The exit codes are those that are right at the end of the test, where each process gets
        SIGINT, and before it, unless the test ends the process.  The options are those of
        `subprocess.Popen`.
        """
        with ExitStack() as files:
            streams = {
                stream: files.enter_context(self._log(len(self._started), stream).open('wb'))
                for stream in STREAMS if stream not in options
            }
            process = self._children.start(
                str(len(self._started)), [*executable(name), *arguments],
                env=os.environ | self._settings | {MARK: self._mark}, **streams, **options,
            )
        self._exit_codes[process] = exit_codes
        return process

    def output(self, process: Process) -> tuple[str, str]:
        """Return what a process has written so far to standard output and to standard error."""
        logs = [self._log(self._started.index(process), stream) for stream in STREAMS]
        out, err = (log.read_text('utf-8', 'replace') if log.exists() else '' for log in logs)
        return out, err

    def end(self, process: Process, number: int) -> tuple[str, str]:
        """Send a signal to a process and wait until it ends; return its output."""
        process.send_signal(number)
        return self.outlive(process)

    def outlive(self, process: Process, deadline: float = DEADLINE) -> tuple[str, str]:
        """Wait until a process ends by itself; return its output.

        Raises an AssertionError if that does not happen by the deadline [s].  If Fast DDS blocks
        at the end of one of our nodes, the test counts as an expected failure.
        """
        __tracebackhide__ = True
        limit = Deadline(deadline)
        self._awaited.add(process)
        while process.poll() is None and not limit.passed():
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.1)
        late = process.poll() is None
        if late:
            # The executables of this package print their tracebacks.
            process.send_signal(signal.SIGUSR1)
            with suppress(subprocess.TimeoutExpired):
                process.wait(2.0)
            process.kill()
            process.wait()
        out, err = self.output(process)
        if late:
            raise AssertionError(f'{self._name(process)}: not ended in {deadline:g} s: {err}')
        if blocked(process.returncode, err):
            _excuse()
        return out, err

    def alive(self) -> list[psutil.Process]:
        """Return the processes that run, and those that they have started."""
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.environ().get(MARK) == self._mark:
                    found.append(process)
        return found

    def ended(self) -> list[str]:
        """Return the last words of the processes that ended while the test did not expect it."""
        codes = {process: process.poll() for process in self._started}
        found = [p for p, code in codes.items() if code is not None and p not in self._awaited]
        self._reported.update(found)
        return [
            f'{self._name(process)}, exit code {process.returncode}: {self._tail(process, 3)}'
            for process in found
        ]

    def report(self) -> list[tuple[str, str]]:
        """Return the output of each process, as pairs of a title and a text."""
        codes = [process.poll() for process in self._started]
        states = ['running' if code is None else f'exit code {code}' for code in codes]
        return [
            (f'{self._name(process)}, {state}', self._tail(process, LINES) or 'no output')
            for process, state in zip(self._started, states, strict=True)
        ]

    def _name(self, process: Process) -> str:
        program, *arguments = (Path(word).name for word in cast('list[str]', process.args))
        script = arguments[:1] if program.startswith('python') or program == 'ca_ros' else []
        return ' '.join([program, *script, str(process.pid)])

    def _log(self, number: int, stream: str) -> Path:
        return self._folder / f'{number}.{stream}'

    def _tail(self, process: Process, lines: int) -> str:
        return '\n'.join(''.join(self.output(process)).splitlines()[-lines:])


def executable(name: str) -> list[str]:
    """Return the words that start an executable: of this package, of another ROS package, a path.

    A name with a slash is a path, and not looked for.  Where pip has installed this package, the
    words are those of the command ``ca_ros NAME``.  Raises a FileNotFoundError without one.
    """
    libraries = [
        Path(prefix, 'lib') for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
        if prefix]
    others = [package for library in libraries for package in library.glob('*')]
    scripts, path = sysconfig.get_path('scripts'), os.environ.get('PATH', os.defpath)
    if found := _which(name, [library / 'ca_ros' for library in libraries]):
        return [found]
    if name in COMMANDS and (found := _which('ca_ros', [scripts, path])):
        return [found, name]
    if found := _which(name, [scripts, *others, path]):
        return [found]
    raise FileNotFoundError(f"no executable '{name}': is its package installed, or sourced?")


def _which(name: str, places: Iterable[str | Path]) -> str | None:
    return shutil.which(name, path=os.pathsep.join(map(str, places)))


@contextmanager
def applied(settings: Mapping[str, str]) -> Iterator[None]:
    """Apply environment variables, also in the message modules, which read `CHECK` at import."""
    import pytest

    with pytest.MonkeyPatch.context() as changes:
        for name, value in settings.items():
            changes.setenv(name, value)
        for module in [*sys.modules.values()]:
            if CHECK.lower() in getattr(module, '__dict__', {}):
                changes.setattr(module, CHECK.lower(), settings[CHECK])
        yield


def blocked(exit_code: int, err: str) -> bool:
    """Return whether Fast DDS blocked at the end of a node, after its last command."""
    return exit_code == 1 and bool(BLOCKED.search(err))


def _excuse() -> None:
    """End a test as an expected failure."""
    import pytest

    pytest.xfail('Fast DDS blocked at the end of a node, after its last command: issue 6513')
