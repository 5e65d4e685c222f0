"""Child processes: start, watch, restart and stop; a deadline for what waits for them."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from ca_ros.nodes.console import ending_signals

PR_SET_PDEATHSIG = 1  # from <sys/prctl.h>

FAST_DDS = {
    # Shared memory of killed processes would delay later starts by seconds.
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
    # Announcements every 0.2 s instead of 3 s: a start takes 3 s instead of 5 s.
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(Path(__file__).with_name('discovery.xml')),
}
"""The settings of Fast DDS, as environment variables, for processes that start together."""

Process = subprocess.Popen[Any]


def start(command: Sequence[str], **options: Any) -> Process:
    """Start a child process in a session of its own; it gets SIGTERM when this process ends.

    The signal is sent for every end of this process, also by kill -9 or while the child starts.
    Linux sends it when the calling thread ends, so call this function from the main thread.  The
    options are those of `subprocess.Popen`.
    """
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def end_with_parent() -> None:
        # The handler of the parent, which the child inherits, would ignore the signal.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        # The parent may have ended before the call of prctl.
        if os.getppid() != parent:
            signal.raise_signal(signal.SIGTERM)

    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=end_with_parent,
        **options,
    )


def end(processes: Sequence[Process], number: int, patience: float) -> list[Process]:
    """End processes of `start` with their descendants; return those that had to be killed.

    Each group gets the signal, since a wrapper such as `ros2 run` does not pass it on.  Python
    answers SIGINT with a traceback while it imports, so SIGTERM is the better one.  What still
    runs after `patience` [s] is killed, with a line on standard error.
    """
    running = [process for process in processes if process.poll() is None]
    for process in running:
        os.killpg(process.pid, number)
    deadline, late = time.monotonic() + patience, []
    for process in processes:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            late.append(process)
            words = ' '.join(map(str, cast('list[str]', process.args)))
            print(
                f'killed, as it did not end within {patience:g} s: {words.splitlines()[0]}',
                file=sys.stderr,
            )
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return late


def note_signals() -> list[int]:
    """Append the ending signals to a list instead of ending, and return this list."""
    received: list[int] = []
    for number in ending_signals():
        signal.signal(number, lambda signalled, _: received.append(signalled))
    return received


class Processes:
    """Named child processes, each in its own process group: Ctrl-C reaches only the parent.

    `__enter__` starts the commands, by name, in their order.  `respawned` counts the restarts of
    each process by `respawn`.
    """

    ENDING = 5.0
    """Time after SIGTERM after which a process is killed [s]."""

    STARTING = 10.0
    """A process that ends within this time of its start has failed to start [s]."""

    ATTEMPTS = 3
    """Failed starts in a row after which `respawn` gives a process up."""

    def __init__(self, commands: Mapping[str, Sequence[str]] | None = None) -> None:
        self.commands = commands or {}
        self.running: dict[str, Process] = {}
        self.respawned: Counter[str] = Counter()
        self._started: dict[str, float] = {}
        self._failures: Counter[str] = Counter()

    def __enter__(self) -> Processes:
        try:
            for name, command in self.commands.items():
                self.start(name, command)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, command: Sequence[str], **options: Any) -> Process:
        """Start a process under a name; see the function `start`."""
        self.running[name] = start(command, **options)
        self._started[name] = time.monotonic()
        return self.running[name]

    def ended(self) -> dict[str, int]:
        """Return the exit codes of the processes that have ended, by name."""
        codes = {name: process.poll() for name, process in self.running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def respawn(self) -> dict[str, int]:
        """Restart the processes that have ended; return their exit codes by name.

        A process that fails `ATTEMPTS` times in a row at its start is not restarted again.
        """
        restarted = {}
        for name, code in self.ended().items():
            # Exit code 0 and kill -9 are requests to end, not failures.
            failed = code not in (0, -signal.SIGKILL)
            early = time.monotonic() - self._started[name] < self.STARTING
            self._failures[name] = self._failures[name] + 1 if failed and early else 0
            if self._failures[name] < self.ATTEMPTS:
                self.restart(name)
                self.respawned[name] += 1
                restarted[name] = code
        return restarted

    def restart(self, name: str) -> None:
        """End a process with its descendants, and start it again."""
        end([self.running[name]], signal.SIGTERM, self.ENDING)
        self.start(name, self.commands[name])

    def stop(self, number: int = signal.SIGTERM, patience: float = ENDING) -> list[Process]:
        """End all processes at once; return those that had to be killed, see `end`."""
        return end(list(self.running.values()), number, patience)


class Deadline:
    """A time limit for a loop that polls; at most `POLL` of the time between two polls counts.

    A stall of the machine also stalls the process that the loop waits for, so it must not use up
    the time limit [s].
    """

    POLL = 0.5
    """Longest time between two polls that counts [s]."""

    def __init__(self, limit: float) -> None:
        self._left = limit
        self._polled = time.monotonic()

    def passed(self) -> bool:
        """Poll: return whether the deadline has passed."""
        now = time.monotonic()
        self._left -= min(now - self._polled, self.POLL)
        self._polled = now
        return self._left < 0.0
