"""The array types of the package's signatures, and read-only arrays."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int8]


def constant(values: ArrayLike) -> Array:
    """Return a copy of an array that cannot be written to."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def is_constant(array: Array) -> bool:
    """Return whether an array has data of its own that cannot be written to."""
    return array.base is None and not array.flags.writeable
