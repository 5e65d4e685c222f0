"""Child processes that are started together, watched and stopped together."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress


class Processes:
    """Named child processes, each in a group of its own: Ctrl-C reaches the parent alone.

    Parameters
    ----------
    commands : mapping of str to sequence of str
        Command lines by name, in the order in which they are started, and stopped.
    """

    PATIENCE = 5.0
    """Time that a process has to end after SIGTERM before it is killed [s]."""

    def __init__(
        self, commands: Mapping[str, Sequence[str]], environment: Mapping[str, str] | None = None
    ) -> None:
        self.commands = commands
        self.environment = {**os.environ, **(environment or {})}
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Processes:
        try:
            for name, command in self.commands.items():
                self.running[name] = subprocess.Popen(
                    command, env=self.environment, stdin=subprocess.DEVNULL, start_new_session=True
                )
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

    def stop(self) -> None:
        """End them one after the other, and whatever they started."""
        for name, process in self.running.items():
            if process.poll() is None:
                # Python answers SIGINT with a traceback as long as it is still importing.
                process.terminate()
                try:
                    process.wait(self.PATIENCE)
                except subprocess.TimeoutExpired:
                    print(
                        f'{name} did not end within {self.PATIENCE:g} s and is killed',
                        file=sys.stderr,
                    )
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
