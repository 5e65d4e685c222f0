"""A ROS domain that no other test on the machine uses."""

from __future__ import annotations

import fcntl
import random
import tempfile
from pathlib import Path
from typing import IO

DOMAINS = range(1, 102)
"""The domains for which DDS has ports on every machine, without 0, the default of ROS."""


def claim() -> tuple[int, IO[str]]:
    """Claim a domain; return its number, and the lock file: closing it releases the domain.

    Raises
    ------
    RuntimeError
        If other tests have claimed all domains.
    """
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        path = Path(tempfile.gettempdir(), f'ca_ros_domain_{domain}')
        try:
            path.touch()
            lock = path.open()
        except PermissionError:
            # The file of another user.
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            return domain, lock
    raise RuntimeError(f'no free ROS domain: tests have claimed all {len(DOMAINS)}')
