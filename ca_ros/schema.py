"""The type of a parameter, and the check of names and values.

Each subpackage has a table of its parameters in its ``parameters.py``.  `ca_ros.nodes.parameters`
combines them into the table of a file and the tables of the nodes.  Values from ROS and values
from a file are checked here, so a fault gets the same message from both.
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

LARGEST, SMALLEST = 1e9, 1e-30
"""Greatest number, and least positive one; products of others could overflow."""


class ParameterError(CaRosError, ValueError):
    """A parameter file, a parameter's name or a parameter's value is wrong."""


class MissingParameterError(ParameterError):
    """A parameter without a default is not given."""


@dataclass(frozen=True)
class Parameter:
    """The meaning of a parameter and the values that it may have.

    Attributes
    ----------
    description : str
        Meaning, with the unit in brackets.
    kind : type
        `float` or `str`.
    array : bool
        Whether an array is allowed (a scalar always is).
    default : value or REQUIRED
    minimum, maximum : float
        Each number is in [minimum, maximum], and greater than zero if `positive`.
    choices : tuple of str
        The allowed words; empty if all are.
    or_class : bool
        Whether ``module:Class`` is allowed beside the choices.
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
    or_class: bool = False
    mutable: bool = False

    def range(self) -> str:
        """Return a phrase for the allowed values."""
        if self.choices:
            own = ', or module:Class for your own' if self.or_class else ''
            return f'one of {", ".join(self.choices)}{own}'
        if self.positive:
            return 'positive' if self.maximum == inf else f'in (0, {self.maximum:g}]'
        if self.minimum == -inf and self.maximum == inf:
            return 'a finite number' if self.kind is float else 'a word'
        if self.maximum == inf:
            return f'at least {self.minimum:g}'
        return f'in [{self.minimum:g}, {self.maximum:g}]'


def names_class(word: Any) -> bool:
    """Tell whether a word has the form ``module:Class``."""
    module, colon, name = str(word).partition(':')
    return bool(colon) and all(part.isidentifier() for part in (*module.split('.'), name))


def check(name: str, value: Any, table: Mapping[str, Parameter]) -> Value:
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
    def wrong() -> ParameterError:
        return ParameterError(f'{name}: must be {parameter.range()}, got {_shortened(value)}')

    if parameter.kind is not float:
        if not isinstance(value, parameter.kind) or (
            parameter.choices
            and value not in parameter.choices
            and not (parameter.or_class and names_class(value))
        ):
            raise wrong()
        return value
    try:
        # YAML 1.1 reads 1e-4, without a point, as a string.  ROS reads a number, as here.
        number = nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong() from None
    if (
        not isfinite(number)
        or not parameter.minimum <= number <= parameter.maximum
        or (parameter.positive and number <= 0.0)
    ):
        raise wrong()
    if abs(number) > LARGEST:
        raise ParameterError(f'{name}: expected a number up to {LARGEST:g}, got {number:g}')
    if parameter.positive and number < SMALLEST:
        raise ParameterError(f'{name}: expected a number from {SMALLEST:g}, got {number:g}')
    return number


def _shortened(value: Any) -> str:
    """Return the repr of a value, cut to one line."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        # For example an integer with thousands of digits.
        return f'a value of type {type(value).__name__} that is too long'
    return text if len(text) <= 80 else f'{text[:80]}...'


def check_given(given: Mapping[str, Any], known: Mapping[str, Parameter]) -> None:
    """Check the names and values of given parameters.

    Unknown names are accepted, because they may belong to another package, unless they are similar
    to a known name or in the same group (``rotors.``).

    Parameters
    ----------
    given : mapping
        Values by name.
    known : mapping
        All parameters that may be given.

    Raises
    ------
    ParameterError
        If a name or a value is wrong; the message names it.
    """
    groups = {name.split('.')[0] for name in known if '.' in name}
    for name, value in given.items():
        if name in known:
            check(name, value, known)
            continue
        near = get_close_matches(name, known, n=1, cutoff=0.7)
        if near or name.split('.')[0] in groups:
            hint = f' (did you mean {near[0]}?)' if near else ''
            raise ParameterError(f'{name}: no such parameter{hint}')


def complete(given: Mapping[str, Any], table: Mapping[str, Parameter]) -> dict[str, Value]:
    """Return a checked value for each parameter of a table: the given one, or the default.

    Parameters
    ----------
    given : mapping
        Values by name.  Names that are not in the table are ignored: see `check_given`.
    table : mapping
        The parameters to return.

    Raises
    ------
    ParameterError
        If a value is wrong.
    MissingParameterError
        If a required parameter is missing.
    """
    values = {}
    for name, parameter in table.items():
        value = given.get(name, parameter.default)
        if value is REQUIRED or value is None:
            raise MissingParameterError(f'{name}: missing; it is the {parameter.description}')
        values[name] = check(name, value, table)
    return values
