"""Child processes: start, watch, restart and stop."""

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
from typing import Any

from ca_ros.signals import ending_signals

PR_SET_PDEATHSIG = 1
"""From <sys/prctl.h>."""


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a child process in a session of its own; it gets SIGTERM when this process ends.

    The signal is sent for every end of this process, also by kill -9 or while the child starts.
    Linux sends it when the calling thread ends, so call this function from the main thread.

    Parameters
    ----------
    command : sequence of str
    **options
        As for `subprocess.Popen`.
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
        command,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=end_with_parent,
        **options,
    )


def note_signals() -> list[int]:
    """Append the ending signals to a list instead of ending, and return this list."""
    received: list[int] = []
    for number in ending_signals():
        signal.signal(number, lambda signalled, _: received.append(signalled))
    return received


class Processes:
    """Named child processes, each in its own process group: Ctrl-C reaches only the parent.

    Parameters
    ----------
    commands : mapping of str to sequence of str
        Command lines by name, in the order of their start.

    Attributes
    ----------
    running : dict of str to Popen
    respawned : Counter of str
        Number of restarts of each process by `respawn`.
    """

    ENDING = 5.0
    """Time after SIGTERM after which a process is killed [s]."""

    STARTING = 10.0
    """A process that ends within this time of its start has failed to start [s]."""

    ATTEMPTS = 3
    """Failed starts in a row after which `respawn` gives a process up."""

    def __init__(self, commands: Mapping[str, Sequence[str]]) -> None:
        self.commands = commands
        self.running: dict[str, subprocess.Popen[Any]] = {}
        self.respawned: Counter[str] = Counter()
        self._started: dict[str, float] = {}
        self._failures: Counter[str] = Counter()

    def __enter__(self) -> Processes:
        try:
            for name in self.commands:
                self._start(name)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

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
        self._end(name)
        self._start(name)

    def stop(self) -> None:
        """End all processes at once, with their descendants."""
        self._end(*self.running)

    def _start(self, name: str) -> None:
        self.running[name] = start(self.commands[name])
        self._started[name] = time.monotonic()

    def _end(self, *names: str) -> None:
        for name in names:
            if self.running[name].poll() is None:
                # SIGTERM: Python answers SIGINT with a traceback while it imports.  A wrapper
                # such as `ros2 run` does not pass it on, so the group gets it.
                os.killpg(self.running[name].pid, signal.SIGTERM)
        for name in names:
            process = self.running[name]
            try:
                process.wait(self.ENDING)
            except subprocess.TimeoutExpired:
                print(
                    f'{name} did not end within {self.ENDING:g} s and is killed', file=sys.stderr
                )
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
