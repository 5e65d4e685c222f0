"""Child processes that are started together, watched, started again and stopped together."""

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
from math import inf
from typing import Any

from ca_ros.signals import ending_signals

PR_SET_PDEATHSIG = 1
"""From <sys/prctl.h>."""


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a child process in a session of its own; it gets SIGTERM when this process ends.

    That holds however this process ends, be it by kill -9, and also while the child still starts.
    Linux sends the signal when the calling thread ends, so call this from the main thread.

    Parameters
    ----------
    command : sequence of str
    **options
        As for `subprocess.Popen`.
    """
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def end_with_parent() -> None:
        # A handler of the parent would take the signal and be gone with its program.
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
    """Return a list in which signals to end are noted from now on: the children end first."""
    received: list[int] = []
    for number in ending_signals():
        signal.signal(number, lambda signalled, _: received.append(signalled))
    return received


class Processes:
    """Named child processes, each in a group of its own: Ctrl-C reaches the parent alone.

    They get SIGTERM when the parent ends without stopping them.

    Parameters
    ----------
    commands : mapping of str to sequence of str
        Command lines by name, in the order in which they are started.
    """

    PATIENCE = 5.0
    """Time that a process has to end after SIGTERM before it is killed [s]."""

    PAUSE = 0.5
    """Time after which one that has ended is started again [s]."""

    STARTING = 10.0
    """Time within which an end, other than on demand, is held to be a failed start [s]."""

    ATTEMPTS = 3
    """Failed starts in a row, after which there is no hope."""

    def __init__(
        self, commands: Mapping[str, Sequence[str]], environment: Mapping[str, str] | None = None
    ) -> None:
        self.commands = commands
        self.environment = {**os.environ, **(environment or {})}
        self.running: dict[str, subprocess.Popen[Any]] = {}
        self.respawned: Counter[str] = Counter()
        self._started: dict[str, float] = {}
        self._ended: dict[str, float] = {}
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
        """Return the exit codes of those that have ended, by name."""
        codes = {name: process.poll() for name, process in self.running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def hopeless(self) -> list[str]:
        """Return those that have ended again and again at their start."""
        self._note()
        return [name for name, count in self._failures.items() if count >= self.ATTEMPTS]

    def respawn(self) -> dict[str, int]:
        """Start again those that ended a while ago; return their exit codes, by name."""
        self._note()
        before = time.monotonic() - self.PAUSE
        # What ends only now is not noted yet.
        codes = {
            name: code
            for name, code in self.ended().items()
            if self._ended.get(name, inf) <= before
        }
        for name in codes:
            self._kill(name)
            self._start(name)
            self.respawned[name] += 1
        return codes

    def _note(self) -> None:
        """Judge the ends that are new."""
        now = time.monotonic()
        for name, code in self.ended().items():
            if name not in self._ended:
                self._ended[name] = now
                failed = now - self._started[name] < self.STARTING
                on_demand = code in (0, -signal.SIGKILL)
                self._failures[name] = self._failures[name] + 1 if failed and not on_demand else 0

    def _start(self, name: str) -> None:
        self.running[name] = start(self.commands[name], env=self.environment)
        self._started[name] = time.monotonic()
        self._ended.pop(name, None)

    def _kill(self, name: str) -> None:
        """Kill what is left of one, and of what it started."""
        with suppress(ProcessLookupError):
            os.killpg(self.running[name].pid, signal.SIGKILL)
        self.running[name].wait()

    def restart(self, name: str) -> None:
        """End one and start it again."""
        self._end(name)
        self._start(name)

    def stop(self) -> None:
        """End them all at once, lest one miss the other, and whatever they started."""
        self._end(*self.running)

    def _end(self, *names: str) -> None:
        for name in names:
            if self.running[name].poll() is None:
                # Python answers SIGINT with a traceback as long as it is still importing.
                self.running[name].terminate()
        for name in names:
            try:
                self.running[name].wait(self.PATIENCE)
            except subprocess.TimeoutExpired:
                print(
                    f'{name} did not end within {self.PATIENCE:g} s and is killed',
                    file=sys.stderr,
                )
            self._kill(name)
