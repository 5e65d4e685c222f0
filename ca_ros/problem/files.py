"""The files of problems without a vehicle: matrix, bounds and names, in YAML.

::

    problem:
      axes: [roll, pitch]
      effector_names: [left elevon, right elevon]
      effector_kind: surfaces  # in messages
      effector_unit: rad
      axis_units: rad/s^2        # of all axes, or of each
      matrix: [[-4.2, 4.2],      # one row for each axis
               [-1.3, -1.3]]
      lower: -0.5                # of all effectors, or of each
      upper: 0.5
      # Vectors in sets, a column for each component, instead of lower and upper:
      # sets: [{sector: 0.5, radius: 4.0, least: 0.1}, {cone: 0.3, radius: 4.0}, {disc: 2.0},
      #        {interval: [0.0, 3.0]}]
      reference: [0.0, 0.0]      # optional, as are axes, names, kind and units
    allocation:                  # optional: options of the methods, as in the file of a vehicle
      exact:
        policy: scale
"""

from collections.abc import Callable, Mapping, Sequence
from math import pi
from pathlib import Path
from typing import Any, TypeVar

from ca_ros.setting_names import renamed
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import ConvexSet, Interval, Sector
from ca_ros.vehicle.files import ParameterFile, flatten

ARGUMENTS = (
    'matrix', 'lower', 'upper', 'axes', 'effector_names', 'reference', 'effector_kind',
    'effector_unit', 'axis_units', 'sets',
)  # fmt: skip
"""The entries of a file: arguments of `AllocationProblem`; see `sets_of`."""

REQUIRED_KEYS = ('matrix', 'lower', 'upper')

SHAPES = {'interval': 1, 'sector': 2, 'cone': 3, 'disc': 2}  # sets in a file, with components

P = TypeVar('P')


def read_problem(name: str | Path, kind: Callable[..., P]) -> tuple[P, dict[str, Any]] | None:
    """Read the file of a problem; return None if it is the parameter file of a vehicle.

    The result has the problem, and the options of the methods by name, such as
    ``allocation.exact.policy``, not checked.  Raises a ParameterError that names the file, the
    entry and the fault.

    `name`: a shipped problem, such as ``'admire'``, or a path to a YAML file.  `kind`:
    `AllocationProblem`.
    """
    file = ParameterFile(name)
    if not isinstance(file.content, Mapping) or 'problem' not in file.content:
        return None
    try:
        return _problem(file.content['problem'], kind), _options(file.content)
    except ValueError as error:
        raise ParameterError(f'{file.path}: {error}') from None


def _problem(given: Any, kind: Callable[..., P]) -> P:
    if not isinstance(given, Mapping):
        raise ParameterError(f'problem: expected {", ".join(ARGUMENTS)}, got {given!r}')
    given = {
        name.removeprefix('problem.'): value
        for name, value in renamed({f'problem.{name}': given[name] for name in given}).items()
    }
    if unknown := [str(name) for name in given if name not in ARGUMENTS]:
        known = ', '.join(ARGUMENTS)
        raise ParameterError(f'problem.{unknown[0]}: no such entry; there are {known}')
    if 'sets' in given and (both := [name for name in REQUIRED_KEYS[1:] if name in given]):
        raise ParameterError(f'problem.{both[0]}: given beside sets; expected one of them')
    required = REQUIRED_KEYS[:1] if 'sets' in given else REQUIRED_KEYS
    if missing := [name for name in required if given.get(name) is None]:
        raise ParameterError(f'problem.{missing[0]}: missing')
    try:
        if 'sets' in given:
            given['sets'] = sets_of(given['sets'])
        return kind(**given)
    except ValueError as error:
        raise ParameterError(f'problem.{error}') from None


def sets_of(sets: Sequence[Mapping[str, Any]]) -> list[ConvexSet]:
    """Return the sets of the entries of a file; a ValueError names what is wrong.

    Each set has one of `SHAPES`: an interval its ends, a sector or cone its half angle [rad] and
    the `radius`, a disc its radius.  `least` is the least component along the axis.
    """
    if not isinstance(sets, Sequence) or not all(isinstance(each, Mapping) for each in sets):
        raise ValueError(f'sets: expected a list of {", ".join(SHAPES)}, got {sets!r}')
    found = list[ConvexSet]()
    for i, each in enumerate(sets):
        shape = next((name for name in SHAPES if name in each), '')
        known = {'sector': {'radius', 'least'}, 'cone': {'radius', 'least'}}.get(shape, set())
        try:
            if not shape or {*each} - known - {shape} or ('radius' in known) > ('radius' in each):
                raise ValueError(
                    f'expected one of {", ".join(SHAPES)}, with the radius of a sector or cone, '
                    f'got {dict(each)}'
                )
            if shape == 'interval':
                found.append(Interval(*map(float, each[shape])))
            elif shape == 'disc':
                found.append(Sector(pi, float(each[shape])))
            else:
                least = float(each.get('least', 0.0))
                given_size = float(each[shape]), float(each['radius']), SHAPES[shape]
                found.append(Sector(*given_size, least))
        except (TypeError, ValueError) as error:
            raise ValueError(f'sets[{i}]: {error}') from None
    return found


def _options(content: Mapping[str, Any]) -> dict[str, Any]:
    if unknown := [str(name) for name in content if name not in ('problem', 'allocation')]:
        raise ParameterError(f"{unknown[0]}: expected only 'problem' and 'allocation'")
    given = content.get('allocation') or {}
    if not isinstance(given, Mapping):
        raise ParameterError(f'allocation: expected options of methods, got {given!r}')
    return renamed(flatten({'allocation': given}))
