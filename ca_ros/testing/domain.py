"""A ROS domain that nothing else on the machine uses."""

import random
from contextlib import AbstractContextManager
from pathlib import Path

from domain_coordinator import domain_id

DOMAINS = range(1, 101)  # those of `domain_coordinator`, without ROS's default
FIRST_PORT, PORTS = 7400, 250  # of domain d: FIRST_PORT + PORTS d (DDSI-RTPS 2.5, 9.6.1.1)


def claim() -> AbstractContextManager[int]:
    """Return a context manager with the number of a domain, which is claimed until its end.

    Tests of other packages that use `domain_coordinator` see the claim.  Raises a RuntimeError if
    no domain is free.
    """
    # A domain is not taken again soon: what a test has killed is seen in it for seconds.
    return domain_id(lambda: random.choice([*{*DOMAINS} - used()] or [*DOMAINS]))


def used() -> set[int]:
    """Return the domains of which a process has a port, a running robot for instance."""
    found = set()
    for table in filter(Path.exists, (Path('/proc/net/udp'), Path('/proc/net/udp6'))):
        for line in table.read_text().splitlines()[1:]:
            _, address, *_ = line.split()
            found.add((int(address.rpartition(':')[2], 16) - FIRST_PORT) // PORTS)
    return found
