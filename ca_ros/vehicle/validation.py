"""Checks of numbers and names that define a vehicle, a problem or an option."""

import warnings
from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, constant, floats
from ca_ros.settings import ParameterError

INERTIA_ROUNDING = 0.05  # how far a measured moment may exceed the sum of the others, a share
ABSURD = 1e100  # greatest number of a wrench; larger ones are the caller's error [N, N m]
WEIGHTS_MAX = 1e4  # greatest ratio of two weights


def numbers(name: str, given: ArrayLike, size: int | None = None) -> Array:
    """Return finite numbers as an array; raise a ValueError that names them if they are wrong.

    With a `size`, the array is (size,), and one number counts for all effectors.
    """
    try:
        array = floats(given)
    except (TypeError, ValueError):
        raise ValueError(f'{name}: expected numbers, got {given!r}') from None
    if not (np.abs(array) <= ABSURD).all():
        text = ' '.join(repr(given).split())
        raise ValueError(f'{name}: expected finite numbers up to {ABSURD:g}, got {text}')
    return array if size is None else repeated(name, array, size, 'effector')


def counts(number: object, most: float = inf) -> bool:
    """Tell whether a number is a whole one from 1 to `most`; True and False are none."""
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)):
        return False
    return bool(1 <= number <= most)


def health_of(name: str, health: ArrayLike, n: int, what: str = 'rotor') -> Array:
    """Return the share (n,) of its effect that each rotor or effector still has.

    Raises a ParameterError with the name if there is not one number in [0, 1] for each.
    """
    try:
        shares = floats(health)
    except (TypeError, ValueError):
        shares = np.array(np.nan)
    if shares.shape != (n,) or not ((shares >= 0.0) & (shares <= 1.0)).all():
        given = ' '.join(repr(health).split())
        raise ParameterError(
            f'{name}: expected {n} numbers in [0, 1], one for each {what}, got {given}')
    return shares


def repeated(name: str, value: ArrayLike, n: int, what: str = 'rotor') -> Array:
    """Return `Numbers` as a constant array (n,); one number counts for all.

    Raises a ParameterError if there is neither one number nor n numbers.
    """
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in ((), (1,), (n,)):
        size = numbers.size
        raise ParameterError(f'{name}: expected 1 or {n} numbers, one per {what}, got {size}')
    return constant(np.broadcast_to(numbers, (n,)))


def check_ratio(name: str, weights: ArrayLike) -> None:
    """Raise a `ParameterError` if a weight is more than `WEIGHTS_MAX` times another one."""
    if isinstance(weights, float):
        return
    least, greatest = float(np.min(weights)), float(np.max(weights))
    if greatest > WEIGHTS_MAX * least:
        raise ParameterError(
            f'{name}: {greatest:g} is more than {WEIGHTS_MAX:g} times {least:g}, too much for '
            'the digits of the thrusts'
        )


def different_names(name: str, given: Sequence[str], size: int) -> tuple[str, ...]:
    """Return names, as many as `size` and all different; else raise a ValueError."""
    given = [given] if isinstance(given, str) and size == 1 else given
    listed = isinstance(given, (list, tuple)) and all(isinstance(each, str) for each in given)
    names = tuple(given) if listed else ()
    if len(names) != size or len(set(names)) < size:
        raise ValueError(f'{name}: expected {size} different names, got {given!r}')
    if not all(each and each.isprintable() for each in names):
        raise ValueError(f'{name}: expected names of printable characters, got {given!r}')
    return names


def ordered_bounds(low: str, high: str, lower: Array, upper: Array, names: Sequence[str]) -> None:
    """Raise a ParameterError that names the first lower bound (n,) above its upper bound."""
    if (above := np.flatnonzero(lower > upper)).size:
        i = above[0]
        least, most = f'{lower[i]:g} of {names[i]}', f'{upper[i]:g}'
        raise ParameterError(f'{low}: {least} is above its {high}, {most}')


def inertia_matrix(inertia: ArrayLike) -> Array:
    """Return the matrix (3, 3) of three or nine numbers; a body must be able to have it [kg m^2].

    Raises a ParameterError if it is not symmetric or not positive definite, or a principal moment
    is too great.
    """
    numbers = np.asarray(inertia, dtype=float)
    matrix = np.diag(numbers) if numbers.size == 3 else numbers.reshape(3, 3)
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ParameterError('vehicle.inertia: the matrix is not symmetric')
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0:
        raise ParameterError(
            f'vehicle.inertia: must be positive definite, got a principal moment of '
            f'{moments[0]:g} kg m^2'
        )
    excess = moments[2] / (moments[0] + moments[1]) - 1.0
    if 1e-9 < excess <= INERTIA_ROUNDING:
        warnings.warn(
            f'vehicle.inertia: the greatest principal moment is {100.0 * excess:.2g} % above the '
            'sum of the others; no body has such moments', stacklevel=2)
    elif excess > 1e-9:
        raise ParameterError(
            f'vehicle.inertia: no body has the principal moments {moments}: '
            f'the greatest exceeds the sum of the others'
        )
    return matrix
