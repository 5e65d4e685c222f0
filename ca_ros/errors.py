"""The base class of the package's errors, and their messages."""

from collections.abc import Iterable
from difflib import get_close_matches
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


def suggestion(word: Any, known: Iterable[str]) -> str:
    """Return a question for the known word that is most like a wrong one; '' if none is.

    A word may also stand for the first letters of the parts of another: wls.
    """
    if not isinstance(word, str):
        return ''
    given = word.lower().replace('-', '_')
    words = {each.lower(): each for each in known}
    short = [each for each in words if ''.join(part[:1] for part in each.split('_')) == given]
    near = get_close_matches(given, words, 1) or short or [
        each for each in words if given in (each.replace('_', ''), each.replace('_', '')[:-1])]
    return f'; did you mean {words[near[0]]}?' if near else ''


def shortened(value: Any) -> str:
    """Return the repr of a value, cut to one line."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        # For example an integer with thousands of digits.
        return f'a value of type {type(value).__name__} that is too long'
    return text if len(text) <= 80 else f'{text[:80]}...'
