"""A console that nobody reads must not hold up the motors."""

from __future__ import annotations

import os
import stat
import sys
from contextlib import suppress

STREAMS = (1, 2)
"""Standard output and standard error."""


def replace_closed() -> None:
    """Open /dev/null in place of standard streams that are closed.

    Otherwise the next file or socket that is opened takes the number of the stream, and what is
    written to the stream ends up in there.
    """
    opened = os.open(os.devnull, os.O_RDWR)
    while opened <= max(STREAMS):
        opened = os.dup(opened)
    os.close(opened)
    for stream, name in enumerate(('stdin', 'stdout', 'stderr')):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(stream, 'w' if stream else 'r', encoding='utf-8'))


def never_wait() -> None:
    """Lose what the console cannot take at once, rather than wait for it.

    A terminal that is stopped, a pipe that is full or a journal that hangs would otherwise hold up
    a node in the middle of its next log message.  That is still on /rosout and in ROS's log file.
    """
    for stream in STREAMS:
        # One that is closed takes everything, one of another user stays as it is.
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(stream).st_mode):
                os.set_blocking(stream, False)
            elif os.isatty(stream) or stat.S_ISFIFO(os.fstat(stream).st_mode):
                # Whoever else writes to it goes on to wait, which only opening it anew leaves be.
                own = os.open(f'/proc/self/fd/{stream}', os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
                os.dup2(own, stream)
                os.close(own)
