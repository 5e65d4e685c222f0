"""The files of problems without a vehicle: matrix, bounds and names, in YAML.

::

    problem:
      axes: [roll, pitch]
      effectors: [left elevon, right elevon]
      matrix: [[-4.2, 4.2],      # one row for each axis
               [-1.3, -1.3]]
      lower: -0.5                # of all effectors, or of each
      upper: 0.5
      reference: [0.0, 0.0]      # optional, as are axes and effectors
    allocation:                  # optional: options of the methods, as in the file of a vehicle
      exact:
        policy: scale
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import ParameterError, renamed
from ca_ros.vehicle.files import find, flatten, read_yaml, shipped_problems

ARGUMENTS = {
    'matrix': 'matrix',
    'lower': 'lower',
    'upper': 'upper',
    'axes': 'axes',
    'effectors': 'names',
    'reference': 'reference',
}
"""The argument of `AllocationProblem` for each entry of a file."""

REQUIRED_KEYS = ('matrix', 'lower', 'upper')


def read_problem(name: str | Path) -> tuple[AllocationProblem, dict[str, Any]] | None:
    """Read the file of a problem; return None if it is the parameter file of a vehicle.

    Parameters
    ----------
    name : str or path
        A shipped problem, such as ``'admire'``, or a path to a YAML file.

    Returns
    -------
    AllocationProblem
    dict
        The options of the methods by name, such as ``allocation.exact.policy``, not checked.

    Raises
    ------
    ParameterError
        In one line that names the file, the entry and the fault.
    """
    path = find(name)
    try:
        content = read_yaml(path.read_text(encoding='utf-8'))
        if not isinstance(content, Mapping) or 'problem' not in content:
            return None
        return _problem(content['problem']), _options(content)
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: not readable YAML: {error}') from None
    except ValueError as error:
        raise ParameterError(f'{path}: {error}') from None


def load_problem(name: str | Path) -> AllocationProblem:
    """Read the allocation problem in a file, without the options of the methods.

    Parameters
    ----------
    name : str or path
        A shipped problem, such as ``'admire'``, or a path to a YAML file.

    Raises
    ------
    ParameterError
        In one line that names the file, the entry and the fault.
    """
    found = read_problem(name)
    if found is None:
        raise ParameterError(
            f"{name}: no entry 'problem'; shipped problems are {', '.join(shipped_problems())}, "
            'and Vehicle.load reads the files of vehicles'
        )
    return found[0]


def _problem(given: Any) -> AllocationProblem:
    if not isinstance(given, Mapping):
        raise ParameterError(f'problem: expected {", ".join(ARGUMENTS)}, got {given!r}')
    if unknown := [str(name) for name in given if name not in ARGUMENTS]:
        raise ParameterError(
            f'problem.{unknown[0]}: no such entry; there are {", ".join(ARGUMENTS)}'
        )
    if missing := [name for name in REQUIRED_KEYS if given.get(name) is None]:
        raise ParameterError(f'problem.{missing[0]}: missing')
    try:
        return AllocationProblem(**{ARGUMENTS[name]: value for name, value in given.items()})
    except ValueError as error:
        fault = str(error)
        raise ParameterError(f'problem.{fault.replace("names:", "effectors:", 1)}') from None


def _options(content: Mapping[str, Any]) -> dict[str, Any]:
    if unknown := [str(name) for name in content if name not in ('problem', 'allocation')]:
        raise ParameterError(f"{unknown[0]}: expected only 'problem' and 'allocation'")
    given = content.get('allocation') or {}
    if not isinstance(given, Mapping):
        raise ParameterError(f'allocation: expected options of methods, got {given!r}')
    return renamed(flatten({'allocation': given}))
