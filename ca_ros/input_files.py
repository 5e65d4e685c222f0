"""The files that users give: one bound of their size, and one line for what is wrong with them."""

import os
from io import BytesIO, TextIOWrapper
from pathlib import Path
from stat import S_ISREG

from ca_ros.errors import message
from ca_ros.settings import ParameterError

SIZE_MAX = 10_000_000
"""Greatest size of a file; all that the package reads are far smaller [bytes]."""


def check_file(path: str | Path, most: int = SIZE_MAX) -> None:
    """Raise a ParameterError that names a file if it is none, or larger than `most` bytes."""
    os.close(_opened(path, most))


def read_text(
    path: str | Path, most: int = SIZE_MAX, encoding: str = 'utf-8', newline: str | None = None
) -> str:
    """Return the text of a file.

    Raises a ParameterError that names the file and the fault: it is not a file (of a pipe or a
    device, the end might never come), has more than `most` bytes, or is not readable text.

    `newline`: as of `open`.
    """
    with os.fdopen(_opened(path, most), 'rb') as file:
        try:
            # The file may have grown meanwhile.
            data = file.read(most)
            return TextIOWrapper(BytesIO(data), encoding, newline=newline).read()
        except OSError as error:
            raise ParameterError(message(error, path)) from None
        except UnicodeDecodeError as error:
            raise ParameterError(f'{path}: not readable text: {error}') from None


def _opened(path: str | Path, most: int) -> int:
    """Return the descriptor of an open file."""
    try:
        # Without O_NONBLOCK this waits for the other end of a pipe.
        opened = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except (OSError, ValueError) as error:
        raise ParameterError(message(error, path)) from None
    status, fault = os.fstat(opened), ''
    if not S_ISREG(status.st_mode):
        fault = 'expected a file, got a folder, a pipe or a device'
    elif status.st_size > most:
        fault = f'{status.st_size / 1e6:.3g} MB: expected at most {most / 1e6:g} MB'
    if fault:
        os.close(opened)
        raise ParameterError(f'{path}: {fault}')
    return opened
