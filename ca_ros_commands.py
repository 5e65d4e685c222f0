"""The entry points of the executables, in a module beside the package.

The import of the package takes up to a second.  Ctrl-C in that second ends a command without a
traceback, as it does later.
"""

import signal
import sys
from functools import partial


def run(command: str) -> int | None:
    """Run a command of `ca_ros.commands`; return its exit code."""
    try:
        from ca_ros import commands

        return commands.run(command)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT


def __getattr__(command: str) -> partial[int | None]:
    """Return the function that runs a command, under the name of the command."""
    if command.startswith('_'):
        raise AttributeError(command)
    return partial(run, command)


if __name__ == '__main__':
    # `bringup` starts the nodes in this way; the command reads the arguments after its name.
    raise SystemExit(run(sys.argv.pop(1)))
