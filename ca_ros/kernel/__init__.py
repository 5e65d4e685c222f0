"""The exact allocator in C, as extension modules that may be missing.

The library is a stair of headers: `problem.h`, `least_norm.h`, `priorities.h`, and the public
`exact.h`, each with what it needs; `numbers.h` has small functions.  `module.c` binds it.
It is built for double and for single precision.  A third module, of double precision, is for
exactly four axes, and faster; it gives the same bits.  `CA_ROS_KERNEL=numpy` in the environment
chooses the NumPy implementation instead, and `CA_ROS_KERNEL=c` makes a missing extension an error.
"""

import warnings
from functools import cache
from importlib import import_module
from os import environ
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ca_ros.arrays import Array, IntArray

ROTORS_MAX = 32  # greatest number of rotors of the extension modules

AXES_MAX = 6

FOUR = 4  # number of axes of the extension module for exactly four
NOT_BUILT = (
    'the kernel in C was not built: install gcc and the headers of Python '
    '(apt: gcc python3-dev), then ca_ros again'
)

INVALID = 5  # the status of a wrench that is not finite


class Kernel(Protocol):
    """The exact allocator for one problem; arrays are contiguous, of its precision."""

    def __init__(
        self, gamma: Array, lower: Array, upper: Array, reference: Array, **options: Any
    ) -> None:
        """`options` are those of ``Kernel(...)`` in ``module.c``, fields of ``ca_options``."""

    def allocate(
        self, u: Array, demand: Array, thrusts: Array, *bounds: Array
    ) -> tuple[int, float] | None:
        """Copy u (m,) to `demand` (m,), and write its thrusts (n,).

        `bounds` are narrower bounds of this call, (n,) each.  The result: none for an exact
        answer; otherwise the status and the level.
        """

    def allocate_batch(
        self, wrenches: Array, thrusts: Array, status: IntArray, levels: Array,
        work: NDArray[np.int32] | None,
    ) -> None:
        """Write thrusts (N, n), status (N,) and levels (N,) for wrenches (N, m).

        `work` (N, 2), int32, gets the numbers of steps and pivots.  Other threads run meanwhile.
        """

    def explain(
        self, u: Array, thrusts: Array, numbers: Array, names: NDArray[np.int32], *bounds: Array
    ) -> float:
        """Write why thrusts (n,) are the answer to u (m,); return the margin of u.

        `numbers` and `names` are flat; `ca_ros.problem.limits.Limits.of` takes them in their
        shapes, (m, 3 + n) and (m + 1, 1 + n).
        """

    def margin(self, u: Array) -> float:
        """Return the signed distance of u (m,) to the boundary of the admissible set."""

    def fields(self) -> dict[str, tuple[str, str, list[float]]]:
        """Return the fields of `ca_problem` in C: type, dimensions and numbers by name."""


def load(name: str = 'double') -> type[Kernel] | None:
    """Return the class of an extension module; None if it cannot be imported.

    `name` ('double', 'single' or 'double_4'): the precision; 'double_4' is for exactly four axes.
    """
    return getattr(extension(name), 'Kernel', None)


def extension(name: str) -> Any:
    """Return an extension module of this package by its name; None if it is not built."""
    try:
        return import_module(f'ca_ros.kernel._{name}')
    except ImportError:
        return None


def chosen(n: int, m: int) -> type[Kernel] | None:
    """Return the kernel for n rotors and m axes; None if NumPy is to do its work.

    Raises a ValueError if the variable CA_ROS_KERNEL is wrong, or names a kernel that is not
    installed.
    """
    wanted = environ.get('CA_ROS_KERNEL', '')
    if wanted not in ('', 'c', 'numpy'):
        raise ValueError(f'CA_ROS_KERNEL: expected c or numpy, got {wanted!r}')
    fits = n <= ROTORS_MAX and m <= AXES_MAX
    kernel = None
    if fits and wanted != 'numpy':
        kernel = load('double_4' if m == FOUR else 'double')
    if wanted == 'c' and kernel is None:
        raise ValueError(
            f'CA_ROS_KERNEL: {NOT_BUILT}'
            if fits
            else f'CA_ROS_KERNEL: the kernel is for up to {ROTORS_MAX} rotors and {AXES_MAX} '
            f'axes, got {n} and {m}'
        )
    return kernel


@cache
def warn_if_missing() -> None:
    """Warn, once in a process, that NumPy does the work because an installer built no kernel.

    pip hides what a build says, so the first use says it.
    """
    if load() is None and not environ.get('CA_ROS_KERNEL'):
        warnings.warn(
            f'exact runs in NumPy, ten to a thousand times as slowly; {NOT_BUILT}',
            RuntimeWarning, stacklevel=4)
