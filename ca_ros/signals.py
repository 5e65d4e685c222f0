"""The signals that ask a process to end."""

from __future__ import annotations

import signal


def ending_signals() -> list[int]:
    """Return SIGINT, SIGTERM and, unless it is ignored (nohup), SIGHUP."""
    hang_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hang_up]
