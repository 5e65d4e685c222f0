"""What a parameter is, and the one check of names and values.

Each subpackage has a table of its parameters in its ``parameters.py``, and adds the table to
`PARAMETERS` with `declare`.  Values from ROS and from files are checked by `complete`, so that a
wrong value gets the same message from both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf, isfinite, nan
from typing import Any

from ca_ros.errors import CaRosError

Value = float | str | list[float] | list[str]

REQUIRED = object()

LARGEST = 1e9
"""No number of a vehicle, in SI units, is larger; products of larger ones could overflow."""


class ParameterError(CaRosError, ValueError):
    """A parameter file, a parameter's name or a parameter's value is wrong."""


class MissingParameterError(ParameterError):
    """A parameter without a default is not given."""


@dataclass(frozen=True)
class Parameter:
    """What a parameter means and which values it may have.

    Attributes
    ----------
    description : str
        What it is, with its unit in brackets.
    kind : type
        `float` or `str`.
    array : bool
        Whether an array is allowed (a scalar always is).
    default : value or REQUIRED
    minimum, maximum : float
        Each number lies in [minimum, maximum], or (minimum, maximum] if `positive`.
    choices : tuple of str
        The words that may be given; any if empty.
    mutable : bool
        Whether it can be set on a running node.
    """

    description: str
    kind: type = float
    array: bool = False
    default: Any = REQUIRED
    minimum: float = -inf
    maximum: float = inf
    positive: bool = False
    choices: tuple[str, ...] = ()
    mutable: bool = False

    def range(self) -> str:
        """Return a phrase that says which values are allowed."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        if self.positive:
            return 'positive' if self.maximum == inf else f'in (0, {self.maximum:g}]'
        if self.minimum == -inf and self.maximum == inf:
            return 'a finite number' if self.kind is float else 'a word'
        if self.maximum == inf:
            return f'at least {self.minimum:g}'
        return f'in [{self.minimum:g}, {self.maximum:g}]'


PARAMETERS: dict[str, Parameter] = {}
"""All parameters that the file of a vehicle may have, in the order of the subpackages.

``import ca_ros`` imports the table of every subpackage.
"""


def declare(table: Mapping[str, Parameter]) -> None:
    """Add the table of a subpackage to `PARAMETERS`."""
    PARAMETERS.update(table)


def check(name: str, value: Any, table: Mapping[str, Parameter] = PARAMETERS) -> Value:
    """Return the value of a parameter with its type; raise a `ParameterError` if it is wrong."""
    parameter = table[name]
    is_array = not isinstance(value, (str, bool)) and hasattr(value, '__len__')
    if is_array and not parameter.array:
        raise ParameterError(f'{name}: expected one value ({parameter.range()}), got {len(value)}')
    if parameter.kind is float and isinstance(value, str) and value.lstrip().startswith('['):
        raise ParameterError(
            f'{name}: expected numbers, got the string {_shortened(value)}; ROS takes a list for '
            'numbers only if all have a decimal point or none has: write [0.0, 0.5, 1.0]'
        )
    if not is_array:
        return _check_entry(name, parameter, value)
    entries: Any = [_check_entry(f'{name}[{i}]', parameter, x) for i, x in enumerate(value)]
    return entries


def _check_entry(name: str, parameter: Parameter, value: Any) -> Any:
    expected = f'{name}: must be {parameter.range()}, got {_shortened(value)}'
    if parameter.kind is not float:
        if not isinstance(value, parameter.kind) or (
            parameter.choices and value not in parameter.choices
        ):
            raise ParameterError(expected)
        return value
    try:
        # YAML 1.1 reads 1e-4, without a point, as a word; ROS reads a number, and so does this.
        number = nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(expected) from None
    if (
        not isfinite(number)
        or not parameter.minimum <= number <= parameter.maximum
        or (parameter.positive and number <= 0.0)
    ):
        raise ParameterError(expected)
    if abs(number) > LARGEST:
        raise ParameterError(f'{name}: expected a number up to {LARGEST:g}, got {number:g}')
    return number


def _shortened(value: Any) -> str:
    """Return the repr of a value, cut to one line."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        # Such as an integer of thousands of digits.
        return f'a value of type {type(value).__name__} without end'
    return text if len(text) <= 80 else f'{text[:80]}...'


def complete(
    given: Mapping[str, Any],
    table: Mapping[str, Parameter] = PARAMETERS,
    known: Mapping[str, Parameter] = PARAMETERS,
) -> dict[str, Value]:
    """Check the given parameters, and return those of a table with defaults for the others.

    Parameters
    ----------
    given : mapping
        Values by name.
    table : mapping, optional
        The parameters to return.
    known : mapping, optional
        The parameters that may be given.  Their values are checked, in the table or not.

    Returns
    -------
    dict
        A value for each name in `table`.

    Raises
    ------
    ParameterError
        If a value is wrong, or a name is not known but resembles a known one.
    MissingParameterError
        If a required parameter of the table is missing.
    """
    groups = {name.split('.')[0] for name in known if '.' in name}
    for name in given:
        if name not in known:
            near = get_close_matches(name, known, n=1, cutoff=0.7)
            hint = f' (did you mean {near[0]}?)' if near else ''
            # Other names may belong to the node of another package.
            if near or name.split('.')[0] in groups:
                raise ParameterError(f'{name}: no such parameter{hint}')
    values = {}
    for name, parameter in table.items():
        value = given.get(name, parameter.default)
        if value is REQUIRED or value is None:
            raise MissingParameterError(f'{name}: missing; it is the {parameter.description}')
        values[name] = check(name, value, table)
    for name in given:
        if name in known and name not in table:
            check(name, given[name], known)
    return values
