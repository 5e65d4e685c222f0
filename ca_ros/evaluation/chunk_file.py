"""The file of finished chunks, named after all that their results depend on."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from inspect import getsource
from pathlib import Path
from typing import Any

from ca_ros.allocation.own_method import own_class
from ca_ros.errors import CaRosError
from ca_ros.evaluation.environment import versions
from ca_ros.kernel import chosen

SOURCES = ('.py', '.c', '.h')


class ChunkError(CaRosError):
    """The chunks of a study cannot be computed here."""


class ChunkFile:
    """The results of the finished chunks of a study, in a folder.

    The name has a digest of the study's inputs and of the code, so another study has another
    file.  The first line has the inputs, each other line the number and the result of a chunk.

    Parameters
    ----------
    folder : Path
    inputs : mapping
        All on which the results depend, apart from code.
    methods : sequence of str
        Methods of the user's own, ``module:Class``, on whose code the results depend too.

    Attributes
    ----------
    code : dict
        See the function `code`.
    """

    def __init__(
        self, folder: Path, inputs: Mapping[str, Any], methods: Sequence[str] = ()
    ) -> None:
        self.code = code(*methods)
        self._head = json.dumps({**inputs, 'code': self.code}) + '\n'
        digest = sha256(self._head.encode()).hexdigest()
        self.path = folder / f'chunks-{digest[:12]}.jsonl'

    def read(self) -> dict[int, Any]:
        """Return the results by number; damaged lines, as one cut off by a kill, are removed."""
        text = self.path.read_bytes() if self.path.exists() else b''
        head, *lines = text.splitlines(keepends=True) or [b'']
        whole, found = [self._head.encode()], {}
        for line in lines if head == whole[0] else []:
            with suppress(ValueError, TypeError):
                number, result = json.loads(line)
                if line.endswith(b'\n'):
                    whole.append(line)
                    found[number] = result
        if b''.join(whole) != text:
            self.path.write_bytes(b''.join(whole))
        return found

    def append(self, number: int, result: Any) -> None:
        """Add the result of a chunk."""
        with self.path.open('a', encoding='utf-8') as file:
            file.write(json.dumps([number, result]) + '\n')

    def conclude(self, done: int, total: int, what: str) -> None:
        """Remove the file of a study that is complete; otherwise raise a KeyboardInterrupt."""
        if done < total:
            written = ', which are written' if done else ''
            raise KeyboardInterrupt(
                f' after {done} of {total} {what}{written}; the same command continues'
            )
        self.path.unlink(missing_ok=True)


def code(*methods: str) -> dict[str, str]:
    """Return what identifies the code on which digits depend: digests, kernel, versions.

    The methods are the user's own, ``module:Class``.
    """
    return {**_code(), **{method: _source(method) for method in methods}}


@cache
def _source(method: str) -> str:
    """Return a digest of the module of a method as it was when this process imported it."""
    try:
        module = sys.modules[own_class(method).__module__]
    except ValueError as error:
        raise ChunkError(str(error)) from None
    return sha256(getsource(module).encode()).hexdigest()


@cache
def _code() -> dict[str, str]:
    digest, package = sha256(), Path(__file__).parents[1]
    for path in sorted(package.rglob('*')):
        if path.suffix in SOURCES:
            digest.update(path.read_bytes())
    installed = versions()
    return {
        'ca_ros': digest.hexdigest(),
        'kernel': 'NumPy' if chosen(1, 1) is None else 'C',
        **{name: installed[name] for name in ('numpy', 'scipy', 'osqp')},
    }
