"""What nodes publish on /diagnostics."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray


class Status(NamedTuple):
    """A diagnostic status of a node."""

    level: bytes
    message: str
    values: dict[str, str]


def statuses(arrays: Iterable[DiagnosticArray], node: str) -> list[Status]:
    """Return all statuses of a node in messages, or those of one subject, ``'node: subject'``."""
    return [
        Status(status.level, status.message, {pair.key: pair.value for pair in status.values})
        for array in arrays for status in array.status
        if f'{status.name}: '.startswith(f'{node.lstrip("/")}: ')
    ]


def counts(values: Mapping[str, str]) -> Counter[str]:
    """Return the values of a status that are counts; a count that is absent is zero."""
    return Counter(
        {key: int(value) for key, value in values.items() if value.isdigit() and '[' not in key}
    )
