"""Standard streams that never block a node, and the signals that end it."""

import os
import signal
import stat
import sys
from contextlib import suppress


def replace_closed() -> None:
    """Open /dev/null in place of standard streams that are closed.

    Otherwise the next file or socket takes the number of the stream, and output to the stream
    ends up in that file or socket.
    """
    opened = os.open(os.devnull, os.O_RDWR)
    while opened <= 2:
        opened = os.dup(opened)
    os.close(opened)
    for stream, name in enumerate(('stdin', 'stdout', 'stderr')):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(stream, 'w' if stream else 'r', encoding='utf-8'))


def never_wait() -> None:
    """Make standard output and error non-blocking: output that does not fit is lost.

    Otherwise a stopped terminal, a full pipe or a blocked journal would block a node at its next
    log message.  Each log message is also on /rosout and in ROS's log file.
    """
    for stream in (1, 2):
        # Closed streams need nothing; a stream of another user cannot be reopened.
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(stream).st_mode):
                os.set_blocking(stream, False)
            elif os.isatty(stream) or stat.S_ISFIFO(os.fstat(stream).st_mode):
                # Opening it again leaves the stream of other processes blocking.
                own = os.open(f'/proc/self/fd/{stream}', os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
                os.dup2(own, stream)
                os.close(own)


def ending_signals() -> list[int]:
    """Return SIGINT, SIGTERM and, unless it is ignored (nohup), SIGHUP."""
    hang_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hang_up]
