"""Checks of options that several methods have: a number for each rotor, a whole number."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, constant
from ca_ros.schema import Parameter, check

WEIGHTS_MAX = 1e4
"""Greatest ratio of two weights."""


def per_rotor(name: str, value: ArrayLike, n: int, table: Mapping[str, Parameter]) -> Array:
    """Return an option as an (n,) array: one number for all rotors, or one for each.

    Parameters
    ----------
    name : str
        The option's name in the table.
    value : float or (n,) array
    n : int
        Number of rotors, or of effectors of another kind.
    table : mapping
        The `parameters` of the method.

    Raises
    ------
    ParameterError
        If a number is not allowed.
    ValueError
        If there is neither one number nor n numbers.
    """
    numbers = np.asarray(check(name, np.asarray(value).tolist(), table), dtype=float)
    if numbers.shape not in ((), (1,), (n,)):
        raise ValueError(f'{name}: expected 1 or {n} numbers, got shape {numbers.shape}')
    return constant(np.broadcast_to(numbers, (n,)))


def weights_per_rotor(
    name: str, value: ArrayLike, n: int, table: Mapping[str, Parameter]
) -> Array:
    """Return weights (n,); those that differ too much lose the digits of the thrusts.

    Parameters
    ----------
    name, value, n, table
        As for `per_rotor`.

    Raises
    ------
    ParameterError, ValueError
        As for `per_rotor`, or if a weight is more than `WEIGHTS_MAX` times another one.
    """
    weights = per_rotor(name, value, n, table)
    least, greatest = float(weights.min()), float(weights.max())
    if greatest > WEIGHTS_MAX * least:
        raise ValueError(
            f'{name}: {greatest:g} is more than {WEIGHTS_MAX:g} times {least:g}, too much for '
            'the digits of the thrusts'
        )
    return weights


def whole(name: str, value: float, table: Mapping[str, Parameter]) -> int:
    """Return an option that is a whole number.

    Parameters
    ----------
    name, value, table
        As for `per_rotor`.

    Raises
    ------
    ParameterError
        If the number is not allowed.
    ValueError
        If it is not whole.
    """
    number = np.asarray(check(name, value, table)).item()
    if not number.is_integer():
        raise ValueError(f'{name}: expected a whole number, got {value}')
    return int(number)
