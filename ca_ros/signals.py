"""The signals that ask a process to end."""

from __future__ import annotations

import signal


def ending_signals() -> list[int]:
    """Return the signals that ask a process to end; SIGHUP not if it is ignored, as by nohup."""
    hang_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGINT, signal.SIGTERM, *hang_up]
