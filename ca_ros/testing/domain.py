"""A ROS domain that nothing else on the machine uses."""

import fcntl
import random
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

DOMAINS = range(1, 102)  # those with ports on every machine, without ROS's default
FIRST_PORT, PORTS = 7400, 250  # of domain d: FIRST_PORT + PORTS d (DDSI-RTPS 2.5, 9.6.1.1)


def claim() -> tuple[int, IO[str]]:
    """Claim a domain; return its number, and the lock file: closing it releases the domain.

    Raises a RuntimeError if all domains are in use.
    """
    free = [*{*DOMAINS} - used()]
    for domain in random.sample(free, len(free)):
        path = Path(tempfile.gettempdir(), f'ca_ros_domain_{domain}')
        try:
            # The file of another user cannot be written, but read and locked.
            with suppress(PermissionError):
                path.touch()
            lock = path.open()
        except PermissionError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            return domain, lock
    raise RuntimeError(f'no free ROS domain: all {len(DOMAINS)} are in use')


def used() -> set[int]:
    """Return the domains of which a process has a port, a running robot for instance."""
    found = set()
    for table in filter(Path.exists, (Path('/proc/net/udp'), Path('/proc/net/udp6'))):
        for line in table.read_text().splitlines()[1:]:
            _, address, *_ = line.split()
            found.add((int(address.rpartition(':')[2], 16) - FIRST_PORT) // PORTS)
    return found
