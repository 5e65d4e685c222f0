"""The base class of the package's errors, and their messages."""

from pathlib import Path
from typing import Any


class CaRosError(Exception):
    """An error with a message of one line.

    Wrong arguments of functions raise a `ValueError`.  Wrong parameters raise a `ParameterError`,
    which is both.
    """


def message(error: Exception, file: str | Path | None = None) -> str:
    """Return the message of an error, with the name of its file and without an error number."""
    text = getattr(error, 'strerror', None) or str(error)
    name = getattr(error, 'filename', None) or file
    return f'{name}: {text}' if name else text


def shortened(value: Any) -> str:
    """Return the repr of a value, cut to one line."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        # For example an integer with thousands of digits.
        return f'a value of type {type(value).__name__} that is too long'
    return text if len(text) <= 80 else f'{text[:80]}...'
