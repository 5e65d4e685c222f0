"""Settings: each is declared once, as a field of a frozen dataclass.

::

    @dataclass(frozen=True, kw_only=True)
    class ScaledSettings(Settings):
        reserve: float = setting(0.1, 'share of each range to keep free', minimum=0.0, maximum=0.9)

``ScaledSettings(reserve=0.5)`` checks the value, and ``read(ScaledSettings, given, 'scaled.')``
reads it from the values of a parameter file.  `table` returns what a file, ROS and the pages need:
names, types, limits and descriptions.  A field whose type is another such class is a group; the
name of the group and a dot come before the names of its settings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.errors import CaRosError, shortened, suggestion

Numbers = Annotated[ArrayLike, float]  # the type of a setting that is one number or several
Words = Annotated[Sequence[str], str]  # the type of a setting that is several words
REQUIRED = object()  # the default of a setting that a file must have

LARGEST, SMALLEST = 1e9, 1e-30  # positive numbers; products of others could overflow


class ParameterError(CaRosError, ValueError):
    """A parameter file, the name of a setting or its value is wrong."""


class MissingParameterError(ParameterError):
    """A setting without a default is not given."""


@dataclass(frozen=True)
class Field:
    """The declaration of a setting; see `setting`.

    - `description`: with the unit in brackets
    - `kinds`: `bool`, `int`, `float` and `str`, as far as allowed
    - `array`: whether several values are allowed
    - `minimum`, `maximum`: the range of each number; if `positive`, it is greater than zero
    - `choices`: the allowed words, if they are not in the type
    - `sizes`: how many numbers there may be
    - `own_class`: whether ``module:Class`` is allowed beside the choices
    - `mutable`: whether it can be set on a running node
    - `python_only`: whether files and nodes do not have it
    """

    description: str
    default: Any = REQUIRED
    kinds: tuple[type, ...] = (float,)
    array: bool = False
    minimum: float = -inf
    maximum: float = inf
    positive: bool = False
    choices: Sequence[str] = ()
    sizes: Sequence[int] = ()
    own_class: bool = False
    mutable: bool = False
    python_only: bool = False

    def range(self) -> str:
        """Return a phrase for the allowed values."""
        if bool in self.kinds:
            return 'true or false'
        if str in self.kinds:
            words = f'one of {", ".join(self.choices)}' if self.choices else 'a word'
            own = ', or module:Class for your own' if self.own_class else ''
            return f'{words}{own}{", or numbers" if float in self.kinds else ""}'
        whole = 'a whole number' if int in self.kinds else ''
        return ', '.join(part for part in (whole, self._limits()) if part) or 'a finite number'

    def _limits(self) -> str:
        if self.positive:
            return 'positive' if self.maximum == inf else f'in (0, {self.maximum:g}]'
        if self.minimum == -inf and self.maximum == inf:
            return ''
        if self.maximum == inf:
            return f'at least {self.minimum:g}'
        return f'in [{self.minimum:g}, {self.maximum:g}]'


def setting(
    default: Any = REQUIRED, description: str = '', *, unit: str = '', **limits: Any
) -> Any:
    """Declare a setting, a field of a subclass of `Settings`.

    Its type is `bool`, `int`, `float`, `str`, a `Literal` of words, `Numbers`, `Words`, or a union
    of these.

    Parameters
    ----------
    default : optional
        Without a default, the setting must be given.
    description, unit : str
    **limits
        Attributes of `Field`, such as `minimum`, `positive`, `choices` and `mutable`.
    """
    text = f'{description} [{unit}]' if unit else description
    declared = Field(text, _frozen(default), **limits)
    given = {} if default is REQUIRED else {'default': declared.default}
    return dataclasses.field(**given, metadata={'setting': declared})


def groups(kinds: Mapping[str, type[Settings]]) -> Any:
    """Declare several groups of settings as one field, a mapping of settings by name.

    The names of the settings begin with the name of their group, not with that of the field.  By
    default each group has its defaults.
    """
    return dataclasses.field(
        default_factory=lambda: {name: kind() for name, kind in kinds.items()}, hash=False,
        metadata={'groups': kinds},
    )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The base class of settings, which are frozen dataclasses; values are checked when made.

    A limit between settings is checked in `__post_init__`, after that of this class; the message
    of its `ParameterError` begins with the name of a setting.
    """

    def __post_init__(self) -> None:
        for name, field in _fields(type(self)).items():
            if isinstance(field, Field):
                value = getattr(self, name)
                if value is not field.default:
                    object.__setattr__(self, name, _frozen(check(name, value, field)))


S = TypeVar('S', bound=Settings)


def settings_of(
    owner: type, kind: type[S], settings: S | None, given: Mapping[str, Any]
) -> S:
    """Return the settings of a class that takes one object of `kind`, or them by keyword.

    Raises a TypeError if there is no such setting, or both or something else is given.
    """
    known = list(kind.__dataclass_fields__)
    names = ', '.join(known) or 'none'
    if wrong := [name for name in given if name not in known]:
        hint = suggestion(wrong[0], known)
        raise TypeError(f'{owner.__name__} has no setting {wrong[0]}{hint} (settings: {names})')
    if settings is None:
        return kind(**given)
    if given or not isinstance(settings, kind):
        found = f'{settings!r} and {", ".join(given)}' if given else repr(settings)
        raise TypeError(
            f'{owner.__name__} takes settings by keyword ({names}), or one {kind.__name__}; '
            f'got {found}'
        )
    return settings


Groups = dict[str, type[Settings]]

_FOUND: dict[type[Settings], Mapping[str, Field | type[Settings] | Groups]] = {}


def _fields(kind: type[Settings]) -> Mapping[str, Field | type[Settings] | Groups]:
    """Return by name what a class of settings declares: a setting, a group, or several groups."""
    if kind in _FOUND:
        return _FOUND[kind]
    hints = get_type_hints(kind, include_extras=True)
    found: dict[str, Field | type[Settings] | Groups] = {}
    for each in dataclasses.fields(kind):
        hint, declared = hints[each.name], each.metadata.get('setting')
        if declared is None:
            found[each.name] = each.metadata.get('groups', hint)
            continue
        parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
        several = [part.__metadata__[0] for part in parts if get_origin(part) is Annotated]
        single = [part for part in parts if part in (bool, int, float, str)]
        found[each.name] = dataclasses.replace(
            declared, kinds=(*[str] * bool(words), *several, *single), array=bool(several),
            choices=(*declared.choices, *words),
        )
    _FOUND[kind] = found
    return found


def table(kind: type[Settings], prefix: str = '', own: Groups | None = None) -> dict[str, Field]:
    """Return the settings of a class and its groups by full name, without those of Python alone.

    The names begin with the prefix.  `own` has more groups, beside those of the class.
    """
    found: dict[str, Field] = {}
    for name, field in _fields(kind).items():
        if isinstance(field, type):
            found |= table(field, f'{prefix}{name}.', own)
        elif isinstance(field, dict):
            for group, each in {**field, **(own or {})}.items():
                found |= table(each, f'{prefix}{group}.')
        elif not field.python_only:
            found[prefix + name] = field
    return found


def read(
    kind: type[S], given: Mapping[str, Any], prefix: str = '', own: Groups | None = None,
    before: S | None = None,
) -> S:
    """Return the settings that are given by full name; others have their defaults.

    Names that the class does not have are ignored: see `check_given`.  Raises a ParameterError if
    a value is wrong; the message has the full name, or a MissingParameterError if a setting
    without a default is missing.

    `prefix` and `own`: see `table`.  `before`: settings whose values hold where none is given;
    groups that do not change stay the same objects.
    """
    values: dict[str, Any] = {}
    for name, field in _fields(kind).items():
        full, old = prefix + name, getattr(before, name, None)
        if isinstance(field, type):
            values[name] = read(field, given, f'{full}.', own, old)
        elif isinstance(field, dict):
            new = {
                group: read(each, given, f'{prefix}{group}.', None, old and old[group])
                for group, each in {**field, **(own or {})}.items()
            }
            values[name] = old if new == old else new
        elif not field.python_only:
            value = given.get(full, field.default if before is None else old)
            if value is REQUIRED or value is None:
                raise MissingParameterError(f'{full}: missing; it is the {field.description}')
            values[name] = value
    try:
        if before is None:
            return kind(**values)
        values = {name: each for name, each in values.items() if each is not getattr(before, name)}
        return dataclasses.replace(before, **values) if values else before
    except ParameterError as error:
        raise type(error)(f'{prefix}{error}') from None


def flat(settings: Settings, prefix: str = '') -> dict[str, Any]:
    """Return the values of settings by full name, as `read` takes them; arrays are lists."""
    values: dict[str, Any] = {}
    for name, field in _fields(type(settings)).items():
        value = getattr(settings, name)
        if isinstance(value, Settings):
            values |= flat(value, f'{prefix}{name}.')
        elif isinstance(value, dict):
            for group, each in value.items():
                values |= flat(each, f'{prefix}{group}.')
        elif not (isinstance(field, Field) and field.python_only):
            values[prefix + name] = _listed(value)
    return values


def check(name: str, value: Any, field: Field) -> Any:
    """Return the value of a setting with its type; raise a `ParameterError` if it is wrong."""
    value = value.tolist() if hasattr(value, 'tolist') else value
    is_array = not isinstance(value, (str, bool)) and hasattr(value, '__len__')
    if is_array and not field.array:
        raise ParameterError(f'{name}: expected one value ({field.range()}), got {len(value)}')
    if str not in field.kinds and isinstance(value, str) and value.lstrip().startswith('['):
        raise ParameterError(
            f'{name}: expected numbers, got the string {shortened(value)}; ROS takes a list for '
            'numbers only if all have a decimal point or none has: write [0.0, 0.5, 1.0]'
        )
    size = len(value) if is_array else 1
    if is_array and not size:
        raise ParameterError(f'{name}: expected at least one value, got none')
    if field.sizes and size not in field.sizes:
        expected = ' or '.join(map(str, field.sizes))
        raise ParameterError(f'{name}: expected {expected} numbers, got {size}')
    if is_array:
        if sound := _all_sound(value, field):
            return sound
        entry = dataclasses.replace(field, sizes=())
        return [check(f'{name}[{i}]', each, entry) for i, each in enumerate(value)]
    found = _typed(value, field)
    if found is None and isinstance(value, str) and not {str, bool} & {*field.kinds}:
        raise ParameterError(f'{name}: {shortened(value)} is no number ({field.range()})')
    if found is None:
        raise ParameterError(f'{name}: must be {field.range()}, got {shortened(value)}')
    if not isinstance(found, str) and abs(found) > LARGEST:
        raise ParameterError(f'{name}: expected a number up to {LARGEST:g}, got {found:g}')
    if field.positive and not isinstance(found, str) and found < SMALLEST:
        raise ParameterError(f'{name}: expected a number from {SMALLEST:g}, got {found:g}')
    return found


def _all_sound(values: Sequence[Any], field: Field) -> list[float] | None:
    """Return many numbers if all are within the limits, much faster than one by one; else None."""
    if float not in field.kinds or not all(type(each) is float for each in values):
        return None
    numbers = np.array(values)
    least = max(field.minimum, SMALLEST if field.positive else -LARGEST)
    # A comparison with nan is false.
    within = (numbers >= least) & (numbers <= min(field.maximum, LARGEST))
    return list(values) if within.all() else None


def _typed(value: Any, field: Field) -> Any:
    """Return one value with its type; None if it is not allowed."""
    if bool in field.kinds:
        return value if isinstance(value, bool) else None
    if str in field.kinds and isinstance(value, str):
        own = field.own_class and names_class(value)
        if not value.isprintable():
            return None
        return value if own or not field.choices or value in field.choices else None
    if not {int, float} & {*field.kinds}:
        return None
    try:
        # YAML 1.1 reads 1e-4, without a point, as a string.  ROS reads a number, as here.
        number = nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    whole, sound = int in field.kinds, field.minimum <= number <= field.maximum
    if not (sound and isfinite(number)) or (field.positive and number <= 0.0):
        return None
    return (int(number) if number.is_integer() else None) if whole else number


def names_class(word: Any) -> bool:
    """Tell whether a word has the form ``module:Class``."""
    module, colon, name = str(word).partition(':')
    return bool(colon) and all(part.isidentifier() for part in (*module.split('.'), name))


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, (list, tuple)) else value


def _listed(value: Any) -> Any:
    return list(map(_listed, value)) if isinstance(value, tuple) else value
