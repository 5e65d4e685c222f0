"""The array types of the package's signatures, and read-only arrays."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int8]

FLOAT = np.dtype(float)  # the one object that is the type of floats in this machine's byte order


def floats(values: ArrayLike) -> Array:
    """Return a copy of real numbers as floats.

    Raises a TypeError if they are strings, booleans, dates, complex numbers, objects or masked, or
    a ValueError if they have no shape.
    """
    array = np.array(values)
    # The usual case, without the checks that take as long as an allocation.
    if array.dtype is FLOAT and type(values) in (list, np.ndarray):
        return array
    if array.dtype.kind not in 'iuf' or isinstance(values, np.ma.MaskedArray):
        raise TypeError(f'expected real numbers, got {array.dtype}')
    return array.astype(float)


def constant(values: ArrayLike) -> Array:
    """Return a copy of an array that cannot be written to."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def is_constant(array: Array) -> bool:
    """Return whether an array has data of its own that cannot be written to."""
    return array.base is None and not array.flags.writeable


def same(one: Any, other: Any) -> bool:
    """Return whether values are equal: dataclasses field by field, arrays number by number."""
    if one is other:
        return True
    if is_dataclass(one):
        return type(one) is type(other) and all(
            same(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)
