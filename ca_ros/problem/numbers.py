"""Checks of the numbers and names that define a problem or an option."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array

ABSURD = 1e100
"""Greatest number that a wrench may have; larger ones are errors of the caller [N, N m]."""


def numbers(
    name: str, given: ArrayLike, size: int | None = None, scalar: bool = True
) -> Array:
    """Return finite numbers as an array; raise a ValueError that names them if they are wrong.

    Parameters
    ----------
    name : str
    given : array_like
    size : int, optional
        Expect (size,) numbers; without it, any shape.
    scalar : bool
        Whether one number may stand for all `size` numbers.
    """
    try:
        array = np.array(given)
    except (TypeError, ValueError):
        array = np.array('')
    if array.dtype.kind not in 'iuf':
        raise ValueError(f'{name}: expected numbers, got {given!r}')
    found: Array = array.astype(float)
    if size is not None:
        if found.shape != (size,) and not (scalar and found.ndim == 0):
            raise ValueError(f'{name}: expected {size} numbers, got shape {found.shape}')
        if found.ndim == 0:
            found = np.full(size, found)
    if not (np.abs(found) <= ABSURD).all():
        raise ValueError(f'{name}: expected finite numbers up to {ABSURD:g}, got {given!r}')
    return found


def different_names(name: str, given: Sequence[str], size: int) -> tuple[str, ...]:
    """Return names, as many as `size` and all different; else raise a ValueError."""
    listed = isinstance(given, (list, tuple)) and all(isinstance(each, str) for each in given)
    names = tuple(given) if listed else ()
    if len(names) != size or len(set(names)) < size:
        raise ValueError(f'{name}: expected {size} different names, got {given!r}')
    if not all(each and each.isprintable() for each in names):
        raise ValueError(f'{name}: expected names of printable characters, got {given!r}')
    return names
